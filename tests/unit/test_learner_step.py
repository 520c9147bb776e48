"""One learner step: what it is pure in, what it leaves alone, and that it learns."""

import numpy as np
import pytest
import torch
from msgspec.structs import replace

from gfm.core import Batch, EnvironmentSpec
from gfm.rl.learner import learner_step
from gfm.rl.learner_state import (
    LearnerSettings,
    init_learner,
    load_state_arrays,
    policy_tensors,
    state_arrays,
)

SPEC = EnvironmentSpec(name="test", observation_size=3, action_size=2)
PLAIN = LearnerSettings(
    policy_hidden=(8,),
    critic_hidden=(8,),
    critic_first_steps=0,
    initial_log_temperature=0.0,
    initial_stddev=0.5,
)
FAST = replace(PLAIN, policy_learning_rate=5e-3, critic_learning_rate=5e-3)
SMALL = replace(PLAIN, policy_hidden=(16, 16), critic_hidden=(16, 16), samples=4, target_period=3)


def batch(seed=0, sequences=8, steps=4, **changes):
    rng = np.random.default_rng(seed)

    def draw(*shape):
        return rng.standard_normal((sequences, *shape), dtype=np.float32)

    arrays = {
        "observation": draw(steps + 1, 3),
        "action": draw(steps, 2),
        "reward": draw(steps),
        "discount": np.ones((sequences, steps), np.float32),
        "log_prob": draw(steps) - 2.0,
    }
    none = np.zeros(sequences, np.int64)
    weights = {"weights_life": none, "weights_version": none, "index": np.arange(sequences)}
    weights["probability"] = np.full(sequences, 0.01, np.float32)
    return Batch(spec_digest=SPEC.digest, **(weights | arrays | changes))


def learn(state, batches, settings=SMALL, seed=0):
    generator = torch.Generator().manual_seed(seed)
    for one in batches:
        state, stats, _ = learner_step(state, one, settings, generator)
    return state, {name: float(value) for name, value in stats.items()}


def assert_same(first, second):
    assert first.keys() == second.keys()
    for name, array in first.items():
        np.testing.assert_array_equal(array, second[name], err_msg=name)


def test_is_the_same_for_the_same_state_batches_and_seed():
    runs = [learn(init_learner(SPEC, SMALL, 0), [batch(i) for i in range(5)]) for _ in range(2)]
    assert_same(state_arrays(runs[0][0]), state_arrays(runs[1][0]))
    assert runs[0][1] == runs[1][1]


def probabilities(*values):
    return {"probability": np.array(values, np.float32)}


def test_what_is_drawn_more_often_counts_less_and_is_told_by_how_much_it_is_wrong():
    one = batch(sequences=2)
    state = init_learner(SPEC, SMALL, 0)
    generator = torch.Generator().manual_seed(0)
    _, stats, errors = learner_step(state, one, SMALL, generator)
    assert errors.shape == (2,)
    assert (errors > 0.0).all()
    # Of mean absolute and mean square errors, each of one sequence, the former are no larger.
    assert 0.5 * np.square(errors).mean() <= float(stats["critic_loss"])


@pytest.mark.parametrize(("exponent", "alike"), [(0.0, True), (1.0, False), (0.5, False)])
def test_an_exponent_of_nought_takes_no_notice_of_probabilities(exponent, alike):
    def learned(one):
        state = init_learner(SPEC, SMALL, 0)
        generator = torch.Generator().manual_seed(0)
        after = learner_step(state, one, SMALL, generator, importance_exponent=exponent)
        return state_arrays(after[0])

    drawn = learned(batch(sequences=2, **probabilities(0.2, 0.8)))
    evenly = learned(batch(sequences=2, **probabilities(0.2, 0.2)))
    same = [np.array_equal(drawn[name], evenly[name]) for name in drawn]
    assert all(same) is alike


def test_one_that_was_drawn_far_too_often_counts_for_nothing():
    settings = replace(SMALL, critic_first_steps=100, normaliser_steps=0)
    two = batch(sequences=2, **probabilities(1e-9, 1.0))
    other = batch(seed=9, sequences=2)
    mixed = {name: getattr(two, name).copy() for name in ("observation", "action", "reward")}
    for name, array in mixed.items():
        array[1] = getattr(other, name)[1]
    gradients = []
    for one in (two, batch(sequences=2, **probabilities(1e-9, 1.0), **mixed)):
        state = init_learner(SPEC, settings, 0)
        generator = torch.Generator().manual_seed(0)
        learner_step(state, one, settings, generator)
        weights = state.networks.critic.parameters()
        gradients.append([weight.grad.numpy().copy() for weight in weights])
    for first, second in zip(*gradients, strict=True):
        np.testing.assert_allclose(first, second, atol=1e-6)


