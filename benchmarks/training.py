"""A training run in one process, tested as it goes: what a setting changes, apart from clocks.

    python benchmarks/training.py --config configs/position_matching.toml
    python benchmarks/training.py --config src/gfm/policies/training_on.toml --model corrected.xml \
        --from src/gfm/policies/position_matching.npz learner.learning.retrace_lambda=0.3

The services of `gfm train` take turns over the transport in memory. Every so many learner steps the
policy is tested as by `gfm evaluate`, with its mean actions and with sampled ones. One core.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from gfm.core import MonotonicClock
from gfm.envs.evaluation import evaluate
from gfm.envs.matching_task import TASKS
from gfm.experiments.evaluate import EvaluationRequest, load_arm
from gfm.experiments.train_config import TrainConfig
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service.assets import load_environment
from gfm.service.config import read_config
from gfm.service.metrics import NoMetrics
from gfm.transport import MemoryHub, MemoryTransport
from gfm_actor.config import ActorConfig
from gfm_actor.service import ActorService
from gfm_learner.checkpoint import begin
from gfm_learner.config import LearnerConfig
from gfm_learner.service import LearnerService
from gfm_replay.config import ReplayConfig
from gfm_replay.service import ReplayService

#: Of the starts of the tests, which are the same ones each time.
_TEST_SEED = 100


class System:
    """Actor, replay and learner of an experiment."""

    def __init__(self, config: TrainConfig, begin_from: str) -> None:
        hub, clock = MemoryHub(), MonotonicClock()
        learner = msgspec.convert(
            {"name": "learner", "env": config.env, "seed": config.seed, "init": begin_from}
            | config.learner,
            LearnerConfig,
        )
        actor = msgspec.convert({"name": "actor", "env": config.env} | config.actor, ActorConfig)
        env = load_environment(
            config.env, learner.environment, num_envs=actor.num_envs, seed=config.seed
        )
        self.learner = LearnerService(
            learner,
            begin(learner, env.spec),
            MemoryTransport(hub, name="learner"),
            clock,
            NoMetrics(),
        )
        self.replay = ReplayService(
            msgspec.convert({"name": "replay"} | config.replay, ReplayConfig),
            MemoryTransport(hub, name="replay"),
            clock,
            np.random.default_rng(config.seed),
        )
        self.actor = ActorService(
            actor,
            env,
            MemoryTransport(hub, name="actor"),
            clock,
            np.random.default_rng(config.seed),
        )

    @property
    def steps(self) -> int:
        """Of the learner."""
        return self.learner.status().counters["learner_steps"]

    def advance(self, steps: int) -> None:
        """Runs until the learner has made so many steps."""
        while self.steps < steps:
            for service in (self.actor, self.replay, self.learner):
                service.step()


def main() -> None:
    """Trains, and prints a line per test."""
    asked = _arguments()
    torch.set_num_threads(1)
    settings = dict(_setting(text) for text in asked.settings)
    if asked.model is not None:
        settings["learner.environment.models.velocity"] = str(asked.model)
    config = read_config(TrainConfig, asked.config, settings)
    system = System(config, str(asked.begin_from or ""))
    arm = load_arm(EvaluationRequest(task=config.env, model=asked.model))
    began_s = time.monotonic()
    for steps in range(0, config.learner_steps + 1, asked.test_every):
        system.advance(steps)
        policy = GaussianPolicy.from_weights(system.learner.weights)
        rng = np.random.default_rng(_TEST_SEED)
        mean, sampled = (
            int(evaluate(TASKS[config.env], arm, act, trials=5, seed=_TEST_SEED).reached.sum())
            for act in (policy.mean_action, lambda seen, p=policy, r=rng: p.sample(seen, r)[0])
        )
        print(
            f"{steps:6} steps, {time.monotonic() - began_s:5.0f} s: {mean} of 50 reached, "
            f"{sampled} by sampled actions; in training "
            f"{system.actor.status().gauges.get('success_rate', 0.0):.2f}",
            flush=True,
        )


def _setting(text: str) -> tuple[str, Any]:
    name, _, value = text.partition("=")
    return name, msgspec.json.decode(value)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("settings", nargs="*", help="over those of the file: name=JSON")
    parser.add_argument("--config", type=Path, required=True, help="the experiment's file")
    parser.add_argument("--model", type=Path, help="MJCF for velocity commands")
    parser.add_argument("--from", dest="begin_from", type=Path, help="policy to begin with")
    parser.add_argument("--test-every", type=int, default=2000, metavar="STEPS")
    return parser.parse_intermixed_args()


if __name__ == "__main__":
    main()
