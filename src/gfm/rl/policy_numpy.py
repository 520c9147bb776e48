"""The policy as actors, evaluation and diagnosis use it: NumPy only, no torch.

Shape letters: N observations, O observation size, A action size.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gfm.core import BadInputError, ShapeError, Weights
from gfm.core.checks import Array32

STDDEV_FLOOR = 1e-6
_NORM_EPSILON = 1e-5
_LOG_TWO_PI = np.float32(np.log(2.0 * np.pi))
_REQUIRED = (
    *("shift", "scale", "first.weight", "first.bias", "norm.weight", "norm.bias"),
    *("mean.weight", "mean.bias", "stddev.weight", "stddev.bias"),
)


@dataclass(frozen=True, kw_only=True)
class Layer:
    """One affine map.

    Attributes:
        weight: Transposed for row vectors: inputs first.
        bias: One per output.
    """

    weight: Array32
    bias: Array32

    def __call__(self, inputs: Array32) -> Array32:
        """Returns the outputs for rows of inputs."""
        outputs: Array32 = inputs @ self.weight
        outputs += self.bias
        return outputs


@dataclass(frozen=True, kw_only=True)
class GaussianPolicy:
    """The same function as `gfm.rl.networks.PolicyNetwork` behind its normaliser.

    Attributes:
        first: Takes raw observations: the normaliser is folded in.
        norm_weight: Of the layer norm after it.
        norm_bias: Of the layer norm after it.
        hidden: The further hidden layers.
        mean: Head of the mean.
        stddev: Head of the stddev, before the softplus.
    """

    first: Layer
    norm_weight: Array32
    norm_bias: Array32
    hidden: tuple[Layer, ...]
    mean: Layer
    stddev: Layer

    @classmethod
    def from_weights(cls, weights: Weights | Mapping[str, Array32]) -> GaussianPolicy:
        """Returns the policy that published weights, or their tensors, describe."""
        tensors = weights.tensors if isinstance(weights, Weights) else weights
        missing = [name for name in _REQUIRED if name not in tensors]
        if missing:
            raise BadInputError(f"policy weights lack {', '.join(missing)}")
        numbers = [re.fullmatch(r"hidden\.(\d+)\.weight", name) for name in tensors]
        depth = sum(found is not None for found in numbers)
        return cls(
            first=_folded(tensors),
            norm_weight=tensors["norm.weight"],
            norm_bias=tensors["norm.bias"],
            hidden=tuple(_layer(tensors, f"hidden.{index}") for index in range(depth)),
            mean=_layer(tensors, "mean"),
            stddev=_layer(tensors, "stddev"),
        )

    @property
    def observation_size(self) -> int:
        """O."""
        return len(self.first.weight)

    @property
    def action_size(self) -> int:
        """A."""
        return len(self.mean.bias)

    def mean_action(self, observation: Array32) -> Array32:
        """Returns the mean action clipped to [-1, 1], shape (N, A).

        Args:
            observation: shape (N, O).
        """
        action: Array32 = np.clip(self.mean(self._features(observation)), -1.0, 1.0)
        return action

    def sample(self, observation: Array32, rng: np.random.Generator) -> tuple[Array32, Array32]:
        """Returns sampled actions, not clipped, shape (N, A), and their log densities, (N,).

        Args:
            observation: shape (N, O).
            rng: Where chance comes from.
        """
        features = self._features(observation)
        stddev = _softplus(self.stddev(features)) + np.float32(STDDEV_FLOOR)
        noise = rng.standard_normal(stddev.shape, dtype=np.float32)
        log_prob = -0.5 * (np.square(noise) + _LOG_TWO_PI) - np.log(stddev)
        return self.mean(features) + stddev * noise, log_prob.sum(-1)

    def _features(self, observation: Array32) -> Array32:
        if observation.ndim != 2 or observation.shape[1] != self.observation_size:
            raise ShapeError("observation", observation.shape, f"(N, {self.observation_size})")
        joint = self.first(observation)
        joint -= joint.mean(-1, keepdims=True)
        spread = np.square(joint).mean(-1, keepdims=True) + np.float32(_NORM_EPSILON)
        joint *= self.norm_weight / np.sqrt(spread)
        features: Array32 = np.tanh(joint + self.norm_bias)
        for layer in self.hidden:
            features = _elu(layer(features))
        return features


def _layer(tensors: Mapping[str, Array32], name: str) -> Layer:
    weight = np.ascontiguousarray(tensors[f"{name}.weight"].T)
    return Layer(weight=weight, bias=tensors[f"{name}.bias"])


def _folded(tensors: Mapping[str, Array32]) -> Layer:
    """Returns W (x - shift) / scale + b as one layer, folded in double precision."""
    weight = tensors["first.weight"].astype(np.float64) / tensors["scale"]
    bias = tensors["first.bias"] - weight @ tensors["shift"]
    return Layer(
        weight=np.ascontiguousarray(weight.T, dtype=np.float32), bias=bias.astype(np.float32)
    )


def _elu(values: Array32) -> Array32:
    return np.where(values > 0.0, values, np.expm1(np.minimum(values, 0.0)))


def _softplus(values: Array32) -> Array32:
    return np.logaddexp(values, np.float32(0.0))