def test_an_interrupted_run_goes_on_as_if_nothing_had_happened():
    generator = torch.Generator().manual_seed(0)
    state = init_learner(SPEC, SMALL, 0)
    for i in range(4):
        state, _, _ = learner_step(state, batch(i), SMALL, generator)
    kept, chance = state_arrays(state), generator.get_state()
    resumed = load_state_arrays(init_learner(SPEC, SMALL, seed=99), kept, steps=4)
    other = torch.Generator()
    other.set_state(chance)
    for i in range(4, 8):
        state, _, _ = learner_step(state, batch(i), SMALL, generator)
        resumed, _, _ = learner_step(resumed, batch(i), SMALL, other)
    assert resumed.steps == state.steps == 8
    assert_same(state_arrays(resumed), state_arrays(state))


def test_targets_change_only_once_a_period():
    state = init_learner(SPEC, SMALL, 0)
    first = policy_tensors(state)["mean.weight"]
    state, _ = learn(state, [batch(0), batch(1)])
    np.testing.assert_array_equal(policy_tensors(state)["mean.weight"], first)
    state, _ = learn(state, [batch(2)])
    online = state.networks.policy.mean.weight.detach().numpy()
    np.testing.assert_array_equal(policy_tensors(state)["mean.weight"], online)
    assert (online != first).any()


def test_the_normaliser_is_fixed_after_its_steps():
    settings = replace(PLAIN, normaliser_steps=2)
    state, _ = learn(init_learner(SPEC, settings, 0), [batch(0), batch(1)], settings)
    shift = state.networks.policy_normaliser.shift.clone()
    state, _ = learn(state, [batch(2)], settings)
    torch.testing.assert_close(state.networks.policy_normaliser.shift, shift, rtol=0, atol=0)


def test_what_is_observed_after_a_terminal_transition_teaches_nothing():
    discount = np.ones((8, 4), np.float32)
    discount[:, 1] = 0.0
    one, other = batch(0, discount=discount), batch(0, discount=discount)
    other.observation[:, 2] += 5.0  # terminal: neither acted in nor valued ...
    other.observation[:, 3:] = one.observation[:, 3:]
    settings = replace(PLAIN, normaliser_steps=0)
    other.reward[:, 2], one.reward[:, 2] = 0.0, 0.0
    gradients = []
    for data in (one, other):
        state, _ = learn(init_learner(SPEC, settings, 0), [data], settings)
        gradients.append(state.networks.policy.first.weight.grad.clone())
    torch.testing.assert_close(gradients[0], gradients[1])


def test_a_batch_of_single_transitions_is_learned_from():
    _, stats = learn(init_learner(SPEC, SMALL, 0), [batch(0, steps=1)])
    assert np.isfinite(list(stats.values())).all()


def test_the_policy_waits_for_the_critic_where_it_is_told_to():
    settings = replace(PLAIN, target_period=1, critic_first_steps=2)
    state = init_learner(SPEC, settings, 0)
    first = policy_tensors(state)["mean.bias"]
    critic = state.networks.critic.value.weight.detach().clone()
    state, _ = learn(state, [batch(0), batch(1)], settings)
    np.testing.assert_array_equal(policy_tensors(state)["mean.bias"], first)
    assert (state.networks.critic.value.weight != critic).any()
    state, _ = learn(state, [batch(2)], settings)
    assert (policy_tensors(state)["mean.bias"] != first).any()


def test_the_critic_learns_the_value_of_a_constant_reward():
    settings = replace(
        FAST,
        policy_hidden=(16,),
        critic_hidden=(32, 32),
        samples=4,
        discount=0.5,
        target_period=10,
    )
    ones = np.ones((8, 4), np.float32)
    batches = [batch(i, reward=ones) for i in range(200)]
    _, stats = learn(init_learner(SPEC, settings, 0), batches, settings)
    assert stats["q_mean"] == pytest.approx(2.0, abs=0.1)


def test_the_policy_moves_towards_rewarded_actions():
    settings = replace(
        FAST,
        policy_hidden=(16,),
        critic_hidden=(32, 32),
        samples=8,
        discount=0.0,
        target_period=10,
    )

    def rewarded(seed):
        data = batch(seed, sequences=16)
        data.reward[:] = -np.square(data.action.clip(-1, 1) - np.float32(0.5)).sum(-1)
        return data

    batches = [rewarded(i) for i in range(600)]
    state, _ = learn(init_learner(SPEC, settings, 0), batches, settings)
    with torch.no_grad():
        mean = state.networks.target_policy(torch.randn(64, 3)).mean
    assert (mean.mean(0) - 0.5).abs().max() < 0.15
