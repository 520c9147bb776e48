"""From commands to what drives follow.

Shape letters: B robots, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from known_truth.amounts import Amounts
from known_truth.robots import Array
from known_truth.run import Run


@final
class Commands:
    """Commands as they reach the drives: delayed, mixed within a time step, lagged."""

    def __init__(self, runs: Sequence[Run], hidden: Amounts) -> None:
        self._first = np.array([[run.first_command_step] for run in runs])
        self._every = np.array([[run.command_every] for run in runs])
        self._last = np.array([[len(run.reference) - 1] for run in runs])
        step_s = runs[0].step_s
        self._delay = hidden.delay / step_s
        self.values = np.zeros((len(runs), int(self._last.max()) + 1, hidden.delay.shape[1]))
        for i, run in enumerate(runs):
            self.values[i, : len(run.reference)] = run.reference
        self._rows, self._columns = np.ogrid[: len(runs), : hidden.delay.shape[1]]
        self._lagged = hidden.lag > 0.0
        lag = np.maximum(hidden.lag, 1e-12)
        self._decay = np.where(self._lagged, np.exp(-step_s / lag), 0.0)
        self._share = np.where(self._lagged, lag / step_s * (1.0 - self._decay), 0.0)
        self._followed: Array | None = None

    def due(self, step: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Returns the robots that are commanded at a step, and the numbers of their commands."""
        number, rest = np.divmod(step - self._first, self._every)
        rows = np.flatnonzero((rest == 0) & (number >= 0) & (number <= self._last))
        return rows, number[rows, 0]

    def just_before(self, step: int) -> Array:
        """Returns what the drives follow until a step, shape (B, J)."""
        place = (step - 1e-6 - self._first - self._delay) / self._every
        held = self._at(np.floor(place))
        return held if self._followed is None else np.where(self._lagged, self._followed, held)

    def mean(self, step: int) -> Array:
        """Returns the mean of what the drives follow during a step, shape (B, J); time passes."""
        place = (step - self._first - self._delay) / self._every
        ahead = place + 1.0 / self._every
        before, after = np.floor(place + 1e-9), np.floor(ahead - 1e-9)
        share = np.where(after > before, (ahead - after) * self._every, 0.0)
        old = self._at(before)
        target = old + share * (self._at(after) - old)
        behind = np.zeros_like(target) if self._followed is None else self._followed - target
        self._followed = target + behind * self._decay
        return np.asarray(target + behind * self._share)

    def _at(self, number: Array) -> Array:
        index = np.clip(number.astype(np.intp), 0, self._last)
        return np.asarray(self.values[self._rows, index, self._columns])
