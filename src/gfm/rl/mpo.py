"""Maximum a posteriori policy optimisation with decoupled constraints on mean and stddev.

Abdolmaleki et al. 2018b (arXiv 1812.02256); the action penalty is the special case of
multi-objective MPO in Abdolmaleki et al. 2020 (arXiv 2005.07513). Losses are per example: their
mean over the batch is what Acme's MPO loss and `rlax.mpo_loss` minimise, which the tests check.

Shape letters: B examples (states), N sampled actions, D action size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
import torch
import torch.nn.functional as F  # noqa: N812 - torch's own customary name
from msgspec import Meta
from torch import Tensor, nn

from gfm.core import ShapeError
from gfm.rl.gaussian import Gaussian, kl_per_dimension

_POSITIVE_FLOOR = 1e-8
_LOG_DUAL_FLOOR = -18.0

Positive = Annotated[float, Meta(gt=0.0)]


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How far one policy may be from the last; Acme's values where no other source is named.

    Attributes:
        epsilon: KL of the improved, non-parametric policy from the target policy, nats.
        epsilon_penalty: The same for the penalty of actions outside [-1, 1], nats.
        epsilon_mean: KL through the mean, nats (per action dimension if `per_dimension`).
        epsilon_stddev: KL through the stddev, nats (likewise).
        per_dimension: Whether every action dimension has constraints of its own.
        action_penalty: Whether sampled actions outside [-1, 1] are penalised.
    """

    epsilon: Positive = 0.1
    epsilon_penalty: Positive = 1e-3
    epsilon_mean: Positive = 2.5e-3
    epsilon_stddev: Positive = 1e-6
    per_dimension: bool = True
    action_penalty: bool = True


class Duals(nn.Module):
    """The Lagrange multipliers, kept before the softplus that makes them positive."""

    def __init__(
        self,
        action_size: int,
        limits: Limits,
        *,
        log_temperature: float = 10.0,
        log_alpha_mean: float = 10.0,
        log_alpha_stddev: float = 1000.0,
    ) -> None:
        super().__init__()
        size = action_size if limits.per_dimension else 1
        self.log_temperature = nn.Parameter(torch.tensor(log_temperature))
        self.log_penalty_temperature = nn.Parameter(torch.tensor(log_temperature))
        self.log_alpha_mean = nn.Parameter(torch.full((size,), log_alpha_mean))
        self.log_alpha_stddev = nn.Parameter(torch.full((size,), log_alpha_stddev))

    @torch.no_grad()
    def clamp(self) -> None:
        """Keeps every multiplier where its softplus still has a gradient; call after each step."""
        for parameter in self.parameters():
            parameter.clamp_(min=_LOG_DUAL_FLOOR)


@dataclass(frozen=True, kw_only=True)
class MPOStats:
    """What one evaluation of the loss tells, without gradients.

    Attributes:
        policy_loss: Weighted cross entropies, shape (B,).
        temperature: Of the exponentiated Q, shape ().
        penalty_temperature: Of the action penalty, shape ().
        alpha_mean: Multipliers of the mean's constraints, shape (D,) or (1,).
        alpha_stddev: Multipliers of the stddev's constraints, shape (D,) or (1,).
        kl_q: KL of the improved from the target policy, as sampled; hovers near epsilon, (B,).
        kl_penalty: The same for the penalty, shape (B,).
        kl_mean: KL(target || online) through the mean, shape (B, D) or (B, 1).
        kl_stddev: KL(target || online) through the stddev, shape (B, D) or (B, 1).
        outside: Share of the sampled actions that left [-1, 1] in any dimension, shape (B,).
    """

    policy_loss: Tensor
    temperature: Tensor
    penalty_temperature: Tensor
    alpha_mean: Tensor
    alpha_stddev: Tensor
    kl_q: Tensor
    kl_penalty: Tensor
    kl_mean: Tensor
    kl_stddev: Tensor
    outside: Tensor


