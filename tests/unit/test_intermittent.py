"""What acts now and then only is found in the segments where it acts, and nothing else blamed."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.result import Verdict
from gfm.diagnosis.search.moves.intermittent import far_off
from pendulum import LENGTH, MODEL, PERIOD_S, swung

NOISE = 3e-4
#: Angle at which the tip touches the table, and the table's stiffness and damping.
TOUCHING_RAD, STIFFNESS, DAMPING = 0.35, 1e6, 1e3
SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}


def table(q, v):
    """Returns the torque of a table that keeps the tip from hanging down."""
    deep, arm = LENGTH * (np.cos(q) - np.cos(TOUCHING_RAD)), LENGTH * np.sin(q)
    pressing = STIFFNESS * deep - DAMPING * arm * v
    return max(pressing, 0.0) * arm if deep > 0.0 else 0.0


def friction(_q, v):
    return -0.3 * np.tanh(v / 1e-3)


def recording(seed, torque):
    """Returns a run above the table that dips below it twice."""
    time_s = np.arange(0.0, 16.0, PERIOD_S)
    rng = np.random.default_rng(seed)
    waves = np.sin(np.outer(time_s, rng.uniform(0.5, 3.0, 3)) + rng.uniform(0.0, 6.0, 3))
    dips = np.exp(-(((time_s % 8.0 - rng.uniform(3.0, 6.0)) / 0.3) ** 2))
    told = 0.9 + 0.12 * np.minimum(time_s, 1.0) * waves.sum(axis=1) - 0.9 * dips
    return swung(told, seed=seed, noise=NOISE, torque=torque, start=0.9)


def told_of(torque):
    runs = [recording(seed, torque) for seed in range(3)]
    return diagnose(SPECS, runs[:2], runs[2:])


def touching_rad(parameters):
    """Returns at which angle the named point is at the named height."""
    x, z, height = (parameters[name].value for name in ("x", "z", "height"))
    angles = np.linspace(0.1, 0.7, 60001)
    heights = x * np.sin(angles) + z * np.cos(angles)
    return angles[np.argmin(np.abs(heights - height))]


def test_a_table_that_the_model_lacks_is_named_and_its_height_found():
    told = told_of(table)
    assert [e.effect for e in told.effects] == ["surface_contact"]
    assert touching_rad(told.effects[0].parameters) == pytest.approx(TOUCHING_RAD, abs=0.01)
    assert told.verdict is Verdict.EXPLAINED
    assert told.effects[0].native
    assert "surface" in told.corrected_xml


@pytest.mark.slow
def test_friction_beside_a_table_is_found_and_nothing_stands_for_the_table():
    told = told_of(lambda q, v: table(q, v) + friction(q, v))
    assert {e.effect for e in told.effects} == {"coulomb_friction", "surface_contact"}


def test_no_segment_is_far_off_where_the_model_is_right():
    runs = [recording(seed, lambda _q, _v: 0.0) for seed in range(2)]
    noise = prepared(all_segments(SPECS, runs)).noise
    assert far_off(all_segments(SPECS, runs, noise), ()) == []
