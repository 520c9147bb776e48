"""A speed that bears what a gravity compensation gets wrong under an encoder's offset."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.core import Command, CommandKind
from gfm.core.checks import Array
from gfm.envs.arm import VELOCITY_SHARE, ArmProblem
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, arm_problem, nominal_cell
from gfm.experiments.attempt_bearing import Bearing
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.robot import SimulatedRobot

OFFSET = 0.05
ZERO = OFFSET * (np.arange(7) == 1)


def pose_cell(offset: float) -> ArmProblem:
    spec = nominal_cell("pose_matching")
    spec.joint("right_j1").ref = offset
    assets = EnvironmentAssets(models={CommandKind.VELOCITY: spec.compile()})
    return arm_problem("pose_matching", EnvironmentSettings(), assets)


def drift(added: Array) -> Array:
    """Returns how fast a robot whose encoder counts wrong goes after a second at given speeds."""
    hidden = HiddenEffect(effect="encoder_offset", joints=(1,), parameters={"offset": OFFSET})
    robot = SimulatedRobot(READY, effects=[hidden], cell=Cell.POSE)
    for _ in range(10):
        values = {"joint_names": JOINT_NAMES, "values": added, "stamp_ns": robot.time_ns}
        robot.advance(Command(kind=CommandKind.VELOCITY, **values), 100_000_000)
    begun = robot.latest
    robot.advance(Command(kind=CommandKind.VELOCITY, **values), 150_000_000)
    passed_s = 1e-9 * (robot.latest.stamp_ns - begun.stamp_ns)
    return (robot.latest.position - begun.position) / passed_s


def test_an_arm_stands_that_is_told_what_its_compensation_gets_wrong() -> None:
    added = Bearing(pose_cell(OFFSET)).speed(READY + ZERO)
    alone, told = np.abs(drift(np.zeros(7))), np.abs(drift(added))
    assert alone[1] > 0.015
    assert told.max() < 0.2 * alone[1]


def test_a_policy_that_goes_as_fast_as_it_may_is_not_slowed_down_by_what_is_added() -> None:
    arm = pose_cell(OFFSET)
    bearing = Bearing(arm)
    added = bearing.speed(READY + ZERO)
    fastest = arm.velocity_limit + np.abs(added)
    of_robot = arm.velocity_limit / VELOCITY_SHARE
    share = bearing.share(added)
    assert (fastest <= share * of_robot + 1e-12).all()
    assert VELOCITY_SHARE < share < 1.5 * VELOCITY_SHARE


def test_where_encoders_count_from_zero_nothing_is_added() -> None:
    bearing = Bearing(pose_cell(0.0))
    added = bearing.speed(READY)
    assert added == pytest.approx(np.zeros(7), abs=0.0)
    assert bearing.share(added) == VELOCITY_SHARE
