"""Retrace: off-policy returns from sequences of stored behaviour.

Shape letters: T transitions, E* the examples (usually B sequences).
"""

from __future__ import annotations

import torch
from torch import Tensor

from gfm.core import ShapeError


def trace_coefficients(log_rho_t: Tensor, lambda_: float) -> Tensor:
    """Returns c_t = lambda * min(1, exp(log_rho_t)), the shape of `log_rho_t`.

    Munos et al. 2016, eq. 5. `log_rho_t` is the log density of the stored action under the policy
    that is evaluated, minus the one under the policy that acted.
    """
    return lambda_ * log_rho_t.clamp(max=0.0).exp()


def retrace_targets(
    q_t: Tensor, v_t: Tensor, r_t: Tensor, discount_t: Tensor, c_t: Tensor
) -> Tensor:
    """Returns G_0..G_{T-1}, the regression targets for Q of the taken actions, shape (T, E*).

    G_{T-1} = r_T + discount_T * v_T, and backwards from there
    G_t = r_{t+1} + discount_{t+1} * (v_{t+1} + c_{t+1} * (G_{t+1} - q_{t+1})).

    Munos et al. 2016, eq. 4, for a finite sequence that bootstraps from its last observation. A
    discount of 0 (the episode terminated) removes the bootstrap and the trace; the end of the
    sequence cuts the trace and keeps the bootstrap, also where that end is a time limit.
    Gradients flow through every argument: a caller that wants constants detaches.

    Args:
        q_t: Q of the taken actions at observations 1..T-1, shape (T-1, E*).
        v_t: Expected Q under the evaluated policy at observations 1..T, shape (T, E*).
        r_t: Rewards of the transitions into observations 1..T, shape (T, E*).
        discount_t: Discounts of the same transitions, in [0, 1], shape (T, E*).
        c_t: Trace coefficients at observations 1..T-1, lambda included, shape (T-1, E*).
    """
    steps = len(r_t)
    _check(v_t=(v_t, r_t.shape), discount_t=(discount_t, r_t.shape))
    _check(q_t=(q_t, (steps - 1, *r_t.shape[1:])), c_t=(c_t, (steps - 1, *r_t.shape[1:])))
    target = r_t[-1] + discount_t[-1] * v_t[-1]
    targets = [target]
    for t in range(steps - 2, -1, -1):
        target = r_t[t] + discount_t[t] * (v_t[t] + c_t[t] * (target - q_t[t]))
        targets.append(target)
    return torch.stack(targets[::-1])


def _check(**tensors: tuple[Tensor, tuple[int, ...]]) -> None:
    for name, (tensor, shape) in tensors.items():
        if tuple(tensor.shape) != tuple(shape):
            raise ShapeError(name, tuple(tensor.shape), str(tuple(shape)))
