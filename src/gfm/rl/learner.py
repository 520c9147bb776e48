"""The learner's arithmetic: one step that improves a state on one batch.

Shape letters: B sequences, T transitions, N sampled actions, O observation size, A action size.
Tensors are time-major inside: (T, B, ...).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from gfm.core import Batch
from gfm.core.checks import Array32
from gfm.rl.gaussian import Gaussian
from gfm.rl.learner_state import LearnerSettings, LearnerState, Networks
from gfm.rl.mpo import Limits, MPOStats, mpo_loss
from gfm.rl.retrace import retrace_targets, trace_coefficients

Stats = Mapping[str, Tensor]


def learner_step(
    state: LearnerState,
    batch: Batch,
    settings: LearnerSettings,
    generator: torch.Generator,
    *,
    importance_exponent: float = 1.0,
) -> tuple[LearnerState, Stats, Array32]:
    """Returns the state after a step on a batch, scalars that describe the step, and errors.

    The errors are the critic's, mean absolute ones of each sequence, shape (B,). The tensors of
    `state` are updated in place: only the returned state may be used afterwards.

    Args:
        state: Where learning stands.
        batch: B sequences of T transitions.
        settings: The ones that `state` was made with.
        generator: Where the sampled actions come from, on the device of the networks.
        importance_exponent: Of the weights of sequences that were not drawn alike.
    """
    networks, data = state.networks, _time_major(batch, generator.device)
    seen, judged = networks.normalise(
        data.observation, update=state.steps < settings.normaliser_steps
    )
    estimate = _evaluate(networks, (seen, judged), data, settings, generator)
    q_tm1 = networks.critic(judged[:-1], data.action)
    error = estimate.returns - q_tm1
    critic_loss = 0.5 * error.square()
    weight = _importance(data.probability, importance_exponent)
    policy_loss, mpo = _policy_loss(networks, seen[1:], estimate, settings)
    # After a terminal transition there is nothing to act on.
    alive = (data.discount > 0.0).to(policy_loss.dtype)
    loss = (weight * critic_loss).mean()
    if state.steps >= settings.critic_first_steps:
        loss = loss + (weight * alive * policy_loss).sum() / alive.sum().clamp(min=1.0)

    # Parameters without a gradient are left alone by the optimiser, moments and all.
    state.optimiser.zero_grad(set_to_none=True)
    torch.autograd.backward(loss)
    norms = [
        nn.utils.clip_grad_norm_(network.parameters(), settings.gradient_limit)
        for network in (networks.policy, networks.critic)
    ]
    state.optimiser.step()
    networks.duals.clamp()
    steps = state.steps + 1
    if steps % settings.target_period == 0:
        networks.update_targets()
    stats = _mpo_scalars(mpo, settings.limits) | {
        "critic_loss": critic_loss.detach().mean(),
        "policy_gradient_norm": norms[0],
        "critic_gradient_norm": norms[1],
        "q_mean": q_tm1.detach().mean(),
        "return_target_mean": estimate.returns.mean(),
        "trace_mean": estimate.trace_mean,
        "stddev_mean": estimate.target.stddev.mean(),
    }
    errors: Array32 = error.detach().abs().mean(0).cpu().numpy()
    return replace(state, steps=steps), stats, errors


def _importance(probability: Tensor, exponent: float) -> Tensor:
    """Returns weights that undo how much more often sequences were drawn, shape (B,).

    Schaul et al. 2016, section 3.4, scaled so that the largest of the batch is 1: the number of
    sequences to draw from cancels. All are exactly 1 where all were drawn alike.
    """
    return (probability.min() / probability) ** exponent


@dataclass(frozen=True, kw_only=True)
class _Data:
    """A batch, time-major: observation (T+1, B, O), action (T, B, A), the others (T, B).

    With which probability each sequence was drawn has the shape (B,).
    """

    observation: Tensor
    action: Tensor
    reward: Tensor
    discount: Tensor
    log_prob: Tensor
    probability: Tensor


def _time_major(batch: Batch, device: torch.device) -> _Data:
    def convert(array: Array32) -> Tensor:
        return torch.from_numpy(array).to(device).transpose(0, 1).contiguous()

    return _Data(
        observation=convert(batch.observation),
        action=convert(batch.action),
        reward=convert(batch.reward),
        discount=convert(batch.discount),
        log_prob=convert(batch.log_prob),
        probability=torch.from_numpy(batch.probability).to(device),
    )


@dataclass(frozen=True, kw_only=True)
class _Estimate:
    """Policy evaluation, without gradients.

    Attributes:
        target: The target policy at observations 1..T, shape (T, B, A).
        actions: Its samples, shape (N, T, B, A).
        q: Their target action values, shape (N, T, B).
        returns: Retrace targets at observations 0..T-1, shape (T, B).
        trace_mean: Mean of the trace coefficients, shape ().
    """

    target: Gaussian
    actions: Tensor
    q: Tensor
    returns: Tensor
    trace_mean: Tensor


@torch.no_grad()
def _evaluate(
    networks: Networks,
    observation: tuple[Tensor, Tensor],
    data: _Data,
    settings: LearnerSettings,
    generator: torch.Generator,
) -> _Estimate:
    seen, judged = observation
    target: Gaussian = networks.target_policy(seen[1:])
    actions = target.sample(settings.samples, generator)
    q = networks.target_critic(judged[1:], actions)
    q_t = networks.target_critic(judged[1:-1], data.action[1:])
    log_rho_t = target[:-1].log_prob(data.action[1:]) - data.log_prob[1:]
    c_t = trace_coefficients(log_rho_t, settings.retrace_lambda)
    discount_t = settings.discount * data.discount
    returns = retrace_targets(q_t, q.mean(0), data.reward, discount_t, c_t)
    trace_mean = c_t.mean() if len(c_t) else torch.zeros((), device=c_t.device)
    return _Estimate(target=target, actions=actions, q=q, returns=returns, trace_mean=trace_mean)


def _policy_loss(
    networks: Networks, observation: Tensor, estimate: _Estimate, settings: LearnerSettings
) -> tuple[Tensor, MPOStats]:
    """Returns the MPO loss at observations 1..T, shape (T, B), and its statistics."""
    return mpo_loss(
        online=networks.policy(observation),
        target=estimate.target,
        actions=estimate.actions,
        q=estimate.q,
        duals=networks.duals,
        limits=settings.limits,
    )


def _mpo_scalars(stats: MPOStats, limits: Limits) -> dict[str, Tensor]:
    """Returns means; a KL relative to its limit hovers near 1 where the dual works."""
    return {
        "policy_loss": stats.policy_loss.mean(),
        "temperature": stats.temperature,
        "penalty_temperature": stats.penalty_temperature,
        "alpha_mean": stats.alpha_mean.mean(),
        "alpha_stddev": stats.alpha_stddev.mean(),
        "kl_q_relative": stats.kl_q.mean() / limits.epsilon,
        "kl_penalty_relative": stats.kl_penalty.mean() / limits.epsilon_penalty,
        "kl_mean_relative": stats.kl_mean.mean() / limits.epsilon_mean,
        "kl_stddev_relative": stats.kl_stddev.mean() / limits.epsilon_stddev,
        "actions_outside": stats.outside.mean(),
    }
