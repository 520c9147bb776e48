"""Of which state of its joint a law without a name is: mixed into `bent` and `curve`."""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array
from gfm.effects.effect import Motion


class OfPosition:
    """Of where the joint is."""

    @staticmethod
    def state(motion: Motion) -> Array:
        """Returns the state along a motion, shape (T,)."""
        return motion.position


class OfSpeed:
    """Of how fast it moves, whichever way."""

    @staticmethod
    def state(motion: Motion) -> Array:
        """Returns the state along a motion, shape (T,)."""
        return np.abs(motion.velocity)


class OfDrive:
    """Of the torque that its drive should give."""

    @staticmethod
    def state(motion: Motion) -> Array:
        """Returns the state along a motion, shape (T,)."""
        return motion.drive
