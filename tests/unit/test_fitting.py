"""Amounts that leave least, and how sure a fit is of them, on problems in closed form."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from gfm.diagnosis.inference.amounts import acting, amounts, at_bound, bounds_of
from gfm.diagnosis.inference.fitting import (
    LeastSquares,
    by_simplex,
    derivatives,
    fit,
    measured,
    times_each,
    without_some,
)
from gfm.diagnosis.inference.intervals import half_widths
from gfm.effects import effect_library
from one_joint import instance


@dataclass(frozen=True)
class Regression(LeastSquares):
    """Least squares whose columns are those of the effects' amounts, in their order."""

    measured: np.ndarray
    columns: dict[str, np.ndarray]

    def residuals(self, candidates):
        return np.stack([self.measured - sum(self._told(e) for e in c) for c in candidates])

    def _told(self, effect):
        return self.columns[effect.effect.name] * next(iter(effect.values.values()))


def pairs(candidates):
    """Returns the first amounts of two effects, for every candidate."""
    return [[next(iter(one.values.values())) for one in effects] for effects in candidates]


@dataclass(frozen=True)
class Stairs(LeastSquares):
    """Steps down to a peak of friction of 0.3 N m and 0.1 rad/s, and to a level of 0.2 N m."""

    def residuals(self, candidates):
        truth = {"static_excess": 0.3, "stribeck_velocity": 0.1, "torque": 0.2, "coefficient": 0.1}
        return np.array(
            [
                [
                    np.ceil(100.0 * abs(np.log(value / truth[name])))
                    for one in candidate
                    for name, value in one.values.items()
                ]
                for candidate in candidates
            ]
        )


@dataclass(frozen=True)
class Tilted(LeastSquares):
    """A sine of one tilt and a cosine of another, which first order sends to its bound."""

    def residuals(self, candidates):
        return np.stack([self._left(*tilts.values.values()) for (tilts,) in candidates])

    def _left(self, tilt_x, tilt_y):
        pull = 30.0 * np.cos(tilt_x) * np.sin(np.linspace(-0.5, 0.5, 50) + tilt_y)
        return pull - 30.0 * np.sin(np.linspace(-0.5, 0.5, 50) + 0.3)


@dataclass(frozen=True)
class Rough(LeastSquares):
    """What a play does, smooth on the whole; impacts come earlier or later by chance."""

    def residuals(self, candidates):
        rows = np.arange(400.0)
        gaps = [next(iter(one.values.values())) for (one,) in candidates]
        return np.stack([1000.0 * (g - 0.02) + np.sin(rows**2 + g / 2e-5) for g in gaps])


def friction(torque):
    return instance("coulomb_friction", torque=torque)


def viscous(coefficient):
    return instance("viscous_friction", coefficient=coefficient)


@pytest.fixture
def regression():
    rng = np.random.default_rng(0)
    dry, damped = rng.standard_normal((2, 200))
    noise = 0.01 * rng.standard_normal(200)
    columns = {"coulomb_friction": dry, "viscous_friction": damped}
    return Regression(0.3 * dry + 0.7 * damped + noise, columns)


def test_a_linear_problem_is_solved_as_by_normal_equations(regression):
    found = fit(regression, [friction(0.1), viscous(0.1)])
    columns = np.stack(list(regression.columns.values()), axis=1)
    exact = np.linalg.lstsq(columns, regression.measured, rcond=None)[0]
    np.testing.assert_allclose(amounts(found.effects), exact, rtol=1e-5)
    np.testing.assert_allclose(found.jacobian, -columns, atol=1e-9)
    assert found.cost == pytest.approx(np.mean((regression.measured - columns @ exact) ** 2))


def test_a_fit_does_not_go_beyond_its_bounds(regression):
    """No friction drives: where less than none would fit best, there is none."""
    backward = Regression(-regression.measured, regression.columns)
    found = fit(backward, [friction(0.1), viscous(0.1)])
    np.testing.assert_allclose(amounts(found.effects), 0.0, atol=1e-12)
    assert (amounts(found.effects) >= 0.0).all()


@pytest.mark.parametrize("tilt_x", [0.0, 1e-4, -1e-4])
def test_a_step_that_was_led_astray_teaches_how_far_first_order_holds(tilt_x):
    begun = instance("gravity_direction", tilt_x=tilt_x, tilt_y=0.0)
    found = fit(Tilted(), (begun,))
    assert found.cost < 0.2 * measured(Tilted(), (begun,)).cost
    assert abs(found.effects[0].values["tilt_x"]) < 0.3
    local = derivatives(Tilted(), found.effects, found.residual)
    np.testing.assert_allclose(found.jacobian, local)


def test_without_effects_the_nominal_model_is_left(regression):
    for found in (fit(regression, ()), measured(regression, ())):
        assert found.effects == ()
        assert found.jacobian.shape == (200, 0)
        np.testing.assert_array_equal(found.residual, regression.measured)


