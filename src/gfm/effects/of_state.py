"""Of which state of its joint a law without a name is: mixed into `bent` and `curve`."""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array


class OfPosition:
    """Of where the joint is."""

    @staticmethod
    def state(position: Array, velocity: Array) -> Array:
        """Returns the state, shape (N,), at positions and velocities."""
        del velocity
        return position


class OfSpeed:
    """Of how fast it moves, whichever way."""

    @staticmethod
    def state(position: Array, velocity: Array) -> Array:
        """Returns the state, shape (N,), at positions and velocities."""
        del position
        return np.abs(velocity)
