"""A student begins as the policy it was given and takes over what it is taught."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.core.checks import Array32
from gfm.policies import shipped_policy
from gfm.recording.weights_file import read_weights
from gfm.rl.distillation import Student
from gfm.rl.policy_numpy import GaussianPolicy


@pytest.fixture
def tensors() -> dict[str, Array32]:
    return dict(read_weights(shipped_policy("position_matching")).tensors)


def observations(policy: GaussianPolicy) -> Array32:
    rng = np.random.default_rng(0)
    return 0.3 * rng.standard_normal((400, policy.observation_size), dtype=np.float32)


def test_it_begins_as_the_given_policy(tensors: dict[str, Array32]) -> None:
    begun = Student(tensors, seed=0).tensors
    assert begun.keys() == tensors.keys()
    assert all(np.array_equal(begun[name], tensors[name]) for name in tensors)


def test_it_takes_over_what_it_is_taught(tensors: dict[str, Array32]) -> None:
    policy = GaussianPolicy.from_weights(tensors)
    seen = observations(policy)
    taught = np.clip(0.5 * policy.mean_action(seen) + 0.3, -1.0, 1.0).astype(np.float32)
    student = Student(tensors, seed=0)
    for rate in np.linspace(1e-3, 0.0, 400, endpoint=False):
        student.learn(seen, taught, float(rate))
    learned = GaussianPolicy.from_weights(student.tensors)
    before, after = (
        np.sqrt(np.mean((one.mean_action(seen) - taught) ** 2)) for one in (policy, learned)
    )
    assert after < 0.2 * before


def test_it_acts_as_variedly_as_before(tensors: dict[str, Array32]) -> None:
    policy = GaussianPolicy.from_weights(tensors)
    seen = observations(policy)
    student = Student(tensors, seed=0)
    for rate in np.linspace(1e-3, 0.0, 400, endpoint=False):
        student.learn(seen, np.zeros((len(seen), policy.action_size), np.float32), float(rate))
    learned = GaussianPolicy.from_weights(student.tensors)
    spread = [spread_at(one, seen[:20]) for one in (policy, learned)]
    np.testing.assert_allclose(spread[1], spread[0], rtol=0.2)


def spread_at(policy: GaussianPolicy, seen: Array32) -> Array32:
    """Returns the mean stddev of the actions at some observations, shape (A,)."""
    rng = np.random.default_rng(1)
    drawn = [policy.sample(np.repeat(row[None], 2000, axis=0), rng)[0].std(axis=0) for row in seen]
    return np.asarray(np.mean(drawn, axis=0))