def test_a_simplex_goes_on_where_derivatives_of_a_peak_of_friction_tell_nothing():
    peak = instance("stribeck_friction", static_excess=0.315, stribeck_velocity=0.103)
    level, other = friction(0.19), viscous(0.09)
    stuck = measured(Stairs(), [level, peak, other])
    found = by_simplex(Stairs(), stuck)
    *near, still = amounts(found.effects)
    np.testing.assert_allclose(near, [0.2, 0.3, 0.1], rtol=0.02)
    assert still == 0.09  # derivatives are asked for what is not rugged


def test_without_a_rugged_effect_no_simplex_is_needed(regression):
    found = fit(regression, [friction(0.1)])
    assert by_simplex(regression, found) is found


def test_others_make_up_for_what_is_left_out_as_a_fit_without_it_would(regression):
    found = fit(regression, [friction(0.1), viscous(0.1)])
    *singles, both = without_some(regression, found, [(0,), (1,), (0, 1)])
    for told in singles:
        exact = fit(regression, told.effects)
        np.testing.assert_allclose(amounts(told.effects), amounts(exact.effects), rtol=2e-3)
        assert told.cost == pytest.approx(exact.cost, rel=1e-3)
        assert told.jacobian.shape == (len(told.residual), 1)
    assert both.effects == ()
    np.testing.assert_array_equal(both.residual, regression.measured)
    assert without_some(regression, found, []) == []


@pytest.mark.parametrize(
    ("excess", "speed", "expected"), [(0.5, 0.05, False), (0.5, 5.0, True), (0.0, 0.05, True)]
)
def test_a_value_at_its_bound_has_not_been_found(excess, speed, expected):
    stribeck = instance("stribeck_friction", static_excess=excess, stribeck_velocity=speed)
    assert at_bound(stribeck) is expected


def test_where_a_model_allows_for_less_a_fit_looks_no_further_and_ends_at_that_bound(regression):
    within = replace(friction(0.02), most={"torque": 0.05})
    (found,) = fit(regression, [within]).effects
    assert amounts([found]) == pytest.approx([0.05])
    assert at_bound(found)
    assert not at_bound(within)
    assert [end.tolist() for end in bounds_of([within])] == [[0.0], [0.05]]
    load = instance("payload", mass=1.0, com_x=0.0, com_y=0.1, com_z=-0.3)
    low, high = bounds_of([replace(load, most={"com_z": 0.4})])
    assert (low[3], high[3], low[1]) == (-0.4, 0.4, -2.0)


@pytest.mark.parametrize(("lag_s", "expected"), [(5e-5, True), (5e-4, False)])
def test_a_lag_shorter_than_any_stamp_is_exact_has_not_been_found(lag_s, expected):
    assert at_bound(instance("actuator_lag", time_constant=lag_s)) is expected


def test_an_effect_of_which_a_fit_left_nothing_does_not_act():
    none, some = friction(0.0), friction(1e-4)
    less = viscous(-0.1)  # taken off what the model has
    short = instance("command_delay", delay=1e-5)  # than any stamp is exact
    assert acting([none, some, less, short]) == (some, less)


def test_a_phase_is_told_within_half_a_turn():
    cogging = effect_library()["cogging_torque"]
    told = cogging.canonical({"amplitude": 1.0, "per_revolution": 24.0, "phase": -3.58})
    assert told["phase"] == pytest.approx(2.0 * np.pi - 3.58)


def test_intervals_cover_the_truth_about_as_often_as_they_say():
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(300):
        columns = rng.standard_normal((600, 2))
        truth, noise = np.array([1.0, -2.0]), rng.standard_normal(600)
        told = columns @ truth + noise
        found = np.linalg.lstsq(columns, told, rcond=None)[0]
        widths = half_widths(found, -columns, told - columns @ found, [slice(0, 600)])
        covered.extend(np.abs(found - truth) < widths)
    assert 0.92 < np.mean(covered) < 0.98


def test_errors_that_last_through_a_segment_make_intervals_wider():
    rng = np.random.default_rng(0)
    segments = [slice(60 * i, 60 * (i + 1)) for i in range(10)]
    ways = {"blocks": {}, "whole": {"whole": True}, "one each": {"blocks": 1}}
    covered = {way: [] for way in ways}
    for _ in range(300):
        columns = np.repeat(rng.standard_normal((10, 2)), 60, axis=0)
        columns += 0.3 * rng.standard_normal((600, 2))
        lasting = np.repeat(rng.standard_normal(10), 60)
        told = columns @ np.array([1.0, -2.0]) + lasting + 0.3 * rng.standard_normal(600)
        found = np.linalg.lstsq(columns, told, rcond=None)[0]
        for way, hits in covered.items():
            left = told - columns @ found
            widths = half_widths(found, -columns, left, segments, **ways[way])
            hits.extend(np.abs(found - np.array([1.0, -2.0])) < widths)
    assert np.mean(covered["blocks"]) < 0.8
    assert 0.9 < np.mean(covered["whole"]) < 0.99
    assert 0.83 < np.mean(covered["one each"]) < 0.95  # of ten, as if there were many


