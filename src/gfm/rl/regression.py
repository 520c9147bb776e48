"""A policy that begins where regression ends: the network fitted to known good actions.

Shape letters: N examples, O observation size, A action size.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np
import torch
from msgspec import Meta
from numpy.typing import NDArray
from torch import Tensor

from gfm.core import BadInputError
from gfm.core.checks import Array, Array32
from gfm.rl.learner import Count, Widths
from gfm.rl.mpo import Positive
from gfm.rl.networks import Normaliser, PolicyNetwork, inverse_softplus

_BLOCKS = 20


class RegressionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How to fit.

    Attributes:
        hidden: Widths of the policy's hidden layers; the learner's, if it shall go on from here.
        learning_rate: Adam's.
        batch_size: Examples per step.
        held_out: Share of the examples that decides when to stop.
        patience: Epochs without a better held-out error before it stops.
        max_epochs: Epochs after which it stops anyway.
        least_stddev: The policy's stddev is the held-out residual, but at least this.
        greatest_stddev: And at most this.
    """

    hidden: Widths = (200, 200)
    learning_rate: Positive = 1e-3
    batch_size: Count = 256
    held_out: Annotated[float, Meta(ge=0.05, le=0.5)] = 0.2
    patience: Count = 10
    max_epochs: Count = 200
    least_stddev: Positive = 0.05
    greatest_stddev: Positive = 0.5


@dataclass(frozen=True, kw_only=True)
class FittedPolicy:
    """What came of it.

    Attributes:
        tensors: The policy's parameters, as `Weights.tensors` and `GaussianPolicy` take them.
        held_out_rmse: Of the best epoch, per action dimension, shape (A,).
        target_rms: What predicting zero would have cost on the same examples, shape (A,).
        epochs: Epochs until the best one.
    """

    tensors: Mapping[str, Array32]
    held_out_rmse: Array
    target_rms: Array
    epochs: int


def fit_policy(
    observation: NDArray[np.floating],
    action: NDArray[np.floating],
    settings: RegressionSettings,
    seed: int,
) -> FittedPolicy:
    """Returns a policy whose mean is regressed on `action`; the same one for the same seed.

    The examples held out are whole stretches of consecutive rows, because neighbouring rows of a
    recording are nearly copies of each other.

    Args:
        observation: Finite, in the order in which they were recorded, shape (N, O).
        action: Wanted at each observation; what lies outside [-1, 1] is clipped, shape (N, A).
        settings: How to fit.
        seed: Of the split, the first weights and the order of the examples.
    """
    inputs, targets = _checked(observation, action)
    generator = torch.Generator().manual_seed(seed)
    held_out = _held_out(len(inputs), settings.held_out, generator)
    normaliser = Normaliser(inputs.shape[1])
    normaliser.update(inputs[~held_out])
    scaled = normaliser(inputs)
    policy = _first_policy(inputs.shape[1], targets.shape[1], settings, seed)
    training = scaled[~held_out], targets[~held_out]
    rmse, epochs = _train(
        policy, training, (scaled[held_out], targets[held_out]), settings, generator
    )
    _set_stddev(policy, rmse, settings)
    tensors = policy.state_dict() | {"shift": normaliser.shift, "scale": normaliser.scale}
    return FittedPolicy(
        tensors={name: np.array(tensor.numpy()) for name, tensor in tensors.items()},
        held_out_rmse=rmse.double().numpy(),
        target_rms=_rms(targets[held_out]).double().numpy(),
        epochs=epochs,
    )


def _checked(
    observation: NDArray[np.floating], action: NDArray[np.floating]
) -> tuple[Tensor, Tensor]:
    if observation.ndim != 2 or action.ndim != 2 or len(observation) != len(action):
        raise BadInputError(
            f"observation {observation.shape} and action {action.shape}: expected (N, O) and (N, A)"
        )
    if len(observation) < _BLOCKS:
        raise BadInputError(f"{len(observation)} examples to fit, expected at least {_BLOCKS}")
    if not (np.isfinite(observation).all() and np.isfinite(action).all()):
        raise BadInputError("examples to fit hold NaN or infinity, expected finite numbers")
    inputs = torch.tensor(np.asarray(observation), dtype=torch.float32)
    return inputs, torch.tensor(np.asarray(action), dtype=torch.float32).clamp(-1.0, 1.0)


def _held_out(count: int, share: float, generator: torch.Generator) -> Tensor:
    """Returns which of `count` consecutive rows are held out, as whole blocks, shape (N,)."""
    block = torch.arange(count) * _BLOCKS // count
    chosen = torch.randperm(_BLOCKS, generator=generator)[: max(1, round(share * _BLOCKS))]
    return torch.isin(block, chosen)


def _first_policy(
    observation_size: int, action_size: int, settings: RegressionSettings, seed: int
) -> PolicyNetwork:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return PolicyNetwork(
            observation_size,
            action_size,
            settings.hidden,
            initial_stddev=settings.least_stddev,
        )


def _train(
    policy: PolicyNetwork,
    training: tuple[Tensor, Tensor],
    held_out: tuple[Tensor, Tensor],
    settings: RegressionSettings,
    generator: torch.Generator,
) -> tuple[Tensor, int]:
    """Fits the policy in place; returns the best epoch's held-out RMSE (A,) and its number."""
    optimiser = torch.optim.Adam(policy.parameters(), lr=settings.learning_rate)
    best, best_epoch, parameters = (
        _held_out_rmse(policy, held_out),
        0,
        deepcopy(policy.state_dict()),
    )
    for epoch in range(1, settings.max_epochs + 1):
        order = torch.randperm(len(training[0]), generator=generator)
        for rows in torch.split(order, settings.batch_size):
            error = policy(training[0][rows]).mean - training[1][rows]
            optimiser.zero_grad()
            error.square().sum(-1).mean().backward()
            optimiser.step()
        rmse = _held_out_rmse(policy, held_out)
        if rmse.norm() < best.norm():
            best, best_epoch, parameters = rmse, epoch, deepcopy(policy.state_dict())
        elif epoch - best_epoch >= settings.patience:
            break
    policy.load_state_dict(parameters)
    return best, best_epoch


@torch.no_grad()
def _held_out_rmse(policy: PolicyNetwork, held_out: tuple[Tensor, Tensor]) -> Tensor:
    return _rms(policy(held_out[0]).mean - held_out[1])


def _rms(values: Tensor) -> Tensor:
    return values.square().mean(0).sqrt()


@torch.no_grad()
def _set_stddev(policy: PolicyNetwork, rmse: Tensor, settings: RegressionSettings) -> None:
    """Makes the stddev the residual's, the same at every observation."""
    stddev = rmse.clamp(settings.least_stddev, settings.greatest_stddev)
    policy.stddev.weight.zero_()
    policy.stddev.bias.copy_(torch.tensor([inverse_softplus(float(value)) for value in stddev]))
