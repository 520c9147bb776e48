"""One thing that a model has too much of is a candidate beside those that it lacks."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.screening import weigh
from gfm.effects import EffectInstance, find_effect
from gfm.effects.nominal_parameters import KEPT, least_amounts, most_amounts
from gfm.effects.plugins import USUAL_SCALES
from pendulum import MODEL, PERIOD_S, ROTOR, swung

MODELS = Path(__file__).parents[2] / "models"
NOISE = 1e-4
#: What the model says of the joint's damping, and what there is of it.
SAID_DAMPING, DAMPING = 0.6, 0.2

SPECS = {
    CommandKind.POSITION: mujoco.MjSpec.from_string(
        MODEL.replace("armature=", f'damping="{SAID_DAMPING}" armature=')
    )
}
PLACE = Place(effect=find_effect("viscous_friction"), joints=("j",), scales=USUAL_SCALES)


def steps(seed):
    """Returns targets that step every second, 5 s."""
    levels = np.random.default_rng(seed).uniform(-0.5, 0.5, 5)
    return np.repeat(levels, round(1.0 / PERIOD_S))


def waves(seed):
    """Returns targets that swing, 5 s."""
    time_s = PERIOD_S * np.arange(500)
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, 3)
    pairs = zip((0.3, 0.8, 1.7), phases, strict=True)
    return sum(0.2 * np.sin(2.0 * np.pi * hertz * time_s + phase) for hertz, phase in pairs)


def recorded(told, seed):
    return swung(told, seed=seed, noise=NOISE, torque=lambda _q, v: -DAMPING * v, start=told[0])


@pytest.fixture(scope="module")
def runs():
    return [recorded(told, i) for i, told in enumerate((waves(1), steps(2), waves(3)))]


def test_a_damping_that_the_model_has_too_much_of_is_named_alone(runs):
    """A stiffer servo and a heavier rotor together would explain nearly as much."""
    found = diagnose(SPECS, runs[:2], runs[2:])
    (one,) = found.effects
    assert (one.effect, one.joints) == ("viscous_friction", ("j",))
    told = one.parameters["coefficient"]
    assert told.value == pytest.approx(DAMPING - SAID_DAMPING, rel=0.01)
    low, high = told.ci95
    assert low < DAMPING - SAID_DAMPING < high
    assert one.confidence > 0.8
    assert found.sentence.startswith("The model has too much viscous friction on j (")


def test_a_load_is_no_farther_out_than_the_largest_model_is_large():
    """The XL330's pendulum hangs 13 cm down from its axis, its disc included."""
    pendulum = mujoco.MjSpec.from_file(str(MODELS / "xl330_pendulum.xml"))
    arm = mujoco.MjSpec.from_file(str(MODELS / "sawyer_position.xml"))
    most = most_amounts([pendulum], find_effect("payload"))
    assert list(most) == ["com_x", "com_y", "com_z"]
    assert 0.26 < most["com_z"] < 0.52
    both = most_amounts([pendulum, arm], find_effect("payload"))
    assert both == most_amounts([arm], find_effect("payload"))
    assert both["com_z"] > 2.0
    assert most_amounts([pendulum], find_effect("armature")) == {}


def test_no_more_is_taken_off_than_every_model_has(runs):
    problem = prepared(all_segments(SPECS, runs[:1]))
    said, none = SPECS[CommandKind.POSITION], mujoco.MjSpec.from_string(MODEL)
    assert least_amounts([said], PLACE.effect, ["j"]) == {"coefficient": -SAID_DAMPING}
    assert least_amounts([said, none], PLACE.effect, ["j"]) == {}
    rotor = least_amounts([said], find_effect("armature"), ["j"])
    assert rotor == {"inertia": pytest.approx(-(1.0 - KEPT) * ROTOR)}
    assert least_amounts([said], find_effect("torque_offset"), ["j"]) == {}
    begun = EffectInstance(
        effect=PLACE.effect,
        joints=("j",),
        values={"coefficient": -0.1},
        least={"coefficient": -0.3},
    )
    (there,) = fit(problem, [begun]).effects
    assert there.values["coefficient"] == pytest.approx(-0.3)


def test_what_would_have_to_be_less_is_a_candidate_only_where_there_is_some():
    probe = EffectInstance(effect=PLACE.effect, joints=("j",), values={"coefficient": 0.01})
    column = np.ones((5, 1))
    room = replace(PLACE, least={"coefficient": -0.6})
    for residual, least, taken in ((-20.0, room, -0.2), (-90.0, room, -0.6), (20.0, room, 0.2)):
        instance, explained = weigh(least, [probe], column, residual * column[:, 0])
        assert instance.values["coefficient"] == pytest.approx(taken)
        assert instance.least == least.least
        # How much taking off explains, first order does not tell.
        np.testing.assert_allclose(explained, max(residual, 0.0))
    assert weigh(PLACE, [probe], column, -20.0 * column[:, 0]) is None
