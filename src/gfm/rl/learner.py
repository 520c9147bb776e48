"""The learner's arithmetic: one state, one step that improves it on one batch.

Shape letters: B sequences, T transitions, N sampled actions, O observation size, A action size.
Tensors are time-major inside: (T, B, ...).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Annotated, Any, final

import msgspec
import numpy as np
import torch
from msgspec import Meta
from numpy.typing import NDArray
from torch import Tensor, nn

from gfm.core import Batch, EnvironmentSpec
from gfm.core.checks import Array32
from gfm.rl.gaussian import Gaussian
from gfm.rl.mpo import Duals, Limits, MPOStats, Positive, mpo_loss
from gfm.rl.networks import CriticNetwork, Normaliser, PolicyNetwork
from gfm.rl.retrace import retrace_targets, trace_coefficients

Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
Count = Annotated[int, Meta(ge=1)]
Widths = Annotated[tuple[Count, ...], Meta(min_length=1)]

Stats = Mapping[str, Tensor]

_CPU = torch.device("cpu")


class LearnerSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How the learner learns. A checkpoint can only be resumed with the same ones.

    The defaults are those with which `gfm_fit` learns within minutes; where they are not Acme's:
    its multipliers start at 10 (and 1000) and need thousands of steps to come down, its targets are
    copied every 100 steps, and its discount of 0.99 drowns what one step's force does to the next
    states in what follows anyway. Other problems want a settings file of their own.

    Attributes:
        policy_hidden: Widths of the policy's hidden layers; the paper's two of 200.
        critic_hidden: Widths of the critic's hidden layers.
        initial_stddev: Of the first policy, in units of the action.
        discount: Per control step.
        retrace_lambda: Retrace's lambda.
        samples: Actions sampled at each observation, N.
        limits: MPO's constraints.
        policy_learning_rate: Adam's.
        critic_learning_rate: Adam's.
        dual_learning_rate: Adam's.
        initial_log_temperature: Before the softplus.
        initial_log_alpha_mean: Before the softplus.
        initial_log_alpha_stddev: Before the softplus.
        target_period: Steps between copies of policy and critic to their targets.
        gradient_limit: Largest norm of the policy's gradient, and of the critic's.
        normaliser_steps: Steps whose observations shape the normaliser; it is fixed afterwards.
        critic_first_steps: Steps in which only the critic learns: a policy that begins well would
            unlearn it while its critic is still random.
    """

    policy_hidden: Widths = (200, 200)
    critic_hidden: Widths = (256, 256)
    initial_stddev: Positive = 0.2
    discount: Fraction = 0.8
    retrace_lambda: Fraction = 0.95
    samples: Count = 10
    limits: Limits = Limits(epsilon_mean=1e-2, epsilon_stddev=1e-4)
    policy_learning_rate: Positive = 1e-3
    critic_learning_rate: Positive = 1e-3
    dual_learning_rate: Positive = 1e-2
    initial_log_temperature: float = -3.0
    initial_log_alpha_mean: float = 0.0
    initial_log_alpha_stddev: float = 10.0
    target_period: Count = 25
    gradient_limit: Positive = 40.0
    normaliser_steps: Annotated[int, Meta(ge=0)] = 1000
    critic_first_steps: Annotated[int, Meta(ge=0)] = 200


class Networks(nn.Module):
    """Everything that is learned or copied, in one tree."""

    def __init__(self, spec: EnvironmentSpec, settings: LearnerSettings) -> None:
        super().__init__()
        self.policy_normaliser = Normaliser(spec.policy_size)
        self.critic_normaliser = Normaliser(spec.observation_size)
        self.policy = PolicyNetwork(
            spec.policy_size,
            spec.action_size,
            settings.policy_hidden,
            initial_stddev=settings.initial_stddev,
        )
        self.critic = CriticNetwork(spec.observation_size, spec.action_size, settings.critic_hidden)
        self.target_policy = deepcopy(self.policy).requires_grad_(requires_grad=False)
        self.target_critic = deepcopy(self.critic).requires_grad_(requires_grad=False)
        self.duals = Duals(
            spec.action_size,
            settings.limits,
            log_temperature=settings.initial_log_temperature,
            log_alpha_mean=settings.initial_log_alpha_mean,
            log_alpha_stddev=settings.initial_log_alpha_stddev,
        )

    def normalise(self, observation: Tensor, *, update: bool) -> tuple[Tensor, Tensor]:
        """Returns what policy and critic see of observations (E*, O), scaled."""
        seen = observation[..., : len(self.policy_normaliser.shift)]
        if update:
            self.policy_normaliser.update(seen)
            self.critic_normaliser.update(observation)
        return self.policy_normaliser(seen), self.critic_normaliser(observation)

    @torch.no_grad()
    def update_targets(self) -> None:
        """Copies policy and critic to their targets."""
        for online, target in (
            (self.policy, self.target_policy),
            (self.critic, self.target_critic),
        ):
            pairs = zip(target.parameters(), online.parameters(), strict=True)
            for copy, original in pairs:
                copy.copy_(original)


