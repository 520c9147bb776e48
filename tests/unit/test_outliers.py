"""What is far off counts little more than what is not."""

import numpy as np
import pytest

from gfm.diagnosis.residuals.outliers import bounded, slopes

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


def test_slopes_are_the_derivative_of_bounded_residuals():
    residual, limit, step = np.array([-40.0, -3.5, 0.0, 2.9, 5.0, 1e4]), 3.0, 1e-6
    measured = (bounded(residual + step, limit) - bounded(residual - step, limit)) / (2.0 * step)
    np.testing.assert_allclose(slopes(residual, limit), measured, atol=1e-6)
