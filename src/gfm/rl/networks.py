"""The networks: a Gaussian policy, an action-value critic, and the scaling of what they see.

Shape letters: E* any leading dimensions, O observation size, A action size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

from gfm.rl.gaussian import Gaussian

STDDEV_FLOOR = 1e-6
SCALE_FLOOR = 1e-3
_LAST_LAYER_GAIN = 1e-2


class Normaliser(nn.Module):
    """Shifts and scales observations by the statistics of those it was shown.

    It is shown the learner's first batches and then stays as it is, so that the inputs of the
    networks stop moving. A network and its target share one.
    """

    fixed: Tensor
    shift: Tensor
    scale: Tensor
    square: Tensor
    count: Tensor

    def __init__(self, observation_size: int) -> None:
        super().__init__()
        self.register_buffer("fixed", torch.tensor(data=False))
        self.register_buffer("shift", torch.zeros(observation_size))
        self.register_buffer("scale", torch.ones(observation_size))
        self.register_buffer("square", torch.zeros(observation_size))
        self.register_buffer("count", torch.zeros(()))

    def forward(self, observation: Tensor) -> Tensor:
        """Returns observations of about zero mean and unit variance, shape (E*, O)."""
        return (observation - self.shift) / self.scale

    @torch.no_grad()
    def update(self, observation: Tensor) -> None:
        """Takes observations (E*, O) into the running mean and variance (Chan et al. 1983)."""
        if self.fixed:
            return
        rows = observation.reshape(-1, observation.shape[-1])
        total = self.count + len(rows)
        offset = rows.mean(0) - self.shift
        spread = rows.var(0, correction=0) * len(rows)
        self.square += spread + offset.square() * self.count * len(rows) / total
        self.shift += offset * len(rows) / total
        self.count.copy_(total)
        self.scale.copy_((self.square / total).sqrt().clamp(min=SCALE_FLOOR))


class PolicyNetwork(nn.Module):
    """Two hidden layers (by default), then mean and stddev of a diagonal Gaussian.

    The paper's network, with two habits of Acme's MPO added: a layer norm and tanh after the first
    layer, and a last layer that starts near zero, so that the first policy is the same everywhere.
    The mean is not squashed; what leaves [-1, 1] is penalised by the loss and clipped by
    environments and critic.
    """

    def __init__(
        self,
        observation_size: int,
        action_size: int,
        hidden: Sequence[int],
        *,
        initial_stddev: float,
    ) -> None:
        super().__init__()
        self.first = nn.Linear(observation_size, hidden[0])
        self.norm = nn.LayerNorm(hidden[0])
        self.hidden = _hidden_layers(hidden)
        self.mean = nn.Linear(hidden[-1], action_size)
        self.stddev = nn.Linear(hidden[-1], action_size)
        with torch.no_grad():
            for head in (self.mean, self.stddev):
                head.weight.mul_(_LAST_LAYER_GAIN)
                head.bias.zero_()
            self.stddev.bias.fill_(inverse_softplus(initial_stddev))

    def forward(self, observation: Tensor) -> Gaussian:
        """Returns the distribution over actions at scaled observations (E*, O)."""
        features = torch.tanh(self.norm(self.first(observation)))
        for layer in self.hidden:
            features = functional.elu(layer(features))
        stddev = functional.softplus(self.stddev(features)) + STDDEV_FLOOR
        return Gaussian(mean=self.mean(features), stddev=stddev)


class CriticNetwork(nn.Module):
    """Q of an observation and an action, clipped to [-1, 1] as the environments do.

    The first layer's products with observation and action are taken apart, so that N actions at
    one observation cost one product with the (long) observation, not N. Rectifiers, where the
    policy has smooth units: they see N times as many rows, and tanh and exp cost as much there as
    the matrix products.
    """

    def __init__(self, observation_size: int, action_size: int, hidden: Sequence[int]) -> None:
        super().__init__()
        joint = nn.Linear(observation_size + action_size, hidden[0])
        self.first = nn.Linear(observation_size, hidden[0])
        self.action = nn.Linear(action_size, hidden[0], bias=False)
        self.norm = nn.LayerNorm(hidden[0])
        self.hidden = _hidden_layers(hidden)
        self.value = nn.Linear(hidden[-1], 1)
        with torch.no_grad():
            self.first.weight.copy_(joint.weight[:, :observation_size])
            self.action.weight.copy_(joint.weight[:, observation_size:])
            self.value.weight.mul_(_LAST_LAYER_GAIN)
            self.value.bias.zero_()

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Returns Q, shape (..., E*).

        Args:
            observation: Scaled, shape (E*, O).
            action: shape (..., E*, A); any number of actions for each observation.
        """
        joint = self.first(observation) + self.action(action.clamp(-1.0, 1.0))
        features = functional.relu(self.norm(joint))
        for layer in self.hidden:
            features = functional.relu(layer(features))
        value: Tensor = self.value(features).squeeze(-1)
        return value


def inverse_softplus(value: float) -> float:
    """Returns x with log(1 + exp(x)) = value, for value > 0."""
    return value + math.log(-math.expm1(-value))


def _hidden_layers(hidden: Sequence[int]) -> nn.ModuleList:
    return nn.ModuleList(nn.Linear(inputs, outputs) for inputs, outputs in pairwise(hidden))
