"""Driver, bridge and simulated robot in one process: motions in, recordings out."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from gfm.core import (
    BadInputError,
    CommandKind,
    ConfigError,
    ManualClock,
    RefusedError,
    UnreachableError,
)
from gfm.excitation.motion import Motion, Purpose
from gfm.excitation.waypoints import motions
from gfm.experiments.drive import Driven, drive, sawyer_ranges, speed_share
from gfm.experiments.record import chosen_motions
from gfm.recording import read_recording
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.__main__ import build as build_bridge
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated.__main__ import build as build_robot
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import RobotClock


def driven(
    folder: Path,
    chosen: Sequence[Motion],
    *,
    clock: str = "lockstep",
    robot_clock: str = "",
    effect: str = "none",
) -> list[Driven]:
    hub, time = MemoryHub(), ManualClock()
    bridge = build_bridge(
        BridgeConfig(name="bridge", recordings=str(folder), clock=RobotClock(clock)),
        MemoryTransport(hub, name="bridge", clock=time),
        time,
    )
    robot = build_robot(
        SimulatedConfig(
            name="robot", clock=RobotClock(robot_clock or clock), hidden_effect=effect, seed=4
        ),
        MemoryTransport(hub, name="robot", clock=time),
        time,
    )

    def idle() -> None:
        time.advance_s(5e-4)
        bridge.step()
        robot.step()

    done = list(drive(MemoryTransport(hub, clock=time), time, chosen, idle=idle))
    bridge.close()
    return done


def short_motions() -> list[Motion]:
    made = motions(sawyer_ranges(), seed=3, duration_s=4.0)
    return [made[0], made[8]]


@pytest.mark.parametrize("clock", ["lockstep", "wall"])
def test_motions_become_recordings(tmp_path: Path, clock: str) -> None:
    chosen = short_motions()
    done = driven(tmp_path, chosen, clock=RobotClock(clock))
    assert [(d.name, d.purpose, d.kind) for d in done] == [
        (m.name, m.purpose, m.kind) for m in chosen
    ]
    for motion, recorded in zip(chosen, done, strict=True):
        recording = read_recording(recorded.path)
        assert recording.command_kind is motion.kind
        assert recording.joint_names == JOINT_NAMES
        assert recording.duration_s == pytest.approx(4.0, abs=0.05)
        assert recording.metadata["purpose"] == motion.purpose
        assert recording.requested is not None
        ends = np.append(np.diff(recording.requested[:, 0]) != 0.0, True)
        as_asked = recording.requested[ends] == recording.command[ends]
        assert as_asked.mean() > 0.98  # feedback asks for more speed than is allowed, at times
        reached = recording.position[5::2][: len(motion.position) - 10]
        assert abs(reached - motion.position[: len(reached)]).max() < 0.12


def test_recordings_are_the_same_for_the_same_seed(tmp_path: Path) -> None:
    first, again = (
        driven(tmp_path / name, short_motions()[:1], effect="coulomb_friction") for name in "ab"
    )
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(
            read_recording(one.path).position, read_recording(other.path).position
        )


def test_the_lockstep_robot_acts_when_the_recording_says(tmp_path: Path) -> None:
    recording = read_recording(driven(tmp_path, short_motions()[:1])[0].path)
    after_ns = recording.command_stamp_ns[1:] - recording.stamp_ns[0] + 10_000_000
    assert after_ns.min() >= 4_000_000
    assert (after_ns % 20_000_000 == 4_000_000).sum() >= 199
    assert recording.command_kind is CommandKind.POSITION


@pytest.mark.parametrize(
    ("speed", "share"),
    [
        (0.0, 0.05),  # of right_j1, 1.328 rad/s, whose share is the largest
        (0.01 * 1.328, 0.05),
        (0.2 * 1.328, 0.4),
        (2.0 * 1.328, 1.0),
    ],
)
def test_a_motion_asks_for_twice_the_share_that_it_needs(speed: float, share: float) -> None:
    motion = Motion(
        name="even",
        purpose=Purpose.TRAINING,
        kind=CommandKind.POSITION,
        joint_names=JOINT_NAMES,
        period_s=0.02,
        position=np.outer(0.02 * np.arange(5), np.full(7, speed)),
    )
    assert speed_share(motion) == pytest.approx(share)


def test_another_control_rate_is_noticed(tmp_path: Path) -> None:
    chosen = motions(sawyer_ranges(), seed=3, duration_s=4.0, period_s=0.05)[:1]
    with pytest.raises(BadInputError, match="the bridge's control rate is not 20 Hz"):
        driven(tmp_path, chosen)


@pytest.mark.parametrize(("clock", "other"), [("lockstep", "wall"), ("wall", "lockstep")])
def test_a_bridge_on_another_clock_than_its_robot_says_so(
    tmp_path: Path, clock: str, other: str
) -> None:
    words = f"robot: the bridge is on the {clock} clock and this robot on the {other} clock, expec"
    with pytest.raises(RefusedError, match=words):
        driven(tmp_path, short_motions(), clock=clock, robot_clock=other)


def test_without_a_bridge_the_wait_is_bounded() -> None:
    clock = ManualClock()
    transport = MemoryTransport(MemoryHub(), clock=clock)
    waiting = drive(
        transport, clock, short_motions(), wait_s=2.0, idle=lambda: clock.advance_s(0.01)
    )
    with pytest.raises(UnreachableError, match="robot/command"):
        next(waiting)
    assert 2.0 <= clock.now_ns() * 1e-9 < 4.0


def arguments(**changed: object) -> argparse.Namespace:
    given = {"duration_s": 12.0, "control_hz": 50.0, "seed": 1, "only": None}
    return argparse.Namespace(**(given | changed))


def test_the_command_line_chooses_motions() -> None:
    assert len(chosen_motions(arguments())) == 10
    held_out = chosen_motions(arguments(only="heldout"))
    assert {motion.purpose for motion in held_out} == {Purpose.HELDOUT}
    with pytest.raises(ConfigError, match=r"--duration-s is 1.0, expected 4 to 600"):
        chosen_motions(arguments(duration_s=1.0))
    with pytest.raises(ConfigError, match=r"--control-hz is 1.0"):
        chosen_motions(arguments(control_hz=1.0))
