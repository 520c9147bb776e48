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


def bounded(residual: Array, limit: Array | float | None) -> Array:
    """Returns residuals whose squares grow with the logarithm of the given ones beyond a limit.

    Up to it they are unchanged. Beyond it the square is l^2 (1 + 2 ln(|r| / l)), which continues
    r^2 with its slope.

    Args:
        residual: shape (N,).
        limit: l, positive: one, or one for each, shape (N,); None for none.
    """
    if limit is None:
        return residual
    size = np.abs(residual)
    outlying = size > limit
    if not outlying.any():
        return residual
    ratio = np.where(outlying, size / limit, 1.0)
    return np.where(
        outlying, np.sign(residual) * limit * np.sqrt(1.0 + 2.0 * np.log(ratio)), residual
    )


def unbounded(residual: Array, limit: Array | float | None) -> Array:
    """Returns the residuals that `bounded` made these of: its inverse."""
    if limit is None:
        return residual
    ratio = np.maximum(np.abs(residual) / limit, 1.0)
    full = np.sign(residual) * limit * np.exp(np.minimum(0.5 * (ratio**2 - 1.0), MOST_POWERS))
    return np.where(ratio > 1.0, full, residual)


def slopes(residual: Array, limit: Array | float | None) -> Array:
    """Returns by how much bounded residuals change with those that they were made of."""
    if limit is None:
        return np.ones_like(residual)
    ratio = np.maximum(np.abs(residual) / limit, 1.0)
    return np.asarray(np.exp(-np.minimum(0.5 * (ratio**2 - 1.0), MOST_POWERS)) / ratio)
