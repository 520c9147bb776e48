"""States from measured positions: smooth ones, and whether a joint rests at first."""

import numpy as np
import pytest

from gfm.signals.smoothing import rms, smooth_states, starts_at_rest

TIME_S = 0.01 * np.arange(40.0)


def test_smooth_states_are_the_derivatives_of_a_smooth_motion():
    time_s = np.arange(0.0, 3.0, 0.01)
    q, v, a = smooth_states(time_s, np.sin(2.0 * time_s)[:, None])
    inner = slice(10, -10)
    assert q[inner, 0] == pytest.approx(np.sin(2.0 * time_s)[inner], abs=1e-4)
    assert v[inner, 0] == pytest.approx(2.0 * np.cos(2.0 * time_s)[inner], abs=5e-3)
    assert a[inner, 0] == pytest.approx(-4.0 * np.sin(2.0 * time_s)[inner], abs=2e-2)


def test_a_joint_rests_where_its_slope_is_noise():
    noise = 1e-4
    still = noise * np.random.default_rng(0).standard_normal(len(TIME_S))
    moving = still + 0.01 * TIME_S
    resting = starts_at_rest(TIME_S, np.stack([still, moving], axis=1), np.full(2, noise))
    assert resting.tolist() == [True, False]


@pytest.mark.parametrize("parts", [[], [np.empty((0, 3))]], ids=["no arrays", "an empty one"])
def test_nothing_has_no_root_mean_square(parts):
    assert np.isnan(rms(parts))
