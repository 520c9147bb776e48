"""What can be said of measured signals alone: stamps, smooth states, rest, sizes, likeness.

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
#: Shares of a period: within which stamps are the same; up to which they may be, where they jitter
#: so far; and the share of stamps that do not jitter farther. Of clocks that run free half do.
NEAR_STAMP, FAR_STAMP, MOSTLY = 0.1, 0.25, 0.95


def evenly(time_s: Array, signal: Array) -> tuple[Array, Array]:
    """Returns `signal` at the median rate of its stamps: times (T',) and values (T', J)."""
    period_s = float(np.median(np.diff(time_s)))
    count = max(round((time_s[-1] - time_s[0]) / period_s), 1) + 1
    grid = time_s[0] + period_s * np.arange(count)
    return grid, np.stack([np.interp(grid, time_s, column) for column in signal.T], axis=1)


def same_stamp_s(first_s: Array, second_s: Array) -> float:
    """Returns how far apart two stamps are that are the same but for their jitter, s.

    Nothing where clocks run free: there, what is near another is so by chance.

    Args:
        first_s: Stamps of commands, say, increasing, shape (C,).
        second_s: Those of measurements, shape (T,).
    """
    fast, slow = sorted(
        (first_s, second_s), key=lambda t: float(np.median(np.diff(t))) if len(t) > 1 else np.inf
    )
    period_s = float(np.median(np.diff(fast)))
    after = np.clip(np.searchsorted(fast, slow), 1, len(fast) - 1)
    apart = np.minimum(np.abs(slow - fast[after]), np.abs(slow - fast[after - 1]))
    near_s = max(NEAR_STAMP * period_s, float(np.quantile(apart, MOSTLY)))
    return near_s if near_s <= FAR_STAMP * period_s else 0.0


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
