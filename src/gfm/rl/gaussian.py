"""Diagonal Gaussians over actions.

Shape letters: E* any leading dimensions, N samples, D action size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

_LOG_ROOT_TWO_PI = 0.5 * math.log(2.0 * math.pi)


@dataclass(frozen=True, kw_only=True)
class Gaussian:
    """A distribution over actions whose dimensions are independent.

    Attributes:
        mean: shape (E*, D).
        stddev: Positive, shape (E*, D).
    """

    mean: Tensor
    stddev: Tensor

    def __getitem__(self, key: slice) -> Gaussian:
        """Returns the distributions at `key` of the first dimension."""
        return Gaussian(mean=self.mean[key], stddev=self.stddev[key])

    def detach(self) -> Gaussian:
        """Returns the same distribution without gradients."""
        return Gaussian(mean=self.mean.detach(), stddev=self.stddev.detach())

    def sample(self, count: int, generator: torch.Generator) -> Tensor:
        """Returns independent samples without gradients, shape (N, E*, D)."""
        mean = self.mean.detach()
        noise = torch.empty((count, *mean.shape), dtype=mean.dtype, device=mean.device)
        noise.normal_(generator=generator)
        return torch.addcmul(mean, self.stddev.detach(), noise)

    def log_prob(self, action: Tensor) -> Tensor:
        """Returns the log density of `action` (..., E*, D), summed over D, shape (..., E*)."""
        scaled = (action - self.mean) / self.stddev
        per_dimension = -0.5 * scaled.square() - self.stddev.log() - _LOG_ROOT_TWO_PI
        return per_dimension.sum(-1)


def kl_per_dimension(first: Gaussian, second: Gaussian) -> Tensor:
    """Returns KL(first || second) of every dimension, shape (E*, D)."""
    ratio = first.stddev / second.stddev
    distance = (first.mean - second.mean) / second.stddev
    return 0.5 * (ratio.square() + distance.square() - 1.0) - ratio.log()
