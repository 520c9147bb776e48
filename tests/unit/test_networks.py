"""Networks: what they promise about scale, start and samples, and that NumPy agrees with torch."""

import math

import numpy as np
import pytest
import torch

from gfm.core import BadInputError, EnvironmentSpec, ShapeError
from gfm.rl.gaussian import Gaussian, kl_per_dimension
from gfm.rl.learner_state import (
    LearnerSettings,
    init_learner,
    load_policy_tensors,
    load_state_arrays,
    policy_tensors,
    state_arrays,
)
from gfm.rl.networks import CriticNetwork, Normaliser, PolicyNetwork
from gfm.rl.policy_numpy import GaussianPolicy

SPEC = EnvironmentSpec(name="test", observation_size=5, action_size=2)


def gaussian(batch=4, size=3, seed=0):
    generator = torch.Generator().manual_seed(seed)
    mean = torch.randn(batch, size, generator=generator, dtype=torch.float64)
    stddev = 0.1 + torch.rand(batch, size, generator=generator, dtype=torch.float64)
    return Gaussian(mean=mean, stddev=stddev)


def test_log_prob_and_kl_are_those_of_torch_distributions():
    first, second = gaussian(seed=1), gaussian(seed=2)
    normal_1 = torch.distributions.Normal(first.mean, first.stddev)
    normal_2 = torch.distributions.Normal(second.mean, second.stddev)
    action = first.sample(6, torch.Generator().manual_seed(3))
    torch.testing.assert_close(second.log_prob(action), normal_2.log_prob(action).sum(-1))
    torch.testing.assert_close(
        kl_per_dimension(first, second), torch.distributions.kl_divergence(normal_1, normal_2)
    )


def test_samples_have_the_mean_and_stddev_of_the_distribution():
    distribution = gaussian()
    samples = distribution.sample(20000, torch.Generator().manual_seed(0))
    torch.testing.assert_close(samples.mean(0), distribution.mean, rtol=0.0, atol=0.05)
    torch.testing.assert_close(samples.std(0), distribution.stddev, rtol=0.05, atol=0.0)


def test_normaliser_has_the_statistics_of_everything_it_was_shown():
    observation = 3.0 + 2.0 * torch.randn(7, 5, 4, generator=torch.Generator().manual_seed(0))
    normaliser = Normaliser(4)
    for part in (observation[:2], observation[2:3], observation[3:]):
        normaliser.update(part)
    rows = observation.reshape(-1, 4)
    torch.testing.assert_close(normaliser.shift, rows.mean(0))
    torch.testing.assert_close(normaliser.scale, rows.std(0, correction=0))


def test_normaliser_leaves_observations_alone_before_it_was_shown_any():
    observation = torch.randn(3, 4)
    torch.testing.assert_close(Normaliser(4)(observation), observation)


def test_first_policy_is_the_same_everywhere():
    policy = PolicyNetwork(6, 3, (20, 20), initial_stddev=0.3)
    distribution = policy(torch.randn(50, 6))
    assert distribution.mean.abs().max() < 0.05
    torch.testing.assert_close(distribution.stddev, torch.full((50, 3), 0.3), rtol=0.05, atol=0.0)


def test_critic_sees_actions_clipped_to_their_bounds():
    critic = CriticNetwork(4, 2, (16, 16))
    observation = torch.randn(3, 4)
    inside = critic(observation, torch.ones(3, 2))
    torch.testing.assert_close(critic(observation, torch.full((3, 2), 7.0)), inside)


def test_critic_values_many_actions_as_it_values_each_alone():
    critic = CriticNetwork(4, 2, (16, 16))
    observation, actions = torch.randn(3, 4), torch.rand(5, 3, 2)
    together = critic(observation, actions)
    for index in range(5):
        torch.testing.assert_close(together[index], critic(observation, actions[index]))


