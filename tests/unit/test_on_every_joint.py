"""What acts on every joint, each by itself, against a delay that all of them share.

Discs behind servos, no gravity: linear, so that exact steps follow from a matrix exponential.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.linalg import expm

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Verdict

JOINTS = ("a", "b")
ROWS = [("a", 20.0, 1.0, 0.03), ("b", 12.0, 0.8, 0.02)]
NOISE, STEP_S, EVERY, PERIOD_S = 2e-4, 0.002, 5, 0.01
DISC = """
<body>
  <joint name="{0}" axis="0 0 1"/>
  <inertial pos="0 0 0" mass="1" diaginertia="{3} {3} {3}"/>
</body>
"""
SERVO = '<position name="{0}" joint="{0}" kp="{1}" kv="{2}"/>'


def specs():
    bodies = "".join(DISC.format(*row) for row in ROWS)
    servos = "".join(SERVO.format(*row) for row in ROWS)
    xml = f"<mujoco><worldbody>{bodies}</worldbody><actuator>{servos}</actuator></mujoco>"
    return {CommandKind.POSITION: mujoco.MjSpec.from_string(xml)}


def turned(told, row, lag_s, friction):
    """Returns the angles of one disc at every `STEP_S`, shape (T,): state (q, v, lagged, told)."""
    _, kp, kv, inertia = row
    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1, :2] = -kp / inertia, -(kv + friction) / inertia
    system[1, 2 if lag_s else 3] = kp / inertia
    if lag_s:
        system[2, 2:] = -1.0 / lag_s, 1.0 / lag_s
    step, state, angles = expm(system * STEP_S), np.zeros(4), []
    for now in told:
        angles.append(state[0])
        state = step @ np.array([*state[:3], now])
    return np.array(angles)


def recorded(seed, *, lag_s=(0.0, 0.0), delay_s=0.0, friction=(0.0, 0.0), duration_s=5.0):
    """Returns a recording of the discs."""
    rng = np.random.default_rng(seed)
    count = len(ROWS)
    time_s = np.arange(0.0, duration_s, PERIOD_S)
    speeds, phases = rng.uniform(1.0, 9.0, (3, count)), rng.uniform(0.0, 6.0, (3, count))
    waves = np.sin(time_s[:, None, None] * speeds + phases).sum(axis=1)
    commands = 0.2 * np.minimum(time_s, 1.0)[:, None] * waves
    told = np.repeat(commands, EVERY, axis=0)
    late = round(delay_s / STEP_S)
    told = np.concatenate([np.zeros((late, count)), told[: len(told) - late]])
    rows = zip(ROWS, lag_s, friction, strict=True)
    angles = np.stack([turned(told[:, j], *row) for j, row in enumerate(rows)], axis=1)[::EVERY]
    stamps = np.arange(len(angles)) * round(1e9 * PERIOD_S)
    return Trajectory(
        name=f"run{seed}",
        joint_names=JOINTS,
        stamp_ns=stamps,
        position=angles + NOISE * rng.standard_normal(angles.shape),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamps,
        command=commands,
    )


def found_in(**effects):
    runs = [recorded(seed, **effects) for seed in range(3)]
    return diagnose(specs(), runs[:2], runs[2:])


def test_lags_on_every_joint_are_not_taken_for_a_delay():
    lag_s = (0.03, 0.04)
    found = found_in(lag_s=lag_s)
    assert found.verdict is Verdict.EXPLAINED
    named = {one.joints: one for one in found.effects}
    assert {one.effect for one in found.effects} == {"actuator_lag"}
    assert set(named) == {("a",), ("b",)}
    for joint, truth in zip(JOINTS, lag_s, strict=True):
        told = named[joint,].parameters["time_constant"]
        assert told.value == pytest.approx(truth, rel=0.01)
        assert named[joint,].confidence > 0.8


@pytest.mark.slow
def test_a_delay_beside_friction_is_not_taken_for_lags():
    found = found_in(delay_s=0.024, friction=(0.0, 0.3))
    assert {(one.effect, one.joints) for one in found.effects} == {
        ("command_delay", JOINTS),
        ("viscous_friction", ("b",)),
    }
    delay = next(one for one in found.effects if one.effect == "command_delay")
    assert delay.parameters["delay"].value == pytest.approx(0.024, rel=0.01)


@pytest.mark.slow
def test_a_delay_beside_friction_on_every_joint_is_not_taken_for_lags():
    friction = (0.4, 0.3)
    found = found_in(delay_s=0.024, friction=friction)
    named = {(one.effect, one.joints): one for one in found.effects}
    assert set(named) == {
        ("command_delay", JOINTS),
        ("viscous_friction", ("a",)),
        ("viscous_friction", ("b",)),
    }
    for joint, truth in zip(JOINTS, friction, strict=True):
        told = named["viscous_friction", (joint,)].parameters["coefficient"]
        assert told.value == pytest.approx(truth, rel=0.03)
