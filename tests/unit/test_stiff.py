"""A servo that is so stiff beside its link that inertia does not count: closed form, no steps.

Between two commands kv q' = kp (u - q) - friction while it turns, and nothing while that holds it.
"""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from disc import DISC
from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Verdict

KP, KV, INERTIA, FRICTION, NOISE = 200.0, 10.0, 1e-4, 3.0, 2e-4
PERIOD_S, PER_COMMAND = 0.01, 2
SPECS = {
    CommandKind.POSITION: mujoco.MjSpec.from_string(
        DISC.format(step=0.002, integrator="implicitfast", inertia=INERTIA, kp=KP, kv=KV)
    )
}


def turned(commands, friction):
    """Returns angles at every measurement, shape (T,)."""
    angles, q = [], commands[0]
    share = -np.expm1(-KP / KV * PERIOD_S)
    for u in np.repeat(commands, PER_COMMAND):
        angles.append(q)
        beyond = max(abs(KP * (u - q)) - friction, 0.0) / KP
        q += share * np.sign(u - q) * beyond
    return np.array(angles)


def recorded(seed, friction, duration_s=4.0):
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, duration_s, PERIOD_S * PER_COMMAND)
    waves = np.sin(np.outer(time_s, rng.uniform(1.0, 6.0, 3)) + rng.uniform(0.0, 6.0, 3))
    commands = 0.2 * np.minimum(time_s, 1.0) * waves.sum(axis=1)
    angles = turned(commands, friction)
    stamps = np.arange(len(angles)) * round(1e9 * PERIOD_S)
    return Trajectory(
        name=f"run{seed}",
        joint_names=("j",),
        stamp_ns=stamps,
        position=(angles + NOISE * rng.standard_normal(len(angles)))[:, None],
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamps[::PER_COMMAND],
        command=commands[:, None],
    )


def test_friction_beside_a_servo_that_is_too_stiff_for_any_step_is_named():
    runs = [recorded(seed, FRICTION) for seed in range(3)]
    found = diagnose(SPECS, runs[:2], runs[2:])
    (named,) = found.effects
    assert named.effect == "coulomb_friction"
    assert named.confidence > 0.9
    low, high = named.parameters["torque"].ci95
    assert low < FRICTION < high
    assert named.parameters["torque"].value == pytest.approx(FRICTION, rel=0.01)
    assert found.error.after < 1.1 * NOISE < found.error.before
    assert any("`discrete` integrator" in note for note in found.notes)
    corrected = mujoco.MjSpec.from_string(found.corrected_xml)
    assert corrected.option.integrator == mujoco.mjtIntegrator.mjINT_DISCRETE


def test_nothing_is_named_beside_such_a_servo_where_nothing_is_missing():
    runs = [recorded(seed, 0.0) for seed in range(3)]
    found = diagnose(SPECS, runs[:2], runs[2:])
    assert found.verdict is Verdict.NO_GAP
    assert found.effects == ()
