"""Regression: what can be learned is learned, what cannot is said, and chance is seeded."""

import numpy as np
import pytest

from gfm.core import BadInputError, EnvironmentSpec
from gfm.rl.learner_state import LearnerSettings, init_learner, load_policy_tensors
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.rl.regression import RegressionSettings, fit_policy

SETTINGS = RegressionSettings(hidden=(32, 32), epochs=30, batch_size=64)


def examples(noise=0.0, count=2000, seed=0):
    rng = np.random.default_rng(seed)
    observation = np.cumsum(rng.normal(0.0, 0.3, (count, 3)), axis=0) % 4.0 + 10.0
    action = np.stack([np.sin(observation[:, 0]), 0.2 * observation[:, 1] - 2.4], axis=1) * 0.5
    return observation, action + noise * rng.normal(size=action.shape)


def test_recovers_a_smooth_function_and_its_noise():
    observation, action = examples(noise=0.1)
    fitted = fit_policy(observation, action, SETTINGS, seed=0)
    np.testing.assert_allclose(fitted.rmse, 0.1, rtol=0.25)
    assert (action.std(0) > 0.15).all()
    policy = GaussianPolicy.from_weights(fitted.tensors)
    new, truth = examples(seed=1)
    error = policy.mean_action(new.astype(np.float32)) - truth
    assert np.sqrt(np.square(error).mean()) < 0.06
    sampled, _ = policy.sample(new.astype(np.float32), np.random.default_rng(0))
    np.testing.assert_allclose((sampled - truth).std(0), 0.1, rtol=0.3)


def test_what_is_finer_than_the_input_noise_is_not_followed():
    x = np.linspace(-1.0, 1.0, 2000)[:, None]
    wave = np.hstack([0.5 * np.sin(2.0 * x), 0.5 * np.sin(8.0 * x)])
    sharp, blurred = (
        fit_policy(x, wave, RegressionSettings(epochs=60, batch_size=64, input_noise=noise), 0)
        for noise in (0.0, 0.2)
    )
    assert (sharp.rmse < 0.05).all()
    assert blurred.rmse[0] < 0.05
    assert blurred.rmse[1] > 0.1


def test_decaying_weights_make_a_flatter_policy():
    observation, action = examples(noise=0.3, count=200)
    plain, decayed = (
        fit_policy(observation, action, RegressionSettings(weight_decay=decay), 0)
        for decay in (0.0, 3.0)
    )
    assert (decayed.rmse > plain.rmse).all()
    sizes = [np.linalg.norm(one.tensors["first.weight"]) for one in (plain, decayed)]
    assert sizes[1] < 0.8 * sizes[0]


def test_is_the_same_under_the_same_seed_and_another_under_another():
    observation, action = examples(count=200)
    settings = RegressionSettings(hidden=(8,), epochs=3)
    first, again, other = (fit_policy(observation, action, settings, s) for s in (0, 0, 1))
    for name, tensor in first.tensors.items():
        np.testing.assert_array_equal(tensor, again.tensors[name])
    assert any((tensor != other.tensors[name]).any() for name, tensor in first.tensors.items())


def test_an_action_does_not_depend_on_what_it_is_not_given():
    observation, action = examples(count=300)
    inputs = np.array([[False, True, True], [True, False, False]])
    settings = RegressionSettings(hidden=(8, 8), epochs=3)
    tensors = fit_policy(observation, action, settings, seed=0, inputs=inputs).tensors
    first, second = tensors["first.weight"][:4], tensors["first.weight"][4:]
    assert (first[:, 0] == 0.0).all()
    assert (first[:, 1:] != 0.0).all()
    assert (second[:, 0] != 0.0).all()
    assert (second[:, 1:] == 0.0).all()
    assert (tensors["hidden.0.weight"][:4, 4:] == 0.0).all()
    assert (tensors["mean.weight"][0, 4:] == 0.0).all()
    assert (tensors["mean.weight"][1, :4] == 0.0).all()


def test_actions_that_are_given_the_same_share_the_hidden_units():
    observation, action = examples(count=300)
    inputs = np.tile([True, True, False], (2, 1))
    settings = RegressionSettings(hidden=(8, 8), epochs=1)
    tensors = fit_policy(observation, action, settings, seed=0, inputs=inputs).tensors
    assert (tensors["first.weight"][:, 2] == 0.0).all()
    assert (tensors["hidden.0.weight"] != 0.0).all()
    assert (tensors["mean.weight"] != 0.0).all()


def test_what_is_not_given_cannot_be_confused_with_the_cause():
    """Two inputs are nearly the same where it was learned, and differ elsewhere."""
    rng = np.random.default_rng(3)
    cause = rng.normal(size=(400, 1))
    alike = np.hstack([cause, cause + 0.01 * rng.normal(size=(400, 1))])
    apart = np.hstack([cause, rng.normal(size=(400, 1))]).astype(np.float32)
    target = 0.3 * np.tanh(cause)
    errors = []
    for inputs in (np.array([[True, False]]), np.array([[True, True]])):
        fitted = fit_policy(alike, target, SETTINGS, seed=0, inputs=inputs)
        policy = GaussianPolicy.from_weights(fitted.tensors)
        errors.append(float(np.square(policy.mean_action(apart) - target).mean() ** 0.5))
    assert errors[0] < 0.02
    assert errors[1] > 3.0 * errors[0]


def test_stddev_stays_between_its_bounds():
    observation, action = examples(count=400)
    settings = RegressionSettings(hidden=(8,), epochs=1, least_stddev=0.2, greatest_stddev=0.25)
    policy = GaussianPolicy.from_weights(fit_policy(observation, action, settings, seed=0).tensors)
    rows = np.repeat(observation[:1], 20000, axis=0).astype(np.float32)
    spread = policy.sample(rows, np.random.default_rng(0))[0].std(0)
    assert ((spread > 0.19) & (spread < 0.26)).all()


def test_the_learner_starts_from_what_was_fitted():
    observation, action = examples(count=200)
    settings = RegressionSettings(hidden=(8, 8), epochs=2)
    fitted = fit_policy(observation, action, settings, seed=0)
    spec = EnvironmentSpec(name="test", observation_size=3, action_size=2)
    state = init_learner(spec, LearnerSettings(policy_hidden=(8, 8)), seed=0)
    load_policy_tensors(state, fitted.tensors)
    np.testing.assert_array_equal(
        state.networks.policy.mean.weight.detach().numpy(), fitted.tensors["mean.weight"]
    )


@pytest.mark.parametrize(
    ("observation", "action", "message"),
    [
        (np.zeros((30, 3)), np.zeros((29, 2)), r"expected \(N, O\) and \(N, A\)"),
        (np.zeros((5, 3)), np.zeros((5, 2)), "5 examples to fit, expected at least 20"),
        (np.full((30, 3), np.nan), np.zeros((30, 2)), "hold NaN or infinity"),
    ],
)
def test_examples_that_cannot_be_fitted_are_refused(observation, action, message):
    with pytest.raises(BadInputError, match=message):
        fit_policy(observation, action, SETTINGS, seed=0)
