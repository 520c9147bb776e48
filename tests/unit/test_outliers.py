"""What is far off counts little more than what is not."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from disc import DISC
from gfm.core import CommandKind
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.diagnosis.residuals.outliers import bounded, slopes, unbounded
from one_joint import TIME_S, problem

RESIDUAL = np.linspace(-30.0, 30.0, 241)


def test_what_is_not_outlying_counts_in_full():
    inside = RESIDUAL[np.abs(RESIDUAL) <= 2.0]
    np.testing.assert_array_equal(bounded(inside, 2.0), inside)
    np.testing.assert_array_equal(bounded(RESIDUAL, np.inf), RESIDUAL)


def test_squares_grow_with_the_logarithm_beyond_the_limit():
    found = bounded(RESIDUAL, 2.0)
    outlying = np.abs(RESIDUAL) > 2.0
    expected = 4.0 * (1.0 + 2.0 * np.log(np.abs(RESIDUAL[outlying]) / 2.0))
    np.testing.assert_allclose(found[outlying] ** 2, expected)
    np.testing.assert_array_equal(np.sign(found), np.sign(RESIDUAL))


def test_the_limit_is_passed_without_a_jump_or_a_kink():
    step = 1e-6
    below, at, above = bounded(np.array([2.0 - step, 2.0, 2.0 + step]), 2.0) ** 2
    assert (at - below) / step == pytest.approx(4.0, rel=1e-5)
    assert (above - at) / step == pytest.approx(4.0, rel=1e-5)


def test_each_number_may_have_its_own_limit():
    np.testing.assert_allclose(
        bounded(np.array([5.0, 5.0]), np.array([5.0, 1.0])),
        [5.0, np.sqrt(1.0 + 2.0 * np.log(5.0))],
    )


def left_by(size):
    """A servo at rest whose angle is off by so many times its noise; nobody turns it."""
    still = problem(np.zeros((len(TIME_S), 1)))
    off = np.full((len(TIME_S), 1), size * still.noise.position[0])
    disc = DISC.format(step=0.002, integrator="Euler", inertia=1.0, kp=9.0, kv=3.0)
    spec = mujoco.MjSpec.from_string(disc)
    segment = replace(still.segments[0], position=off)
    return replace(still, specs={CommandKind.POSITION: spec}, joints=("j",), segments=(segment,))


@pytest.mark.parametrize(("size", "limit"), [(10.0, 3.0 * 10.0), (2e-3, 3.0)])
def test_limits_follow_what_a_typical_segment_shows_and_never_cut_into_noise(size, limit):
    assert left_by(size).robust(()).outlying_from[0, 0] == pytest.approx(limit)


def test_an_initial_state_that_changes_nothing_explains_nothing():
    """As where simulations run away: all of them are cut off at the same size."""
    away = left_by(1e9)
    assert with_state_basis(away).state_basis[0].shape == (len(TIME_S), 0)
    near = left_by(1.0)
    assert with_state_basis(near).state_basis[0].shape == (len(TIME_S), 2)


def test_slopes_are_the_derivative_of_bounded_residuals():
    residual, limit, step = np.array([-40.0, -3.5, 0.0, 2.9, 5.0, 1e4]), 3.0, 1e-6
    measured = (bounded(residual + step, limit) - bounded(residual - step, limit)) / (2.0 * step)
    np.testing.assert_allclose(slopes(bounded(residual, limit), limit), measured, atol=1e-6)


def test_what_was_bounded_is_found_again():
    residual = np.array([-12.0, -3.5, 0.0, 2.9, 5.0])
    np.testing.assert_allclose(unbounded(bounded(residual, 3.0), 3.0), residual, rtol=1e-12)
