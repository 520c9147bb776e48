"""Proposed motions, driven through the bridge and recorded: all in one process."""

from __future__ import annotations

import io
import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from rich.console import Console

from gfm.core import CommandKind, ConfigError, ManualClock
from gfm.excitation.limits import Wishes, robot_limits
from gfm.excitation.motion import Purpose
from gfm.excitation.plan import Plan, PlannedMotion, Request, make_plan
from gfm.experiments.excite_command import (
    ExciteRequest,
    check_way,
    diagnose_words,
    drive_plan,
    print_plan,
)
from gfm.recording import read_recording
from gfm.report import PlanReport
from gfm.sim.sawyer import JOINT_NAMES, NEUTRAL, READY, sawyer_spec
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.__main__ import build as build_bridge
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated.__main__ import build as build_robot
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_wire import RobotClock

MODEL = sawyer_spec(command=CommandKind.POSITION).compile()
#: Close to where the simulated robot starts: the way there takes a second.
READY_POSE = Wishes(
    pose="ready",
    speed={"": 0.6},
    ranges={name: (q - 0.3, q + 0.35) for name, q in zip(JOINT_NAMES, READY, strict=True)},
)


#: Of each motion that is driven: enough to see whether it is followed.
PERIODS = 100


def made_plan(kind: CommandKind) -> Plan:
    """Returns the beginning of one training motion and of a held-out one."""
    limits = robot_limits({CommandKind.POSITION: MODEL}, READY_POSE)
    asked = Request(kinds=(kind,), effects=("cogging_torque",), seconds=8.0)
    plan = make_plan(MODEL, limits, asked)
    return replace(plan, motions=tuple(begun(one) for one in plan.motions[:2]))


LOCKSTEP = RobotClock.LOCKSTEP


def begun(planned: PlannedMotion) -> PlannedMotion:
    motion, torque = planned.motion, planned.torque[:PERIODS]
    tracking = None if motion.tracking is None else replace(motion.tracking, torque=torque)
    begin = replace(motion, position=motion.position[:PERIODS], tracking=tracking)
    return replace(planned, motion=begin, torque=torque)


def driven(folder: Path, plan: Plan, *, model=MODEL) -> tuple[tuple[Path, ...], PlanReport]:
    hub, time = MemoryHub(), ManualClock()
    bridge = build_bridge(
        BridgeConfig(name="bridge", recordings=str(folder / "recordings"), clock=LOCKSTEP),
        MemoryTransport(hub, name="bridge", clock=time),
        time,
    )
    robot = build_robot(
        SimulatedConfig(name="robot", hidden_effect="none", seed=4, clock=LOCKSTEP),
        MemoryTransport(hub, name="robot", clock=time),
        time,
    )

    def idle() -> None:
        time.advance_s(5e-4)
        bridge.step()
        robot.step()

    request = ExciteRequest(models=(), out=folder / "plan", wishes=READY_POSE)
    report = PlanReport(plan=plan, robot="sawyer")
    progress = Console(file=io.StringIO())
    transport = MemoryTransport(hub, clock=time)
    done = drive_plan(transport, time, report, request, model=model, progress=progress, idle=idle)
    bridge.close()
    return done


def test_a_plan_becomes_recordings_that_follow_it(tmp_path: Path) -> None:
    plan = made_plan(CommandKind.POSITION)
    paths, report = driven(tmp_path, plan)
    document = json.loads(paths[0].read_text())
    assert {one["name"]: one["recording"] for one in document["motions"]} == report.recordings
    for one in plan.motions:
        recording = read_recording(Path(report.recordings[one.motion.name]))
        assert recording.metadata["purpose"] == one.family.purpose
        assert recording.command_kind is CommandKind.POSITION
        assert recording.requested is not None
        ends = np.append(np.diff(recording.requested[:, 0]) != 0.0, True)
        np.testing.assert_array_equal(recording.requested[ends], recording.command[ends])
        reached = recording.position[5::2][: len(one.motion.position) - 10]
        assert abs(reached - one.motion.position[: len(reached)]).max() < 0.1
    words = diagnose_words(plan, report, (Path("sawyer.xml"),))
    training, held_out = words.split(" --holdout ")
    assert [training.count(str(p)) for p in Purpose] == [1, 0]
    assert held_out.count("heldout_position") == 1
    console = Console(file=io.StringIO(), width=400)
    print_plan(console, report, (Path("sawyer.xml"),))
    assert f"next: {words}" in console.file.getvalue()


def test_torques_keep_the_arm_on_the_motion(tmp_path: Path) -> None:
    plan = made_plan(CommandKind.EFFORT)
    one = plan.motions[0]
    _, report = driven(tmp_path, replace(plan, motions=(one,)))
    recording = read_recording(Path(report.recordings[one.motion.name]))
    assert recording.command_kind is CommandKind.EFFORT
    reached = recording.position[5::2][: len(one.motion.position) - 10]
    behind = abs(reached - one.motion.position[: len(reached)])
    assert behind.max() < 0.1
    assert np.ptp(one.motion.position, axis=0).max() > 0.1


def test_a_way_to_the_first_motion_that_touches_is_refused_before_anything_moves(
    tmp_path: Path,
) -> None:
    data = mujoco.MjData(MODEL)
    data.qpos[:] = 0.5 * (READY + NEUTRAL)  # the robot is ready, motions begin at neutral
    mujoco.mj_forward(MODEL, data)
    spec = sawyer_spec(command=CommandKind.POSITION)
    ball = spec.worldbody.add_body(name="ball", pos=data.site("end_effector").xpos)
    ball.add_geom(size=(0.02, 0.0, 0.0))
    limits = robot_limits({CommandKind.POSITION: MODEL}, Wishes(pose="neutral"))
    plan = replace(made_plan(CommandKind.POSITION), limits=limits)
    with pytest.raises(ConfigError, match=r"on the straight way .*, ball and .* would come within"):
        driven(tmp_path, plan, model=spec.compile())
    assert not list(tmp_path.rglob("*.mcap"))
    assert not (tmp_path / "plan").exists()


def test_the_way_from_where_motions_begin_is_free() -> None:
    limits = robot_limits({CommandKind.POSITION: MODEL}, READY_POSE)
    check_way(MODEL, limits, READY, 0.01)
