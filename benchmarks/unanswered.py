"""What questions leave behind that nobody answers.

    python benchmarks/unanswered.py --questions 5000

An actor over zenoh has weights, and a replay that is there and never looks: each of its sequences
is asked about again and again. Router, learner and replay are in this process, too. Two rounds:
one with Python's collector of cycles switched off, which tells how many objects only that would
have freed; one with it, as processes live, with memory after each fifth.
"""

from __future__ import annotations

import argparse
import gc
import os
import time
from collections.abc import Callable

import gfm_actor.__main__
import gfm_learner.__main__
import gfm_replay.__main__
from gfm.core import MonotonicClock
from gfm.envs.registry import EnvironmentSettings
from gfm.launch import free_endpoint
from gfm.service import Service, ServiceConfig
from gfm.service.usage import process_usage
from gfm.transport import ZenohTransport
from gfm_actor.config import ActorConfig
from gfm_learner.config import LearnerConfig
from gfm_replay.config import ReplayConfig

_TIMEOUT_S = 0.05
_NAP_S = 3e-4
_GAUGES = {"memory_mib": ".1f", "heap_mib": ".1f", "python_blocks": ",.0f"}


class Cell:
    """Router, learner, replay and actor in one process; `ask` steps the actor alone."""

    def __init__(self) -> None:
        self._endpoint = free_endpoint()
        self._sessions = [ZenohTransport.open(run="r", listen=[self._endpoint], insecure=True)]
        world = {"env": "point_mass", "environment": EnvironmentSettings(horizon=10)}
        keeping = ReplayConfig(run="r", name="replay")
        learning = LearnerConfig(run="r", name="learner", max_steps=0, **world)
        acting = ActorConfig(run="r", name="actor", timeout_s=_TIMEOUT_S, **world)
        others = [
            self._started(gfm_replay.__main__.build, keeping),
            self._started(gfm_learner.__main__.build, learning),
        ]
        self._actor = self._started(gfm_actor.__main__.build, acting)
        while self._actor.status().counters["sequences_acked"] < 64:
            for service in (*others, self._actor):
                service.step()
            time.sleep(_NAP_S)

    def _started(self, build: Callable[..., Service], config: ServiceConfig) -> Service:
        transport = ZenohTransport.open(run="r", name=config.name, connect=[self._endpoint])
        self._sessions.append(transport)
        return build(config, transport, MonotonicClock())

    def ask(self, questions: int) -> None:
        """Returns after so many questions in vain."""
        end = self._resent + questions
        while self._resent < end:
            self._actor.step()
            time.sleep(_NAP_S)

    @property
    def _resent(self) -> int:
        return self._actor.status().counters["sequences_resent"]

    def close(self) -> None:
        """Leaves."""
        for session in reversed(self._sessions):
            session.close()


def main() -> None:
    """Asks in vain, and prints what that left."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--questions", type=int, default=5000, help="of each round")
    questions = parser.parse_args().questions
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    cell = Cell()
    cell.ask(questions // 5)
    gc.collect()
    gc.disable()
    cell.ask(questions)
    print(f"{questions} questions in vain: {gc.collect()} objects were left to the collector\n")
    gc.enable()
    print("| questions in vain | " + " | ".join(_GAUGES) + " |\n" + "|---" * 4 + "|")
    for fifth in range(6):
        used = process_usage()
        row = " | ".join(format(used[gauge], digits) for gauge, digits in _GAUGES.items())
        print(f"| {fifth * questions // 5} | {row} |", flush=True)
        cell.ask(questions // 5 if fifth < 5 else 0)
    cell.close()


if __name__ == "__main__":
    main()
