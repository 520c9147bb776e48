"""The port of every learning problem: N instances of one environment, stepped together.

Shape letters: N instances, O observation size, A action size.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core import EnvironmentSpec
from gfm.core.checks import Array32


@dataclass(frozen=True, kw_only=True)
class Transition:
    """What one control step of every instance gave.

    Attributes:
        observation: After the step, before any reset, shape (N, O).
        reward: shape (N,).
        discount: 0 where the episode terminated, 1 elsewhere, also at a time limit, shape (N,).
        ended: Where the episode is over (terminated or out of time) and needs a reset, shape (N,).
    """

    observation: Array32
    reward: Array32
    discount: Array32
    ended: NDArray[np.bool_]


class BatchedEnvironment(ABC):
    """N instances of one environment. An instance that ended must be reset before the next step."""

    spec: EnvironmentSpec
    num_envs: int

    @abstractmethod
    def reset(self, ids: NDArray[np.intp] | None = None) -> Array32:
        """Starts new episodes in the instances `ids` (all by default).

        Returns:
            The current observation of every instance, also of those not reset, shape (N, O).
        """

    @abstractmethod
    def step(self, action: Array32) -> Transition:
        """Advances every instance by one control step.

        Args:
            action: In [-1, 1]; what lies outside is clipped, shape (N, A).
        """

    def set_progress(self, learner_steps: int) -> None:  # noqa: B027 - most problems stay the same
        """Tells how many steps the learner has made, for problems that get harder with them."""

    def gauges(self) -> Mapping[str, float]:
        """Returns what a status should tell of the episodes beside their return; may be empty."""
        return {}
