"""Noise is what is left of a measurement when nothing smooth is, and is there at all times."""

import numpy as np
import pytest

from gfm.core.noise import noise_std, steady_noise, typical_noise
from gfm.core.rounding import resolution


def test_noise_is_measured_under_a_smooth_motion():
    time_s = np.arange(0.0, 10.0, 0.01)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(time_s))
    told = noise_std(time_s, (np.sin(3.0 * time_s) + noise)[:, None])
    assert told == pytest.approx(1e-3, rel=0.1)


def test_a_loop_that_rings_as_fast_as_it_is_sampled_is_no_noise():
    time_s = np.arange(0.0, 20.0, 0.01)
    white = 1e-4 * np.random.default_rng(0).standard_normal((len(time_s), 2))
    rings = (time_s % 4.0 < 3.0) * 2e-3 * np.sin(2.0 * np.pi * 42.0 * time_s)
    run = time_s, white + np.sin(time_s)[:, None] + np.stack([rings, 0.0 * rings], axis=1)
    assert typical_noise([run])[0] > 1e-3
    assert steady_noise([run])[0] < 2e-4
    assert (
        steady_noise([run])[1]
        == pytest.approx(typical_noise([run])[1])
        == pytest.approx(1e-4, rel=0.1)
    )


def test_rests_that_rounding_makes_silent_are_no_noise_floor():
    time_s = np.arange(0.0, 20.0, 0.01)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(time_s))
    moving = time_s % 4.0 < 3.0
    values = np.round((moving * (np.sin(3.0 * time_s) + noise)) / 1e-4)[:, None] * 1e-4
    run = time_s, values
    assert noise_std(time_s[300:400], values[300:400]) == pytest.approx(1e-9)
    assert steady_noise([run]) == pytest.approx(typical_noise([run]))


def test_rounding_is_a_floor_of_the_noise():
    time_s = np.arange(0.0, 10.0, 0.01)
    rounded = (np.round(np.sin(0.3 * time_s) / 1.5e-3) * 1.5e-3)[:, None]
    assert resolution(rounded) == pytest.approx(1.5e-3)
    assert noise_std(time_s, rounded)[0] >= 1.5e-3 / np.sqrt(12.0)


@pytest.mark.parametrize("jitter", [0.0, 1e-4, 1e-3])
def test_noise_is_told_whatever_the_stamps(jitter):
    """Put on an even grid, measurements would be means of neighbours, with less noise."""
    random = np.random.default_rng(0)
    time_s = np.arange(0.0, 20.0, 0.002001)
    time_s = np.sort(time_s + jitter * random.uniform(-0.9, 0.9, len(time_s)))
    values = np.sin(3.0 * time_s) + 1e-4 * random.standard_normal(len(time_s))
    assert steady_noise([(time_s, values[:, None])]) == pytest.approx(1e-4, rel=0.1)


def test_a_smooth_signal_has_no_noise_whatever_the_stamps():
    time_s = np.sort(np.random.default_rng(0).uniform(0.0, 10.0, 1000))
    cubic = (time_s - 3.0) ** 3
    assert noise_std(time_s, cubic[:, None]) == pytest.approx(1e-9)
