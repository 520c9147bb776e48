"""A policy that begins where regression ends: the network fitted to known good actions.

An action may be given some of the observation to begin with: the weights of everything else are
then zero, and so are those between the hidden units of actions that are given different inputs.
From some thousand examples along a few recordings, a network that sees everything learns what the
inputs happened to have to do with each other in these recordings.

Shape letters: N examples, O observation size, A action size.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import msgspec
import numpy as np
import torch
from msgspec import Meta
from numpy.typing import NDArray
from torch import Tensor

from gfm.core import BadInputError
from gfm.core.checks import Array, Array32
from gfm.rl.learner_state import Count, Widths
from gfm.rl.mpo import Positive
from gfm.rl.networks import Normaliser, PolicyNetwork, inverse_softplus

_LEAST_EXAMPLES = 20
_RISING_SHARE = 0.1

Mask = NDArray[np.bool_]


class RegressionSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How to fit.

    Attributes:
        hidden: Widths of the policy's hidden layers; the learner's, if it shall go on from here.
        learning_rate: Adam's at its height: it rises, then falls to nothing (one cycle).
        batch_size: Examples per step.
        epochs: Times that every example is seen; 0 leaves the policy as it is drawn.
        input_noise: Standard deviation of what is added to scaled inputs, anew each time: the
            policy cannot follow what is finer (Bishop 1995: as a penalty on its slope).
        weight_decay: Adam's, apart from the gradient (Loshchilov and Hutter 2019).
        least_stddev: The policy's stddev is what the fit leaves, but at least this.
        greatest_stddev: And at most this.
    """

    hidden: Widths = (200, 200)
    learning_rate: Positive = 2e-3
    batch_size: Count = 256
    epochs: Annotated[int, Meta(ge=0)] = 120
    input_noise: Annotated[float, Meta(ge=0.0)] = 0.0
    weight_decay: Annotated[float, Meta(ge=0.0)] = 0.0
    least_stddev: Positive = 0.05
    greatest_stddev: Positive = 0.5


@dataclass(frozen=True, kw_only=True)
class FittedPolicy:
    """What came of it.

    Attributes:
        tensors: The policy's parameters, as `Weights.tensors` and `GaussianPolicy` take them.
        rmse: On the examples, per action dimension, shape (A,).
    """

    tensors: Mapping[str, Array32]
    rmse: Array


def fit_policy(
    observation: NDArray[np.floating],
    action: NDArray[np.floating],
    settings: RegressionSettings,
    seed: int,
    inputs: Mask | None = None,
) -> FittedPolicy:
    """Returns a policy whose mean is regressed on `action`; the same one for the same seed.

    Args:
        observation: Finite, shape (N, O).
        action: Wanted at each observation; what lies outside [-1, 1] is clipped, shape (N, A).
        settings: How to fit.
        seed: Of the first weights and the order of the examples.
        inputs: Which of the observation each action is given, shape (A, O); all by default.
    """
    features, targets = _checked(observation, action)
    normaliser = Normaliser(features.shape[1])
    normaliser.update(features)
    policy, masks = _first_policy(features.shape[1], targets.shape[1], settings, seed, inputs)
    scaled = normaliser(features)
    with _one_thread():
        if settings.epochs:
            _train(policy, masks, (scaled, targets), settings, seed)
    with torch.no_grad():
        rmse = (policy(scaled).mean - targets).square().mean(0).sqrt()
    _set_stddev(policy, rmse, settings)
    tensors = policy.state_dict() | {"shift": normaliser.shift, "scale": normaliser.scale}
    return FittedPolicy(
        tensors={name: np.array(tensor.numpy()) for name, tensor in tensors.items()},
        rmse=rmse.double().numpy(),
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """Layers this small gain nothing from more, and lose much where cores are busy."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _checked(
    observation: NDArray[np.floating], action: NDArray[np.floating]
) -> tuple[Tensor, Tensor]:
    if observation.ndim != 2 or action.ndim != 2 or len(observation) != len(action):
        raise BadInputError(
            f"observation {observation.shape} and action {action.shape}: expected (N, O) and (N, A)"
        )
    if len(observation) < _LEAST_EXAMPLES:
        raise BadInputError(
            f"{len(observation)} examples to fit, expected at least {_LEAST_EXAMPLES}"
        )
    if not (np.isfinite(observation).all() and np.isfinite(action).all()):
        raise BadInputError("examples to fit hold NaN or infinity, expected finite numbers")
    inputs = torch.tensor(np.asarray(observation), dtype=torch.float32)
    return inputs, torch.tensor(np.asarray(action), dtype=torch.float32).clamp(-1.0, 1.0)


def _first_policy(
    observation_size: int,
    action_size: int,
    settings: RegressionSettings,
    seed: int,
    inputs: Mask | None,
) -> tuple[PolicyNetwork, dict[str, Tensor]]:
    """Returns the network before the fit, and where its weights are free, by name."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        policy = PolicyNetwork(
            observation_size,
            action_size,
            settings.hidden,
            initial_stddev=settings.least_stddev,
        )
    given = np.ones((action_size, observation_size), bool) if inputs is None else inputs
    masks = _masks(given, settings.hidden)
    with torch.no_grad():
        for name, mask in masks.items():
            parameter = policy.get_parameter(name)
            # As many fewer inputs as there are, so much larger they count: as in a small network.
            share = mask.mean(1, keepdim=True).clamp(min=1e-9)
            parameter.mul_(mask / share.sqrt())
    return policy, masks