def test_what_the_residual_does_not_depend_on_has_no_interval():
    columns = np.random.default_rng(0).standard_normal((600, 2)) * np.array([1.0, 0.0])
    seen, unseen = half_widths(np.ones(2), columns, np.ones(600), [slice(0, 600)])
    assert np.isfinite(seen)
    assert unseen == np.inf


def test_derivatives_at_hand_are_not_taken_anew_and_lead_to_the_same_amounts(regression):
    known = fit(regression, [friction(0.1)])
    moved = []

    class Counted(Regression):
        def coarse(self):
            return Coarse(self.measured, self.columns)

    class Coarse(Regression):
        def residuals(self, candidates):
            moved.extend(candidates)
            return super().residuals(candidates)

    counted = Counted(regression.measured, regression.columns)
    both = [friction(0.1), viscous(0.1)]
    told = fit(counted, both, known=known)
    with_known, moved[:] = len(moved), []
    anew = fit(counted, both)
    assert amounts(told.effects) == pytest.approx(amounts(anew.effects), rel=1e-6)
    assert told.jacobian == pytest.approx(anew.jacobian, abs=1e-6)
    # One of two amounts is moved beside the one still, and in the end it is asked whether what was
    # at hand holds.
    assert (with_known - 2) * 3 == len(moved) * 2


def test_derivatives_at_hand_that_mislead_are_taken_anew(regression):
    known = fit(regression, [friction(0.1)])
    misleading = replace(known, jacobian=0.1 * known.jacobian)  # steps ten times too long
    told = fit(regression, [friction(0.1), viscous(0.1)], known=misleading)
    assert amounts(told.effects) == pytest.approx([0.3, 0.7], abs=0.01)


@dataclass(frozen=True)
class Product(LeastSquares):
    """One amount counts as much as there is of the other, as a centre of mass and a mass do."""

    def residuals(self, candidates):
        return np.array([[x * y - 0.3, 0.1 * (x - 0.6)] for x, y in pairs(candidates)])


def test_derivatives_at_hand_of_what_has_changed_meanwhile_are_taken_anew():
    gain, viscosity = (
        instance("actuator_gain", scale=0.4),
        instance("viscous_friction", coefficient=0.2),
    )
    known = measured(Product(), [gain, viscosity])
    told = fit(Product(), [gain, viscosity], known=known, tolerance=1e-2)
    assert told.cost == pytest.approx(0.0, abs=1e-9)
    assert told.jacobian == pytest.approx(np.array([[0.5, 0.6], [0.1, 0.0]]), abs=1e-2)


@dataclass(frozen=True)
class Arc(LeastSquares):
    """From 1.39 on either side, a step of Gauss and Newton ends as far off on the other side."""

    def residuals(self, candidates):
        return np.array([[np.arctan(e.values["torque"])] for (e,) in candidates])


@pytest.mark.parametrize("begun", np.linspace(1.35, 1.45, 11))
def test_a_step_that_gains_little_of_what_it_promised_is_not_the_last(begun):
    fitted = fit(Arc(), [instance("torque_offset", torque=begun)], tolerance=1e-2)
    assert amounts(fitted.effects) == pytest.approx([0.0], abs=0.05)


@pytest.mark.parametrize("begun", [0.008, 0.016, 0.032])
def test_derivatives_by_a_play_are_taken_over_more_than_chance_makes_of_it(begun):
    fitted = fit(Rough(), [instance("backlash", gap=begun)])
    assert fitted.effects[0].values["gap"] == pytest.approx(0.02, rel=0.05)


@dataclass(frozen=True)
class Banana(LeastSquares):
    """Rosenbrock's valley: steps that lead nowhere come between those that lead along it."""

    def residuals(self, candidates):
        rows = []
        for x, y in pairs(candidates):
            rows.append([10.0 * (y - x * x), x - 1.0, 0.0])
        return np.array(rows)


def test_steps_that_lead_nowhere_do_not_count():
    begun = [instance("actuator_gain", scale=2.0), instance("viscous_friction", coefficient=2.0)]
    fitted = fit(Banana(), begun)
    assert amounts(fitted.effects) == pytest.approx([1.0, 1.0], rel=0.02)


def test_columns_explain_together_what_they_were_made_of():
    columns = np.random.default_rng(0).standard_normal((200, 3))
    np.testing.assert_allclose(
        times_each(columns, columns @ [2.0, 0.0, -1.0]), [2.0, 0.0, -1.0], atol=1e-9
    )


def test_a_column_that_is_tiny_beside_the_others_explains_nothing():
    rng = np.random.default_rng(0)
    columns = rng.standard_normal((200, 2)) * [1e-2, 1.0]
    times = times_each(columns, 3.0 * columns[:, 1] + rng.standard_normal(200))
    assert times[0] == 0.0
    assert times[1] == pytest.approx(3.0, abs=0.3)
    np.testing.assert_array_equal(times_each(np.zeros((9, 1)), np.ones(9)), [0.0])
