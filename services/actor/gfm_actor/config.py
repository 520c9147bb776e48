"""What the actor service may be told."""

from __future__ import annotations

import zlib
from typing import Annotated, ClassVar

from msgspec import Meta

from gfm.core import SEQUENCE_LENGTH, ConfigError
from gfm.envs.registry import EnvironmentSettings, episode_steps
from gfm.service import ServiceConfig
from gfm_wire import Role

Count = Annotated[int, Meta(ge=1)]
Positive = Annotated[float, Meta(gt=0.0)]


class ActorConfig(ServiceConfig, frozen=True, kw_only=True):
    """Settings of the actor service.

    Attributes:
        env: Name of the environment to act in.
        environment: What that environment may be told.
        num_envs: Instances stepped together.
        sequence_length: Transitions per sequence, T. Episodes are cut into sequences without
            overlap; the horizon must be a multiple, so that time limits lose nothing.
        window: Sequences that may be unacknowledged, up to 1024: so many the replay service tells
            apart. Beyond that the actor stops acting.
        timeout_s: How long to wait for an acknowledgement before sending again.
        max_weights_age_s: Without a sign of life from the learner for this long, it stops acting.
        max_steps_per_s: Environment steps per second, at most; None does not limit them.
        drain_s: How long to wait at the end for what is unacknowledged.
        seed: Of the environment's episodes and of the sampled actions; None makes one from the
            name, so that actors that were started alike do not act alike.
        ledger: Folder that gets, per life of the actor, a file of what replay acknowledged; empty
            for none. `python -m gfm_replay.audit` compares it with what replay kept.
    """

    role: ClassVar[Role] = Role.ACTOR

    env: str = "gfm_fit"
    environment: EnvironmentSettings = EnvironmentSettings()
    num_envs: Count = 32
    sequence_length: Count = SEQUENCE_LENGTH
    window: Annotated[int, Meta(ge=1, le=1024)] = 64
    timeout_s: Positive = 5.0
    max_weights_age_s: Positive = 60.0
    max_steps_per_s: Positive | None = None
    drain_s: Annotated[float, Meta(ge=0.0)] = 2.0
    seed: int | None = None
    ledger: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.environment != EnvironmentSettings():  # else the run is asked for it first
            self.check_lengths()
        if self.window < self.num_envs:
            raise ConfigError(
                f"window is {self.window} and num_envs is {self.num_envs}, expected at least as "
                "many: all instances may finish a sequence in the same step"
            )

    def check_lengths(self) -> None:
        """Raises ConfigError where episodes are no whole number of sequences long."""
        if (steps := episode_steps(self.env, self.environment)) % self.sequence_length:
            raise ConfigError(
                f"environment.horizon is {steps} and sequence_length is "
                f"{self.sequence_length}, expected a multiple of it"
            )

    @property
    def chosen_seed(self) -> int:
        """The seed, or the one made from the name."""
        return zlib.crc32(self.name.encode()) if self.seed is None else self.seed
