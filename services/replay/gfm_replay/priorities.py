"""Draws what a learner errs about more often (Schaul et al. 2016, proportional prioritisation).

Shape letters: B slots drawn or told of.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array32

_LEAST = 1e-6
"""Of a priority: what is learned may have to be learned again, and must not be out of reach."""


@final
class Priorities:
    """A tree of sums over slots: what is drawn, and what changes, costs its depth.

    A slot is drawn with a probability in proportion to its priority to the power of an exponent
    (equation 1 of the paper). What is new is as likely as the likeliest that was last told of.
    """

    def __init__(self, slots: int, exponent: float) -> None:
        """Makes a tree in which nothing can be drawn yet.

        Args:
            slots: How many there are.
            exponent: More than 0; 1 draws in proportion to the priority.
        """
        self._exponent = exponent
        self._leaves = 1 << (slots - 1).bit_length()
        self._sums = np.zeros(2 * self._leaves)
        self._newest = 1.0

    def add(self, slots: NDArray[np.intp]) -> None:
        """Makes slots as likely as what was last learned from, shape (B,)."""
        self._set(slots, np.full(len(slots), self._newest))

    def update(self, slots: NDArray[np.intp], priority: Array32) -> None:
        """Takes in what a learner says, each of shape (B,); of a slot said twice the last counts.

        Args:
            slots: Of what.
            priority: How much it errs about that, at least 0.
        """
        if len(slots):
            self._newest = max(float(priority.max()), _LEAST)
            self._set(slots, np.maximum(priority.astype(np.float64), _LEAST))

    def draw(
        self, count: int, rng: np.random.Generator
    ) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
        """Returns `count` slots, with replacement, and the probability of each, shape (B,)."""
        total = self._sums[1]
        rest = rng.random(count) * total
        node = np.ones(count, np.intp)
        while node[0] < self._leaves:
            node *= 2
            # Rounding must not lead to where there is nothing.
            right = (rest >= self._sums[node]) & (self._sums[node + 1] > 0.0)
            rest -= np.where(right, self._sums[node], 0.0)
            node += right
        return node - self._leaves, self._sums[node] / total

    def _set(self, slots: NDArray[np.intp], priority: NDArray[np.float64]) -> None:
        self._sums[self._leaves + slots] = priority**self._exponent
        node = np.unique((self._leaves + slots) // 2)
        while node[0] > 0:
            self._sums[node] = self._sums[2 * node] + self._sums[2 * node + 1]
            node = np.unique(node // 2)
