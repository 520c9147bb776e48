"""What changed between sets of recordings, on a pendulum that SciPy integrates."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.changes import _found_last, random_effects
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.search.sets import Course
from gfm.effects import EffectInstance, find_effect
from pendulum import LENGTH, MODEL, PERIOD_S, swung

NOISE = 3e-4
MODEL_WITH_FRICTION = MODEL.replace("armature", 'frictionloss="0.1" armature')
TOOL = 0.3


def dry(level):
    return lambda _q, v: -level * np.tanh(v / 1e-3)


def unmodelled(q, v):
    """A wave, and a friction that depends on the place, which no effect of the library says."""
    return -0.05 * np.sin(9.0 * q) - 0.1 * np.tanh(v / 0.3) * np.cos(3.0 * q)


def motion(seed, torque, size=0.25, **truth):
    time_s = np.arange(0.0, 12.0, PERIOD_S)
    rng = np.random.default_rng(seed)
    speeds, phases = rng.uniform(1.0, 5.0, 3), rng.uniform(0.0, 6.0, 3)
    waves = np.sin(np.outer(time_s, speeds) + phases).sum(axis=1)
    told = size * np.minimum(time_s, 1.0) * waves
    return swung(told, seed=seed, noise=NOISE, torque=torque, **truth)


def changes(*sets, model=MODEL):
    """What changed over sets: of each, what acts on its robot, and how it moves otherwise."""
    runs = [
        [motion(10 * k + i, torque, **truth) for i in range(2)]
        for k, (torque, truth) in enumerate(sets)
    ]
    *since, now = runs
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(model)}
    return diagnose(specs, now, [motion(99, sets[-1][0], **sets[-1][1])], since=since).changes


@pytest.mark.slow
def test_nothing_is_said_to_have_changed_where_nothing_did():
    told = changes((dry(0.2), {}), (dry(0.2), {}))
    assert told.sentence == "Nothing changed."
    assert [(a.effect, a.course) for a in told.amounts] == [("coulomb_friction", Course.REPEATS)]
    assert told.sets == (("run 0", "run 1"), ("run 10", "run 11"))


def test_of_two_ways_to_take_a_motor_off_its_link_the_later_one_is_asked_of_all_sets():
    def effect(name, joint, **values):
        return EffectInstance(effect=find_effect(name), joints=(joint,), values=values)

    first = [
        effect("joint_elasticity", "a", stiffness=9.0),
        effect("coulomb_friction", "a", torque=1.0),
    ]
    last = [effect("backlash", "a", gap=0.1), effect("backlash", "b", gap=0.2)]
    assert list(_found_last([*first, *last]).values()) == [first[1], *last]
    again = effect("backlash", "a", gap=0.3)
    assert list(_found_last([*last, again]).values()) == [last[1], again]


def test_nothing_changed_where_the_model_is_right_both_times():
    told = changes((dry(0.0), {}), (dry(0.0), {}))
    assert (told.sentence, told.amounts) == ("Nothing changed.", ())


@pytest.mark.slow
def test_a_friction_that_grew_is_told_with_its_share_of_all_friction():
    told = changes((dry(0.3), {}), (dry(0.42), {}), model=MODEL_WITH_FRICTION)
    (amount,) = told.amounts
    assert told.sentence == "Dry friction of j up by 40 % (0.3 -> 0.42 N m)."
    assert amount.already == 0.1
    for value, error, truth in zip(amount.values, amount.errors, (0.2, 0.32), strict=True):
        assert abs(value - truth) < 3.0 * error
    assert amount.low < 0.2 < 0.32 < amount.high


@pytest.mark.slow
def test_a_mass_at_the_tool_is_told_in_kilograms():
    def loaded(q, v):
        return dry(0.2)(q, v) - TOOL * 9.81 * LENGTH * np.sin(q)

    told = changes((dry(0.2), {}), (loaded, {"inertia": TOOL * LENGTH**2}))
    assert told.sentence == "0.30 kg more at the tool."
    courses = {a.effect: a.course for a in told.amounts}
    assert courses == {"coulomb_friction": Course.REPEATS, "payload": Course.CHANGES}


@pytest.mark.slow
def test_what_the_model_lacks_both_times_is_no_change():
    assert changes((unmodelled, {}), (unmodelled, {})).sentence == "Nothing changed."


@pytest.mark.slow
def test_what_earlier_motions_could_not_show_is_said_and_not_claimed():
    still = (lambda _q, _v: 0.0, {"size": 0.02})
    told = changes(still, (lambda _q, v: -0.3 * v * abs(v), {}))
    assert told.sentence == (
        "Nothing changed. Could not be seen in the earlier recordings: quadratic drag of j."
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("levels", "course", "sentence"),
    [
        ((0.2, 0.25, 0.3), Course.DRIFTS, "drifts: up by 50 % (0.2 -> 0.25 -> 0.3 N m)"),
        ((0.2, 0.3, 0.2), Course.CHANGES, "varies (0.2 -> 0.3 -> 0.2 N m)"),
        ((0.2, 0.2, 0.2), Course.REPEATS, ""),
    ],
)
def test_over_several_sets_amounts_repeat_drift_or_vary(levels, course, sentence):
    told = changes(*((dry(level), {}) for level in levels))
    (amount,) = told.amounts
    assert amount.course is course
    assert told.sentence == (f"Dry friction of j {sentence}." if sentence else "Nothing changed.")
    assert amount.low < min(levels) <= max(levels) < amount.high


def test_sets_that_agree_have_no_spread_and_count_by_their_exactness():
    mean, error, spread = random_effects(np.array([1.0, 1.0]), np.array([0.1, 0.2]))
    assert (mean, spread) == (pytest.approx(1.0), 0.0)
    assert error == pytest.approx((1 / 0.1**2 + 1 / 0.2**2) ** -0.5)


def test_the_spread_of_sets_that_are_exact_is_that_of_their_amounts():
    values = np.array([1.0, 2.0, 4.0])
    mean, error, spread = random_effects(values, np.full(3, 1e-6))
    assert mean == pytest.approx(values.mean())
    assert spread == pytest.approx(values.std(ddof=1))
    assert error == pytest.approx(spread / 3**0.5)


def test_a_set_that_does_not_show_an_amount_says_nothing_of_it():
    mean, _, spread = random_effects(np.array([5.0, 1.0]), np.array([np.inf, 0.1]))
    assert (mean, spread) == (pytest.approx(1.0), 0.0)
