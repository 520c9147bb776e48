"""The noise of sensors, from measured signals alone.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.core.rounding import resolution

#: Order of the differences in which only noise is left of a smooth signal.
NOISE_ORDER = 4
#: Noise of a channel that shows none.
LEAST_NOISE = 1e-9
#: Parts whose noise is looked at by itself: their length, and the least of their measurements.
QUIET_S, QUIET_LEAST = 1.0, 100
#: Change between measurements, in steps of the rounding, that rounding does not hide as at rest.
CHANGING_STEPS = 0.5
#: Percentile of the parts at which they are quiet, and the share of its typical noise that
#: white noise shows there at least.
QUIET, QUIET_SHARE = 5.0, 0.65

#: A recording's times, s, shape (T,), and values, shape (T, J).
Signal: TypeAlias = tuple[Array, Array]


def noise_std(time_s: Array, values: Array) -> Array:
    """Returns the standard deviation of the noise on each column, shape (J,).

    From divided differences of a high order, in which a smooth signal vanishes, whenever it was
    measured; scaled so that white noise keeps its size. The median makes jumps harmless. Never less
    than what rounding to the finest step seen would give.

    Args:
        time_s: When it was measured, increasing, shape (T,).
        values: shape (T, J).
    """
    differences = _divided_differences(time_s, values)
    white = np.median(np.abs(differences), axis=0) / 0.6745
    return np.asarray(
        np.maximum(np.maximum(white, resolution(values) / np.sqrt(12.0)), LEAST_NOISE)
    )


def _divided_differences(time_s: Array, values: Array) -> Array:
    """Returns divided differences of order `NOISE_ORDER`, weights of size one, (T - order, J)."""
    windows = sliding_window_view(time_s, NOISE_ORDER + 1)
    apart = windows[:, :, None] - windows[:, None, :]
    places = np.arange(NOISE_ORDER + 1)
    apart[:, places, places] = 1.0
    weights = 1.0 / (apart / (windows[:, -1:, None] - windows[:, :1, None])).prod(axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    signals = sliding_window_view(values, NOISE_ORDER + 1, axis=0)
    return np.asarray(np.einsum("tk,tjk->tj", weights, signals))


def typical_noise(signals: Sequence[Signal]) -> Array:
    """Returns the noise on each column, shape (J,): the median over recordings in which it changes.

    Never less than what rounding makes.
    """
    white = [noise_std(*signal) for signal in signals]
    typical = _over(np.median, white, _changing(signals))
    return np.asarray(np.maximum(typical, rounding_noise(signals)))


def steady_noise(signals: Sequence[Signal]) -> Array:
    """Returns the noise on each column that is there at all times, shape (J,).

    The typical noise, unless quiet parts show far less: a sensor's noise does not come and go,
    while a loop that rings about as fast as it is sampled does.
    """
    white, shown = [], []
    for time_s, values in signals:
        least = CHANGING_STEPS * resolution(values)
        for here in _parts(time_s):
            part = values[here]
            white.append(noise_std(time_s[here], part))
            changes = np.median(np.abs(np.diff(part, axis=0)), axis=0)
            shown.append((changes > least) & (white[-1] > LEAST_NOISE))
    typical = typical_noise(signals)
    if not white:
        return typical
    quiet = _over(partial(np.percentile, q=QUIET), white, shown, without=np.inf)
    steady = np.minimum(typical, quiet / QUIET_SHARE)
    return np.asarray(np.maximum(steady, rounding_noise(signals)))


def rounding_noise(signals: Sequence[Signal]) -> Array:
    """Returns the noise that rounding makes on each column, shape (J,)."""
    steps = [resolution(values) for _, values in signals]
    typical = _over(np.median, steps, _changing(signals))
    return np.asarray(np.maximum(typical / np.sqrt(12.0), LEAST_NOISE))


def _changing(signals: Sequence[Signal]) -> list[NDArray[np.bool_]]:
    """Returns which columns change at all, recording by recording, shape (J,) each."""
    return [np.ptp(values, axis=0) > 0.0 for _, values in signals]


def _parts(time_s: Array) -> list[slice]:
    """Returns the parts of a recording, each long enough to show its noise."""
    count = max(round(QUIET_S / float(np.median(np.diff(time_s)))), QUIET_LEAST)
    return [slice(i, i + count) for i in range(0, len(time_s) - count + 1, count)]


def _over(
    statistic: Callable[[Array], float],
    rows: Sequence[Array],
    counted: Sequence[NDArray[np.bool_]],
    without: float = 0.0,
) -> Array:
    """Returns a statistic over rows of each column, shape (J,), of the entries that count.

    Args:
        statistic: Of a column's entries, shape (R,).
        rows: shape (J,) each.
        counted: Which of them count, shape (J,) each.
        without: What stands where none does.
    """
    columns = zip(np.stack(rows).T, np.stack(counted).T, strict=True)
    return np.array([statistic(c[where]) if where.any() else without for c, where in columns])