@dataclass(frozen=True, kw_only=True)
class LearnerState:
    """Where learning stands.

    Attributes:
        networks: Networks, targets, duals and normaliser.
        optimiser: Adam over policy, critic and duals, with its moments.
        steps: Learner steps so far.
    """

    networks: Networks
    optimiser: torch.optim.Adam
    steps: int = 0


def init_learner(
    spec: EnvironmentSpec,
    settings: LearnerSettings,
    seed: int,
    device: torch.device = _CPU,
) -> LearnerState:
    """Returns the state before the first step; the same one for the same seed."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        networks = Networks(spec, settings).to(device)
    groups = [
        {"params": networks.policy.parameters(), "lr": settings.policy_learning_rate},
        {"params": networks.critic.parameters(), "lr": settings.critic_learning_rate},
        {"params": networks.duals.parameters(), "lr": settings.dual_learning_rate},
    ]
    return LearnerState(networks=networks, optimiser=torch.optim.Adam(groups, fused=True))


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


def policy_tensors(state: LearnerState) -> dict[str, Array32]:
    """Returns copies of the target policy's parameters by name, as `GaussianPolicy` reads them.

    The target policy, as in Acme: MPO's trust region is drawn around it and its samples are what
    is improved on, so that what acts and what is evaluated stay close and traces stay long.
    """
    networks = state.networks
    tensors = dict(networks.target_policy.state_dict())
    normaliser = networks.policy_normaliser
    tensors |= {"shift": normaliser.shift, "scale": normaliser.scale}
    return {name: np.array(tensor.cpu().numpy()) for name, tensor in tensors.items()}


@torch.no_grad()
def load_policy_tensors(state: LearnerState, tensors: Mapping[str, Array32]) -> None:
    """Starts policy, target policy and the policy's normaliser from given parameters, in place.

    That normaliser stays as it is given: the first layer was made for it. Weights that are given as
    exactly zero stay zero: the policy shall not come to depend on what it was kept from seeing.

    Raises:
        RuntimeError: names or shapes are not those of the networks (see `Weights.architecture`).
    """
    given = {name: torch.tensor(tensor) for name, tensor in tensors.items()}
    normaliser = state.networks.policy_normaliser
    normaliser.fixed.fill_(value=True)
    normaliser.shift.copy_(given.pop("shift"))
    normaliser.scale.copy_(given.pop("scale"))
    state.networks.policy.load_state_dict(given)
    state.networks.target_policy.load_state_dict(given)
    _hold_zeros(state.networks.policy)


def state_arrays(state: LearnerState) -> dict[str, NDArray[Any]]:
    """Returns copies of everything in a state but its step count, by name."""
    arrays = {
        f"networks/{name}": np.array(tensor.cpu().numpy())
        for name, tensor in state.networks.state_dict().items()
    }
    moments: dict[int, dict[str, Tensor]] = state.optimiser.state_dict()["state"]
    for index, values in moments.items():
        for name, tensor in values.items():
            arrays[f"optimiser/{index}/{name}"] = np.array(tensor.cpu().numpy())
    return arrays


def load_state_arrays(
    state: LearnerState, arrays: Mapping[str, NDArray[Any]], steps: int
) -> LearnerState:
    """Returns `state` with what `state_arrays` gave, loaded in place.

    Raises:
        RuntimeError: names or shapes are not those of this state's networks.
    """
    networks, moments = {}, defaultdict[int, dict[str, Tensor]](dict)
    for path, array in arrays.items():
        group, _, name = path.partition("/")
        if group == "networks":
            networks[name] = torch.tensor(array)
        elif group == "optimiser":
            index, _, moment = name.partition("/")
            moments[int(index)][moment] = torch.tensor(array)
    state.networks.load_state_dict(networks)
    groups = state.optimiser.state_dict()["param_groups"]
    state.optimiser.load_state_dict({"state": dict(moments), "param_groups": groups})
    _hold_zeros(state.networks.policy)
    return replace(state, steps=steps)


def _hold_zeros(policy: PolicyNetwork) -> None:
    """Takes the gradients off weights that are exactly zero; those of the stddev's head are free.

    Weights that began at random are never that, and those that were held stay recognisable in a
    checkpoint.
    """
    for name, parameter in policy.named_parameters():
        if name.endswith(".weight") and not name.startswith("stddev."):
            held = _Held((parameter.detach() != 0.0).to(parameter.dtype))
            parameter.register_hook(held)  # type: ignore[no-untyped-call]


@final
class _Held:
    """Multiplies gradients with 0 where a weight is held and with 1 elsewhere."""

    def __init__(self, free: Tensor) -> None:
        self._free = free

    def __call__(self, gradient: Tensor) -> Tensor:
        return gradient * self._free


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