def _masks(inputs: Mask, hidden: Widths) -> dict[str, Tensor]:
    """Returns 1 for weights of what an action is given, else 0; hidden units are shared out."""
    groups, group_of_action = np.unique(inputs, axis=0, return_inverse=True)
    owners = [np.arange(width) * len(groups) // width for width in hidden]
    masks = {"first.weight": groups[owners[0]]}
    for index, (before, after) in enumerate(pairwise(owners)):
        masks[f"hidden.{index}.weight"] = after[:, None] == before
    masks["mean.weight"] = group_of_action.reshape(-1, 1) == owners[-1]
    return {name: torch.tensor(mask, dtype=torch.float32) for name, mask in masks.items()}


def _train(
    policy: PolicyNetwork,
    masks: Mapping[str, Tensor],
    examples: tuple[Tensor, Tensor],
    settings: RegressionSettings,
    seed: int,
) -> None:
    """Fits the policy in place."""
    generator = torch.Generator().manual_seed(seed)
    inputs, targets = examples
    optimiser = torch.optim.AdamW(
        policy.parameters(),
        lr=settings.learning_rate,
        weight_decay=settings.weight_decay,
        fused=True,
    )
    cycle = torch.optim.lr_scheduler.OneCycleLR(
        optimiser,
        max_lr=settings.learning_rate,
        total_steps=settings.epochs * -(-len(inputs) // settings.batch_size),
        pct_start=_RISING_SHARE,
    )
    masked = [(policy.get_parameter(name), mask) for name, mask in masks.items()]
    for _ in range(settings.epochs):
        order = torch.randperm(len(inputs), generator=generator)
        for rows in torch.split(order, settings.batch_size):
            seen = inputs[rows]
            blur = settings.input_noise * torch.randn(seen.shape, generator=generator)
            error = policy(seen + blur).mean - targets[rows]
            optimiser.zero_grad()
            error.square().sum(-1).mean().backward()
            with torch.no_grad():
                for parameter, mask in masked:
                    if parameter.grad is not None:
                        parameter.grad.mul_(mask)
            optimiser.step()
            cycle.step()


@torch.no_grad()
def _set_stddev(policy: PolicyNetwork, rmse: Tensor, settings: RegressionSettings) -> None:
    """Makes the stddev what the fit leaves, the same at every observation."""
    stddev = rmse.clamp(settings.least_stddev, settings.greatest_stddev)
    policy.stddev.weight.zero_()
    policy.stddev.bias.copy_(torch.tensor([inverse_softplus(float(value)) for value in stddev]))
