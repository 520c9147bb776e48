"""What can be said of measured signals alone: even sampling, smooth states, rest, sizes, likeness.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import savgol_filter

from gfm.core.checks import Array

#: Span and order of the polynomials from which velocity and acceleration are taken.
SMOOTHING_S, SMOOTHING_ORDER = 0.09, 3
#: Time over which a joint has to rest, and speed that may be noise, in standard deviations.
REST_S, REST_SIGMAS = 0.15, 3.0


def evenly(time_s: Array, signal: Array) -> tuple[Array, Array]:
    """Returns `signal` at the median rate of its stamps: times (T',) and values (T', J)."""
    period_s = float(np.median(np.diff(time_s)))
    count = max(round((time_s[-1] - time_s[0]) / period_s), 1) + 1
    grid = time_s[0] + period_s * np.arange(count)
    return grid, np.stack([np.interp(grid, time_s, column) for column in signal.T], axis=1)


def smooth_states(time_s: Array, position: Array) -> tuple[Array, Array, Array]:
    """Returns position, velocity and acceleration at the stamps, each of shape (T, J)."""
    grid, even = evenly(time_s, position)
    period_s = grid[1] - grid[0]
    window = max(round(SMOOTHING_S / period_s), SMOOTHING_ORDER + 2) | 1
    window = min(window, (len(grid) - 1) | 1)
    derivatives = [
        savgol_filter(even, window, SMOOTHING_ORDER, deriv=d, delta=period_s, axis=0)
        for d in range(3)
    ]
    q, v, a = (
        np.stack([np.interp(time_s, grid, column) for column in d.T], axis=1) for d in derivatives
    )
    return q, v, a


def starts_at_rest(time_s: Array, position: Array, noise: Array) -> Array:
    """Returns which joints show no speed beyond the noise at first, shape (J,).

    Judged by the slope of a line through the first `REST_S`.

    Args:
        time_s: shape (T,).
        position: shape (T, J).
        noise: Standard deviation by joint, shape (J,).
    """
    first = time_s <= time_s[0] + REST_S
    time = time_s[first] - time_s[first].mean()
    slope = time @ position[first] / (time @ time)
    return np.asarray(np.abs(slope) < REST_SIGMAS * noise / np.sqrt(time @ time))


def rms(parts: Sequence[Array]) -> float:
    """Returns the root mean square of all numbers in some arrays; NaN where there are none."""
    numbers = np.concatenate([np.empty(0), *(part.ravel() for part in parts)])
    return float(np.sqrt(np.mean(numbers**2))) if len(numbers) else float("nan")


def correlation(one: Array, other: Array) -> float:
    """Returns Pearson's correlation of two signals of shape (T,); 0 where one is constant."""
    a, b = one - one.mean(), other - other.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / size if size > 0.0 else 0.0


def slope(of: Array, over: Array) -> Array:
    """Returns the slopes of lines through each column of `of` over `over`, (T,); 0 if constant."""
    centred = over - over.mean()
    power = centred @ centred
    return np.asarray(centred @ of / power if power > 0.0 else 0.0 * of[0])
