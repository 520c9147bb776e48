"""How much what a model misses by far counts: nearly nothing more, the farther it is off.

Where friction decides between sticking and slipping, or a rollout falls to the other side, no
model comes near what was recorded, whichever effects it has. The squares of such segments would
decide everything; even their sizes would (the loss of Huber), hundreds of times the noise.
"""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array

#: Residuals are outlying from so many times a typical segment's root mean square.
OUTLYING = 3.0
#: Powers of e by which a residual goes beyond its limit at most: what ran away stays finite.
MOST_POWERS = 20.0


def bounded(residual: Array, limit: Array | float) -> Array:
    """Returns residuals whose squares grow with the logarithm of the given ones beyond a limit.

    Up to it they are unchanged. Beyond it the square is l^2 (1 + 2 ln(|r| / l)), which continues
    r^2 with its slope.

    Args:
        residual: shape (N,).
        limit: l, positive: one, or one for each, shape (N,); infinite for none.
    """
    size = np.abs(residual)
    ratio = np.maximum(size / limit, 1.0)
    return np.asarray(
        np.sign(residual) * np.minimum(size, limit) * np.sqrt(1.0 + 2.0 * np.log(ratio))
    )


def unbounded(residual: Array, limit: Array | float) -> Array:
    """Returns the residuals that `bounded` made these of: its inverse."""
    size = np.abs(residual)
    return np.asarray(np.sign(residual) * np.minimum(size, limit) * np.exp(_powers(size / limit)))


def slopes(residual: Array, limit: Array | float) -> Array:
    """Returns by how much bounded residuals change with those that they were made of."""
    ratio = np.abs(residual) / limit
    return np.asarray(np.exp(-_powers(ratio)) / np.maximum(ratio, 1.0))


def _powers(ratio: Array) -> Array:
    """Returns by how many powers of e what was bounded to a ratio of its limit went beyond it."""
    return np.asarray(np.minimum(0.5 * (np.maximum(ratio, 1.0) ** 2 - 1.0), MOST_POWERS))
