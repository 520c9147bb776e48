"""Amounts are settled where a servo's slow errors show: in closed form, without a simulator."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import LONG, SHORT, all_segments, prepared
from gfm.diagnosis.inference.fitting import measured

MODEL = """
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody><body><joint name="j" type="hinge" axis="0 1 0"/>
    <inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/></body></worldbody>
  <actuator>{servo}</actuator>
</mujoco>
"""
VELOCITY = MODEL.format(servo='<velocity name="j" joint="j" kv="200"/>')
POSITION = MODEL.format(servo='<position name="j" joint="j" kp="2000" kv="200"/>')
PERIOD_S, SPEED, NOISE = 0.02, 0.2, 1e-3


def slow(servo, kind, told):
    """A robot whose drive makes 0.1 % less than it is told, first to last, and its model."""
    time_s = np.arange(0.0, 24.5, PERIOD_S)
    stamp_ns = np.round(time_s * 1e9).astype(np.int64)
    noise = np.random.default_rng(0).normal(0.0, NOISE, len(time_s))
    recording = Trajectory(
        name=str(kind),
        stamp_ns=stamp_ns,
        joint_names=("j",),
        velocity=None,
        effort=None,
        position=(0.999 * SPEED * time_s + noise)[:, None],
        command_kind=kind,
        command_stamp_ns=stamp_ns,
        command=told(time_s)[:, None],
    )
    return {kind: mujoco.MjSpec.from_string(servo)}, [recording]


def left(robot, windows_s):
    problem = prepared(all_segments(*robot, windows_s=windows_s))
    return len(problem.segments), measured(problem, ()).cost


def test_what_a_velocity_servo_loses_slowly_shows_on_the_whole_recording_alone():
    robot = slow(VELOCITY, CommandKind.VELOCITY, lambda time_s: np.full_like(time_s, SPEED))
    _, short = left(robot, SHORT)
    pieces, long = left(robot, LONG)
    assert pieces == 1
    assert short == pytest.approx(1.0, abs=0.15)
    assert long > 1.5


def test_a_position_servo_is_followed_for_six_seconds():
    robot = slow(POSITION, CommandKind.POSITION, lambda time_s: 0.999 * SPEED * time_s)
    assert left(robot, LONG)[0] == 4
