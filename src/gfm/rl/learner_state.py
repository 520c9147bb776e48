"""What a learner has learned: settings, networks, optimiser, and their arrays by name.

Shape letters: E* the examples, O observation size.
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

from gfm.core import EnvironmentSpec
from gfm.core.checks import Array32
from gfm.rl.mpo import Duals, Limits, Positive
from gfm.rl.networks import CriticNetwork, Normaliser, PolicyNetwork

Fraction = Annotated[float, Meta(ge=0.0, le=1.0)]
Count = Annotated[int, Meta(ge=1)]
Widths = Annotated[tuple[Count, ...], Meta(min_length=1)]

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
