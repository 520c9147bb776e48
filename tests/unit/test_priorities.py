"""Draws by priority: in proportion, always, and only from what is there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gfm_replay.priorities import Priorities

RNG = np.random.default_rng(0)


def shares(tree, slots, count=40_000):
    drawn, probability = tree.draw(count, RNG)
    for slot in np.unique(drawn):
        assert len(set(probability[drawn == slot])) == 1
    return np.bincount(drawn, minlength=slots) / count


@pytest.mark.parametrize("slots", [1, 2, 3, 7, 8, 1000])
@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_slots_are_drawn_in_proportion_to_a_power_of_their_priority(slots, exponent):
    tree = Priorities(slots, exponent)
    priority = RNG.uniform(0.5, 2.0, slots).astype(np.float32)
    tree.update(np.arange(slots), priority)
    expected = priority**exponent / (priority**exponent).sum()
    np.testing.assert_allclose(shares(tree, slots), expected, atol=5.0 * np.sqrt(1 / 40_000))
    drawn, probability = tree.draw(100, RNG)
    np.testing.assert_allclose(probability, expected[drawn], rtol=1e-5)


def test_what_is_new_is_as_likely_as_the_likeliest_that_was_last_told_of():
    tree = Priorities(4, 1.0)
    tree.add(np.array([0, 1]))
    np.testing.assert_allclose(shares(tree, 4), [0.5, 0.5, 0, 0], atol=0.02)
    tree.update(np.array([0, 1]), np.array([3.0, 1.0], np.float32))
    tree.add(np.array([2]))
    np.testing.assert_allclose(shares(tree, 4), [3 / 7, 1 / 7, 3 / 7, 0], atol=0.02)
    tree.update(np.array([2]), np.array([0.5], np.float32))
    tree.add(np.array([3]))
    np.testing.assert_allclose(shares(tree, 4), [0.6, 0.2, 0.1, 0.1], atol=0.02)


def test_of_a_slot_that_is_said_twice_the_last_counts():
    tree = Priorities(2, 1.0)
    tree.add(np.array([0]))
    tree.update(np.array([1, 1]), np.array([5.0, 1.0], np.float32))
    np.testing.assert_allclose(shares(tree, 2), 0.5, atol=0.02)


def test_what_is_learned_stays_within_reach():
    tree = Priorities(2, 1.0)
    tree.update(np.array([0, 1]), np.zeros(2, np.float32))
    np.testing.assert_allclose(shares(tree, 2), 0.5, atol=0.02)


@given(st.lists(st.floats(0.0, 1e6), min_size=1, max_size=9), st.integers(0, 2**32 - 1))
def test_nothing_is_drawn_that_is_not_there(priority, seed):
    tree = Priorities(16, 1.0)
    tree.update(np.arange(len(priority)), np.array(priority, np.float32))
    drawn, probability = tree.draw(200, np.random.default_rng(seed))
    assert drawn.max() < len(priority)
    assert (probability > 0.0).all()