@pytest.mark.parametrize("hidden", [(7,), (32, 32), (16, 8, 16)])
def test_numpy_policy_is_the_networks_function(hidden):
    settings = LearnerSettings(policy_hidden=hidden)
    state = init_learner(SPEC, settings, seed=0)
    generator = torch.Generator().manual_seed(1)
    observation = 3.0 + 2.0 * torch.randn(64, 5, generator=generator)
    networks = state.networks
    with torch.no_grad():
        for parameter in networks.target_policy.parameters():
            parameter.add_(0.3 * torch.randn(parameter.shape, generator=generator))
        networks.policy_normaliser.update(observation)
        expected = networks.target_policy(networks.policy_normaliser(observation))
    policy = GaussianPolicy.from_weights(policy_tensors(state))
    mean = policy.mean_action(observation.numpy())
    np.testing.assert_allclose(mean, expected.mean.clamp(-1, 1), rtol=0, atol=2e-5)
    action, log_prob = policy.sample(observation.numpy(), np.random.default_rng(0))
    np.testing.assert_allclose(
        log_prob, expected.log_prob(torch.from_numpy(action)), rtol=1e-4, atol=1e-3
    )
    assert action.dtype == log_prob.dtype == np.float32
    assert (policy.observation_size, policy.action_size) == (5, 2)


def test_numpy_policy_samples_around_its_mean():
    settings = LearnerSettings(initial_stddev=0.5)
    policy = GaussianPolicy.from_weights(policy_tensors(init_learner(SPEC, settings, 0)))
    observation = np.ones((20000, 5), np.float32)
    action, _ = policy.sample(observation, np.random.default_rng(0))
    np.testing.assert_allclose(action.mean(0), policy.mean_action(observation)[0], atol=0.02)
    np.testing.assert_allclose(action.std(0), 0.5, rtol=0.05)


def test_loaded_tensors_come_out_again():
    source = init_learner(SPEC, LearnerSettings(), seed=0)
    source.networks.policy_normaliser.update(torch.randn(100, 5))
    state = init_learner(SPEC, LearnerSettings(), seed=1)
    load_policy_tensors(state, policy_tensors(source))
    for name, tensor in policy_tensors(source).items():
        np.testing.assert_array_equal(policy_tensors(state)[name], tensor, err_msg=name)


def test_weights_that_are_given_as_zero_stay_zero_and_the_others_learn():
    given = dict(policy_tensors(init_learner(SPEC, LearnerSettings(policy_hidden=(8, 8)), seed=0)))
    given["first.weight"] = given["first.weight"] * np.array([1, 0, 1, 0, 0], np.float32)
    state = init_learner(SPEC, LearnerSettings(policy_hidden=(8, 8)), seed=1)
    load_policy_tensors(state, given)
    reread = load_state_arrays(
        init_learner(SPEC, LearnerSettings(policy_hidden=(8, 8)), seed=2), state_arrays(state), 0
    )
    for networks in (state.networks, reread.networks):
        networks.policy(torch.randn(20, 5)).mean.sum().backward()
        gradient = networks.policy.first.weight.grad
        assert gradient is not None
        assert (gradient[:, [1, 3, 4]] == 0.0).all()
        assert (gradient[:, [0, 2]] != 0.0).any()


def test_incomplete_weights_are_refused_with_what_is_missing():
    tensors = policy_tensors(init_learner(SPEC, LearnerSettings(), seed=0))
    del tensors["mean.bias"], tensors["shift"]
    with pytest.raises(BadInputError, match=r"policy weights lack shift, mean\.bias"):
        GaussianPolicy.from_weights(tensors)


def test_an_observation_of_another_size_is_refused():
    policy = GaussianPolicy.from_weights(policy_tensors(init_learner(SPEC, LearnerSettings(), 0)))
    with pytest.raises(ShapeError, match=r"observation has shape \(2, 4\), expected \(N, 5\)"):
        policy.mean_action(np.zeros((2, 4), np.float32))


def test_log_prob_of_the_mean_is_the_peak_of_the_density():
    distribution = Gaussian(mean=torch.zeros(1, 2), stddev=torch.ones(1, 2))
    assert distribution.log_prob(torch.zeros(1, 2)).item() == pytest.approx(-math.log(2 * math.pi))
