"""How much what a model misses by far counts: nearly nothing more, the farther it is off.

Where friction decides between sticking and slipping, or a rollout falls to the other side, no
model comes near what was recorded, whichever effects it has. The squares of such stretches would
decide everything; even their sizes would (the loss of Huber), hundreds of times the noise.
"""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array

#: Residuals are outlying from so many times a typical stretch's root mean square.
OUTLYING = 3.0


def bounded(residual: Array, limit: Array | float) -> Array:
    """Returns residuals whose squares grow with the logarithm of the given ones beyond a limit.

    Up to it they are unchanged. Beyond it the square is l^2 (1 + 2 ln(|r| / l)), which continues
    r^2 with its slope.

    Args:
        residual: shape (N,).
        limit: l, positive: one, or one for each, shape (N,).
    """
    size = np.abs(residual)
    outlying = size > limit
    if not outlying.any():
        return residual
    ratio = np.where(outlying, size / limit, 1.0)
    return np.where(
        outlying, np.sign(residual) * limit * np.sqrt(1.0 + 2.0 * np.log(ratio)), residual
    )


def slopes(residual: Array, limit: Array | float) -> Array:
    """Returns by how much bounded residuals change with the given ones; arguments of `bounded`."""
    size = np.maximum(np.abs(residual), limit)
    return np.asarray(limit**2 / (size * np.maximum(np.abs(bounded(residual, limit)), limit)))
