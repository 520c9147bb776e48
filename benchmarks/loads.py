"""What the bridge takes for a load while the shipped policies drive robots that bear none.

    python benchmarks/loads.py --minutes 10 --parts build/loads

Attempts at the tasks, one after the other, in one process and in lockstep, with robots that hide
nothing, friction, or another gain of a drive: what of that the load observer sees, how many
commands were limited because of it, and whether any stop was.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from parts import Part, commits, done_parts, print_or_write

from gfm.core import ManualClock
from gfm.core.checks import Array32
from gfm.envs.matching import Matching
from gfm.envs.matching_task import POSE_MATCHING, POSITION_MATCHING, MatchingTask
from gfm.experiments.attempts import AttemptRunner, planned
from gfm.experiments.driver import Driver
from gfm.experiments.evaluate import EvaluationRequest, load_arm, policy_for
from gfm.policies import shipped_policy
from gfm.recording.weights_file import read_weights
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.__main__ import build as build_bridge
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated.__main__ import build as build_robot
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import GivenEffect
from gfm_wire import RobotClock

_STEP_S = 5e-4
_TASKS = {"position": POSITION_MATCHING, "pose": POSE_MATCHING}
_COUNTED = ("load_limits", "collision_limits", "heavy_loads", "lost_clearances", "stalls")


def _on(effect: str, joint: str, **amounts: float) -> GivenEffect:
    return GivenEffect(effect=effect, joints=(joint,), parameters=amounts)


#: What the robots hide: as much as the simulated one draws at most.
HIDDEN: dict[str, tuple[GivenEffect, ...]] = {
    "nothing": (),
    "friction of 4.5 N m on `right_j1`": (_on("coulomb_friction", "right_j1", torque=4.5),),
    "friction of 12 N m s/rad on `right_j3`": (
        _on("viscous_friction", "right_j3", coefficient=12.0),
    ),
    "gain of 0.5 on `right_j1`": (_on("actuator_gain", "right_j1", scale=0.5),),
    "gain of 1.9 on `right_j3`": (_on("actuator_gain", "right_j3", scale=1.9),),
}


@dataclass(frozen=True, kw_only=True)
class Drive:
    """Attempts at a task with a robot that hides something, a key of HIDDEN."""

    task: str
    hidden: str
    minutes: float

    def made(self, folder: Path) -> Part:
        """Tries for so long, by the robot's clock; returns what came of it."""
        task, clock, hub = _TASKS[self.task], ManualClock(), MemoryHub()
        both = {"clock": RobotClock.LOCKSTEP, "task": self.task}
        bridge = build_bridge(
            BridgeConfig(name="bridge", recordings=str(folder), control_hz=20.0, **both),
            MemoryTransport(hub, name="bridge", clock=clock),
            clock,
        )
        robot = build_robot(
            SimulatedConfig(name="robot", seed=0, hidden=HIDDEN[self.hidden], **both),
            MemoryTransport(hub, name="robot", clock=clock),
            clock,
        )

        def idle() -> None:
            clock.advance_s(_STEP_S)
            bridge.step()
            robot.step()

        driver = Driver(MemoryTransport(hub, clock=clock), clock, idle)
        driver.begin(JOINT_NAMES, 1.0)
        seen_nm: list[float] = []

        def noted() -> None:
            seen_nm.append(bridge.status().gauges["unknown_load_nm"])

        runner = _runner(task, driver, noted)
        outcomes: Counter[str] = Counter()
        for number, (goal, trial) in enumerate(planned(10, 1000)):
            if driver.newest.stamp_ns * 1e-9 > 60.0 * self.minutes:
                break
            attempt = runner.make(goal, trial, f"attempt_{number}")
            outcomes[attempt.outcome if attempt else "broken off"] += 1
        counted = bridge.status().counters
        return {
            "seen_nm": [round(value, 3) for value in seen_nm],
            "outcomes": dict(outcomes),
            "counters": {name: counted[name] for name in _COUNTED},
        }


def _runner(task: MatchingTask, driver: Driver, noted: Callable[[], None]) -> AttemptRunner:
    """Returns what tries the task by the policy that comes with gfm, and notes every step."""
    arm = load_arm(EvaluationRequest(task=task.name))
    path = shipped_policy(task.name)
    policy = policy_for(path, read_weights(path), Matching(task, arm, 1).spec).mean_action

    def watched(seen: Array32) -> Array32:
        noted()
        return policy(seen)

    return AttemptRunner(task, arm, watched, driver, seed=0)


def report(done: Mapping[Drive, Part], ran_on: str) -> str:
    """Returns a table in Markdown."""
    lines = [
        f"Commit {ran_on}.",
        "",
        "| task | hidden | commands | seen, N m: p50 | p99 | most | limited by it | too heavy | "
        "lost clearances | attempts reached |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for drive, part in done.items():
        seen, counters, outcomes = part["seen_nm"], part["counters"], part["outcomes"]
        middle, high = np.quantile(seen, (0.5, 0.99))
        lines.append(
            f"| {drive.task} | {drive.hidden} | {len(seen):,} | {middle:.2f} | {high:.2f} | "
            f"{max(seen):.2f} | {counters['load_limits']} | {counters['heavy_loads']} | "
            f"{counters['lost_clearances']} | "
            f"{outcomes.get('reached', 0)} of {sum(outcomes.values())} |"
        )
    return "\n".join([*lines, ""])


def main() -> None:
    """Drives, and writes what came of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="of each robot's time")
    parser.add_argument("--tasks", nargs="+", choices=_TASKS, default=list(_TASKS))
    parser.add_argument("--parts", type=Path, help="where parts are kept (default: nowhere)")
    parser.add_argument("--out", type=Path, help="Markdown to write (default: print)")
    arguments = parser.parse_args()
    logging.disable(logging.WARNING)
    drives = {
        f"{task}_{number}_{arguments.minutes:g}": Drive(
            task=task, hidden=hidden, minutes=arguments.minutes
        )
        for number, hidden in enumerate(HIDDEN)
        for task in arguments.tasks
    }
    with tempfile.TemporaryDirectory() as place:

        def do(name: str) -> Part:
            return drives[name].made(Path(place) / name)

        parts = done_parts(arguments.parts or Path(place) / "parts", list(drives), do)
    text = report({drives[name]: part for name, part in parts.items()}, commits(parts))
    print_or_write(text, arguments.out)


if __name__ == "__main__":
    main()
