"""What the learner service may be told."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from gfm.envs.registry import EnvironmentSettings
from gfm.rl.learner_state import Count, Fraction, LearnerSettings
from gfm.rl.mpo import Positive
from gfm.service import ServiceConfig
from gfm_wire import Role


class LearnerConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the learner service.

    Attributes:
        env: Name of the environment that is learned for.
        environment: What that environment may be told; only its sizes matter here.
        learning: How to learn; a checkpoint is only resumed with the same.
        batch_size: Sequences per learner step.
        prefetch: Batches asked for ahead.
        importance_exponent: How much of what is drawn more often counts less, where replay draws by
            priority: with 1 all of it, so that nothing is biased; with 0 nothing.
        max_steps: Learner steps after which it only serves its weights; None for no limit.
        heartbeat_s: Longest time between two broadcasts of the weights: actors act only as long
            as they hear from the learner.
        checkpoint_dir: Folder of checkpoints and metrics; empty for none.
        checkpoint_period_s: Between two checkpoints.
        resume: Whether to go on from the checkpoint in that folder, where there is one.
        init: File of policy weights to start from; empty to start at random.
        metrics_every: Learner steps between two rows of metrics.
        timeout_s: How long to wait for a batch before asking again.
        threads: Of torch.
        device: Of torch.
        seed: Of first weights and sampled actions.
    """

    role: ClassVar[Role] = Role.LEARNER

    env: str = "gfm_fit"
    environment: EnvironmentSettings = EnvironmentSettings()
    learning: LearnerSettings = LearnerSettings()
    batch_size: Count = 32
    prefetch: Count = 2
    importance_exponent: Fraction = 1.0
    max_steps: Annotated[int, Meta(ge=0)] | None = None
    heartbeat_s: Positive = 1.0
    checkpoint_dir: str = ""
    checkpoint_period_s: Positive = 30.0
    resume: bool = True
    init: str = ""
    metrics_every: Count = 20
    timeout_s: Positive = 10.0
    threads: Count = 1
    device: str = "cpu"
    seed: int = 0