def mpo_loss(
    *, online: Gaussian, target: Gaussian, actions: Tensor, q: Tensor, duals: Duals, limits: Limits
) -> tuple[Tensor, MPOStats]:
    """Returns the loss of policy and duals for every state, shape (B,), and statistics.

    Gradients reach the parameters behind `online` and the duals; nothing else.

    Args:
        online: The policy to improve at the B states, shape (B, D).
        target: The policy that it may not leave too far, shape (B, D).
        actions: Samples of `target`, shape (N, B, D).
        q: Their action values, shape (N, B).
        duals: The Lagrange multipliers.
        limits: The constraints they stand for.
    """
    if q.shape != actions.shape[:-1]:
        raise ShapeError("q", tuple(q.shape), str(tuple(actions.shape[:-1])))
    target, actions, q = target.detach(), actions.detach(), q.detach()
    temperature = _positive(duals.log_temperature)
    weights, dual_loss = _improve(q, temperature, limits.epsilon)
    kl_q = _kl_from_uniform(weights)

    penalty_temperature = _positive(duals.log_penalty_temperature)
    excess = torch.linalg.vector_norm(actions - actions.clamp(-1.0, 1.0), dim=-1)
    penalty_weights, penalty_loss = _improve(-excess, penalty_temperature, limits.epsilon_penalty)
    if limits.action_penalty:  # two objectives: the weights sum to 2, as in Acme
        weights = weights + penalty_weights
        dual_loss = dual_loss + penalty_loss

    fixed_stddev = Gaussian(mean=online.mean, stddev=target.stddev)
    fixed_mean = Gaussian(mean=target.mean, stddev=online.stddev)
    log_prob = fixed_stddev.log_prob(actions) + fixed_mean.log_prob(actions)
    policy_loss = -(weights * log_prob).sum(0)

    kl_mean = _constrained_kl(target, fixed_stddev, per_dimension=limits.per_dimension)
    kl_stddev = _constrained_kl(target, fixed_mean, per_dimension=limits.per_dimension)
    alpha_mean, alpha_stddev = _positive(duals.log_alpha_mean), _positive(duals.log_alpha_stddev)
    loss = (
        policy_loss
        + dual_loss
        + _lagrangian(kl_mean, alpha_mean, limits.epsilon_mean)
        + _lagrangian(kl_stddev, alpha_stddev, limits.epsilon_stddev)
    )
    return loss, MPOStats(
        policy_loss=policy_loss.detach(),
        temperature=temperature.detach(),
        penalty_temperature=penalty_temperature.detach(),
        alpha_mean=alpha_mean.detach(),
        alpha_stddev=alpha_stddev.detach(),
        kl_q=kl_q,
        kl_penalty=_kl_from_uniform(penalty_weights),
        kl_mean=kl_mean.detach(),
        kl_stddev=kl_stddev.detach(),
        outside=(excess > 0.0).to(q.dtype).mean(0),
    )


def _positive(log_dual: Tensor) -> Tensor:
    # torch's default threshold of 20 would be wrong by 2e-9 there.
    return F.softplus(log_dual, threshold=40.0) + _POSITIVE_FLOOR


def _improve(q: Tensor, temperature: Tensor, epsilon: float) -> tuple[Tensor, Tensor]:
    """Returns the improved policy's weights (N, B), without gradients, and the dual's loss (B,).

    1812.02256, section 4.1: g(T) = T * (epsilon + log mean_N exp(Q / T)).
    """
    tempered = q / temperature
    log_mean = torch.logsumexp(tempered, dim=0) - math.log(len(q))
    return torch.softmax(tempered.detach(), dim=0), temperature * (epsilon + log_mean)


def _kl_from_uniform(weights: Tensor) -> Tensor:
    return (weights * torch.log(len(weights) * weights + 1e-8)).sum(0)


def _constrained_kl(target: Gaussian, online: Gaussian, *, per_dimension: bool) -> Tensor:
    kl = kl_per_dimension(target, online)
    return kl if per_dimension else kl.sum(-1, keepdim=True)


def _lagrangian(kl: Tensor, alpha: Tensor, epsilon: float) -> Tensor:
    """Returns the penalty on the policy plus the multiplier's loss, per example, shape (B,)."""
    return (alpha.detach() * kl + alpha * (epsilon - kl.detach())).sum(-1)
