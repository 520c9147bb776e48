"""Which instances are running, and for how long.

Shape letters: N instances, n of them.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core import BadInputError, ShapeError
from gfm.core.checks import Array32


@final
class Episodes:
    """Counts the steps of N instances and insists on resets."""

    def __init__(self, num_envs: int, horizon: int) -> None:
        self._horizon = horizon
        self._steps = np.zeros(num_envs, np.int64)
        self._running = np.zeros(num_envs, bool)

    def start(self, ids: NDArray[np.intp] | None) -> NDArray[np.intp]:
        """Starts the instances `ids`, all by default; returns their indices, shape (n,)."""
        chosen = np.arange(len(self._steps)) if ids is None else np.asarray(ids, np.intp)
        self._steps[chosen] = 0
        self._running[chosen] = True
        return chosen

    def tick(self, terminated: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Counts one step; returns who is over, terminated or out of time, shape (N,)."""
        self._steps += 1
        ended: NDArray[np.bool_] = terminated | (self._steps >= self._horizon)
        self._running = ~ended
        return ended

    def checked(self, action: Array32, size: int) -> Array32:
        """Returns actions clipped to [-1, 1].

        Raises:
            RuntimeError: an instance has ended (or never started) and was not reset.
            ShapeError: the actions are not of shape (N, size).
            BadInputError: an action is not finite.
        """
        if not self._running.all():
            waiting = np.flatnonzero(~self._running).tolist()
            raise RuntimeError(f"instances {waiting} have ended: reset them before the next step")
        if action.shape != (len(self._steps), size):
            raise ShapeError("action", action.shape, f"({len(self._steps)}, {size})")
        finite = np.isfinite(action).all(axis=1)
        if not finite.all():
            raise BadInputError(
                f"actions of instances {np.flatnonzero(~finite).tolist()} are not finite"
            )
        return np.clip(action, -1.0, 1.0).astype(np.float32)
