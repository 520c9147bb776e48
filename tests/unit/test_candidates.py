"""What candidates are tried with: orders of a cogging torque, sizes of torques."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from disc import DISC, followed
from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.search.candidates import cogging_orders, joint_scales
from gfm.signals.torque_domain import torque_views
from gfm.signals.torques import TorqueView

TIME_S = np.arange(0.0, 12.0, 0.01)


def view(span, torque):
    """Returns a joint's way back and forth over `span`, and what is missing along it."""
    way = np.sin(1.7 * TIME_S) * np.sin(0.31 * TIME_S + 0.5)
    position = -1.2 + span * way / np.ptp(way)
    velocity = np.gradient(position, TIME_S)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(TIME_S))
    missing = torque(position, velocity) + noise
    return TorqueView(
        joints=("j",),
        position=position[:, None],
        velocity=velocity[:, None],
        drive=np.zeros((len(position), 1)),
        missing=missing[:, None],
        served=missing[:, None],
    )


def recorded(position, effort=None, *, time_s=TIME_S, commands=None, gain=1.0):
    """Returns a recording of a joint: told to do nothing, or to go to some angles, shape (C,)."""
    stamps = (1e9 * time_s).astype(np.int64)
    led = commands is not None
    return Trajectory(
        name="one",
        joint_names=("j",),
        stamp_ns=stamps,
        position=position,
        velocity=None,
        effort=effort,
        command_kind=CommandKind.POSITION if led else CommandKind.EFFORT,
        command_stamp_ns=stamps,
        command=commands[:, None] if led else np.zeros((len(time_s), 1)),
        servo_gain={"j": gain},
    )


def test_an_order_is_found_where_it_is_seen_to_repeat():
    """12 waves per turn over 0.7 rad: one period and a third. Over 0.42 rad it is any curve."""

    def wave(q, _v):
        return 1.9 * np.sin(12 * q - 1.0)

    assert 12 in cogging_orders(view(0.7, wave), 0)
    assert 12 not in cogging_orders(view(0.42, wave), 0)


@pytest.mark.parametrize("order", [15, 40])
def test_an_order_is_found_beside_a_spring_and_friction(order):
    def torque(q, v):
        return 0.3 * np.sin(order * q) - 20.0 * q - 0.5 * v - 0.4 * np.tanh(v / 0.01)

    assert order in cogging_orders(view(1.0, torque), 0)


def test_what_the_motion_does_not_cover_is_not_looked_for():
    seen = view(0.42, lambda q, _v: np.sin(8 * q))
    assert min(cogging_orders(seen, 0)) * 0.42 >= 0.75 * 2.0 * np.pi


def test_the_size_of_a_servo_is_what_was_measured_of_it():
    """A motion that takes ten times as much: another thing moved the joint."""
    position = np.sin(3.0 * TIME_S)[:, None]
    spec = mujoco.MjSpec.from_string(CARRIED.format(by_drive="false"))
    takes = (0.1 + 2.0 * 0.5**2) * 3.0**2
    held = recorded(position, effort=np.full_like(position, 0.1 * takes))
    problem = prepared(all_segments({CommandKind.EFFORT: spec}, [held]))
    for recording, size in ((held, 0.1 * takes), (replace(held, effort=None), takes)):
        (scales,) = joint_scales(problem, torque_views(problem, [recording]))
        assert scales.servo_nm == pytest.approx(size, rel=0.01)
        assert scales.peak_nm == pytest.approx(takes, rel=0.01)


WEIGHT_NM = 9.81 * 0.5 * 2.0
CARRIED = """
<mujoco><worldbody><body gravcomp="1"><joint name="j" axis="0 1 0" actuatorgravcomp="{by_drive}"/>
  <inertial pos="0.5 0 0" mass="2" diaginertia="0.1 0.1 0.1"/></body></worldbody>
<actuator><motor name="j" joint="j"/></actuator></mujoco>
"""


@pytest.mark.parametrize("by_drive", ["true", "false"])
def test_the_size_of_a_servo_leaves_out_what_its_gravity_compensation_gives(by_drive):
    """An arm held level by its compensation, and turned to and fro a little by its servo."""
    recording = recorded(0.01 * np.sin(3.0 * TIME_S)[:, None])
    spec = mujoco.MjSpec.from_string(CARRIED.format(by_drive=by_drive))
    problem = prepared(all_segments({CommandKind.EFFORT: spec}, [recording]))
    (scales,) = joint_scales(problem, torque_views(problem, [recording]))
    servo_nm = (0.1 + 2.0 * 0.5**2) * 0.01 * 3.0**2
    assert scales.servo_nm == pytest.approx(servo_nm, rel=0.05)
    borne = WEIGHT_NM if by_drive == "true" else 0.0
    assert scales.peak_nm == pytest.approx(borne + servo_nm, rel=0.05)


@pytest.mark.parametrize("gain", [1.0, 0.25, 2.0])
def test_a_right_model_lacks_no_torque(gain):
    """Of a servo commanded whenever it is measured: at its own gain, under the mean command."""
    period_s, inertia, kp, kv = 0.008, 0.05, 40.0, 4.0
    time_s = period_s * np.arange(1000.0)
    command = 0.6 * np.sin(2.0 * np.pi * 0.4 * time_s)
    servo = {"period_s": period_s, "inertia": inertia, "kv": kv}
    position, torque = followed(command, kp=gain * kp, **servo)
    recording = recorded(position, time_s=time_s, commands=command, gain=gain)
    text = DISC.format(step=0.002, integrator="RK4", inertia=inertia, kp=kp, kv=kv)
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(text)}
    (view,) = torque_views(prepared(all_segments(specs, [recording])), [recording])
    steady = slice(100, -100)  # smoothing has both sides
    stepped = np.std(torque[steady] - view.drive[steady])
    assert np.std(view.missing[steady]) < 0.2 * stepped
