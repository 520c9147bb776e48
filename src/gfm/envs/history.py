"""The newest state and how it came about.

Shape letters: N instances, n of them, X state size, H states.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array, Array32


@final
class History:
    """The last H states of N instances.

    Observed as the newest state, and the way from each earlier one to the one after it: the same
    as the H states themselves, in numbers of like size. Twenty states a second differ by
    millimetres where they lie within decimetres.
    """

    def __init__(self, num_envs: int, states: int, size: int) -> None:
        """Keeps room for `states` states of `size` numbers for every instance."""
        self._states: Array = np.zeros((num_envs, states, size))

    @property
    def newest(self) -> Array:
        """The newest states, shape (N, X)."""
        return np.asarray(self._states[:, 0])

    @property
    def size(self) -> int:
        """Numbers per observation, H times X."""
        return int(np.prod(self._states.shape[1:]))

    def fill(self, ids: NDArray[np.intp], state: Array) -> None:
        """Lets the instances `ids` have rested in `state`, shape (n, X)."""
        self._states[ids] = state[:, None]

    def push(self, state: Array) -> None:
        """Makes `state`, shape (N, X), the newest."""
        self._states[:, 1:] = self._states[:, :-1].copy()
        self._states[:, 0] = state

    def observed(self, step_scale: float) -> Array32:
        """Returns newest states and steps, the latter divided by `step_scale`, (N, H * X)."""
        steps = (self._states[:, :-1] - self._states[:, 1:]) / step_scale
        rows = np.concatenate([self._states[:, :1], steps], axis=1)
        return rows.reshape(len(rows), -1).astype(np.float32)
