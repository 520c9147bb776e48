"""The pictures of effects, on a pendulum that SciPy integrates: nothing of it is MuJoCo's."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.evidence.plots import MISFIT, law_plots, profile_plots
from gfm.diagnosis.output.result import (
    ErrorSummary,
    NamedEffect,
    ParameterEstimate,
    Suspect,
    Verdict,
)
from gfm.diagnosis.output.sentences import effects_in_words, sentence_on
from gfm.effects import EffectInstance, effect_library
from pendulum import MODEL, PERIOD_S, swung

FRICTION, GAIN, DELAY_S = 0.2, 0.15, 0.03


@pytest.fixture(scope="module")
def runs():
    stamps = np.arange(0.0, 6.0, PERIOD_S)
    command = 0.25 * np.minimum(stamps, 1.0) * (np.sin(3.1 * stamps) + np.sin(1.3 * stamps))

    def dry(_q, v):
        return -FRICTION * np.tanh(v / 1e-3)

    return [swung(command, seed=3, noise=1e-4, torque=dry, delay=DELAY_S, gain=GAIN)]


@pytest.fixture(scope="module")
def problem(runs):
    return prepared(all_segments({CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}, runs))


def instance(name, *joints, **values):
    return EffectInstance(effect=effect_library()[name], joints=joints or ("j",), values=values)


TRUTH = (
    instance("command_delay", delay=DELAY_S),
    instance("actuator_gain", scale=GAIN),
    instance("coulomb_friction", torque=FRICTION),
)


def test_the_picture_of_a_law_has_the_other_effects_in_its_model(problem, runs):
    """A servo seven times too stiff in the model would hide a friction of any size."""
    (plot,) = law_plots(TRUTH, problem, runs)
    points, law = plot.series
    moving = np.abs(points.x) > 0.1
    assert plot.title.endswith("lacks without it, the other effects in it")
    np.testing.assert_allclose(np.abs(law.y[moving]), FRICTION, rtol=1e-6)
    assert np.median(np.abs(points.y - law.y)[moving]) < 0.05 * FRICTION

    (alone,) = law_plots(TRUTH[2:], problem, runs)
    assert np.median(np.abs(alone.series[0].y - alone.series[1].y)[moving]) > 2.0 * FRICTION


def test_friction_that_grows_with_the_load_is_one_line_whichever_way_the_joint_moves(problem, runs):
    (plot,) = law_plots([instance("load_dependent_friction", coefficient=0.3)], problem, runs)
    law = plot.series[1]
    np.testing.assert_allclose(law.y, 0.3 * law.x, rtol=1e-3)


def test_the_profile_of_an_amount_has_its_valley_where_it_was_fitted(problem):
    delay, gain = profile_plots(TRUTH, problem)
    assert (delay.effect, gain.effect) == ("command_delay", "actuator_gain")
    for plot, none in ((delay, 0.0), (gain, 0.5 * GAIN)):
        line, point = plot.series
        assert plot.y_label == MISFIT
        assert line.x[0] == none
        assert line.x[np.argmin(line.y)] == point.x[0]
        assert point.y[0] < 2.0
        assert line.y[0] > 3.0 * point.y[0]


def named(effect, joint, **values):
    return NamedEffect(
        effect=effect,
        joints=(joint,),
        parameters={
            n: ParameterEstimate(value=v, unit="N m", ci95=None) for n, v in values.items()
        },
        confidence=0.9,
        native=True,
    )


def test_one_effect_on_several_joints_is_one_phrase():
    both = [named("coulomb_friction", "a", torque=0.2), named("coulomb_friction", "b", torque=0.35)]
    assert effects_in_words([*both, named("torque_offset", "b", torque=0.1)]) == [
        "coulomb friction on a, b (torque 0.2 to 0.35 N m)",
        "torque offset on b (torque 0.1 N m)",
    ]
    alike = [named("torque_offset", "a", torque=0.1), named("torque_offset", "b", torque=0.10001)]
    assert effects_in_words(alike) == ["torque offset on a, b (torque 0.1 N m)"]


def test_what_the_model_has_too_much_of_is_said_apart():
    error = ErrorSummary(before=0.1, after=0.05, noise_floor=0.001)
    less = NamedEffect(
        effect="armature",
        joints=("a",),
        parameters={"inertia": ParameterEstimate(value=-0.02, unit="kg m^2", ci95=None)},
        confidence=0.4,
        native=True,
    )
    both = [named("coulomb_friction", "a", torque=0.2), less]
    words = sentence_on(Verdict.PARTLY_EXPLAINED, both, error, "")
    assert "coulomb friction on a (torque 0.2 N m); it has too much armature on a" in words
    assert "(inertia -0.02 kg m^2)" in words
    assert "misses, among what stays unexplained, coulomb friction" in words
    assert "too much" not in sentence_on(Verdict.EXPLAINED, both[:1], error, "")
    alone = sentence_on(Verdict.EXPLAINED, [less], error, "")
    assert alone.startswith("The model has too much armature on a (inertia -0.02 kg m^2) (held-out")


def test_a_sentence_without_a_name_tells_the_doubtful_ones():
    error = ErrorSummary(before=0.3, after=0.3, noise_floor=0.001)
    lost = Suspect(effect="armature", joints=("elbow",), reason="")
    doubtful = replace(lost, effect="encoder_offset", confidence=0.448)
    told = sentence_on(Verdict.UNEXPLAINED, (), error, "", [doubtful, lost])
    assert "no name for it is more likely right than wrong: encoder offset on elbow (45%)" in told
    assert "armature" not in told
    assert "no known effect explains" in sentence_on(Verdict.UNEXPLAINED, (), error, "", [lost])


def test_a_sentence_tells_of_what_state_a_law_without_a_name_is():
    error = ErrorSummary(before=0.3, after=0.1, noise_floor=0.001)
    law = "position of elbow"
    spring = Suspect(effect="joint_spring", joints=("elbow",), reason="", nameless=law)
    both = [replace(spring, confidence=0.1), replace(spring, effect="cogging_torque")]
    told = sentence_on(Verdict.UNEXPLAINED, (), error, "", both)
    misses = f"misses a law of the {law} that no known effect explains"
    assert told.startswith(f"The model {misses} (held-out")
    friction = [named("coulomb_friction", "a", torque=0.2)]
    beside = sentence_on(Verdict.PARTLY_EXPLAINED, friction, error, "", both)
    assert f"coulomb friction on a (torque 0.2 N m); it also {misses} (held-out" in beside


def test_of_many_amounts_a_sentence_tells_the_first():
    place = {"height": 0.1, "x": 0.2, "y": 0.3, "z": 0.4, "friction": 0.5}
    (words,) = effects_in_words([named("surface_contact", "b", **place)])
    assert words.startswith("surface contact on b (height 0.1")
    assert "x 0.2" in words
    assert words.endswith(", ...)")
    assert "friction" not in words
