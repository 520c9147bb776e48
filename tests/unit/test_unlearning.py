"""What one action does to a return, told apart by its sign: where it is known in closed form."""

import numpy as np
import pytest
from unlearning import AFTER, PAIRS, Told, changed, noisy_returns, page, split

SHAPE, STDDEV, DISCOUNT = (4, 2), 0.1, 0.8


class Plain:
    """Rewards of a period are a straight and a bent function of its noise."""

    def __init__(self, slope, bend):
        self._slope, self._bend = slope, bend

    def rewards(self, noise):
        return noise @ self._slope - self._bend * np.square(noise).sum(axis=2)


def test_a_straight_return_is_all_straight_and_a_bent_one_all_bent():
    slope = np.array([1.0, -2.0])
    changes, there, back = changed(Plain(slope, 0.0), SHAPE, STDDEV, DISCOUNT)
    straight, bent = split(there, back)
    assert changes.shape == (PAIRS, *SHAPE)
    assert np.allclose(straight, changes @ slope)
    assert np.allclose(bent, 0.0)
    changes, there, back = changed(Plain(slope, 3.0), SHAPE, STDDEV, DISCOUNT)
    straight, bent = split(there, back)
    assert np.allclose(straight, changes @ slope)
    cost = -3.0 * np.square(changes).sum(axis=2)
    assert np.allclose(bent, cost - cost.mean(axis=0))


def test_later_noise_is_that_of_the_periods_after_the_action():
    told = noisy_returns(Plain(np.array([1.0, 0.0]), 0.0), (2000, 2), STDDEV, DISCOUNT)
    weights = DISCOUNT ** np.arange(1, AFTER)
    assert told.std() == pytest.approx(STDDEV * np.linalg.norm(weights), rel=0.02)


def test_the_tables_tell_the_best_after_learning_began():
    errors = [(0, 2e-4), (1000, 1e-4), (1600, 5e-4), (1800, 4e-4), (2000, 6e-4)]
    row = Told(
        stddev=0.05,
        without=0.1,
        true=0.995,
        mean=0.99,
        noisy=0.6,
        across=0.01,
        later=0.3,
        straight=0.02,
        bent=0.05,
        heard=0.1,
        steps=1200,
        errors=errors,
        nominal=4e-3,
        learned=0.995,
        held_out=(5e-3, 1.9e-3, 1e-3),
    )
    fitted, held_out = list(page([row]))[-2:]
    assert "4.000 | 0.200 | 0.400 | 0.600 | 0.9900, 0.9950 (2000 steps)" in fitted
    assert held_out == "| | held out | 5.000 | 1.900 | | 1.000 | |"
