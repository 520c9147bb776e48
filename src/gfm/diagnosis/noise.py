"""The noise of sensors, from measured signals alone.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import comb
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.core.rounding import resolution
from gfm.diagnosis.signals import evenly

#: Order of the differences in which only noise is left of a smooth signal.
NOISE_ORDER = 4
#: Noise of a channel that shows none.
LEAST_NOISE = 1e-9
#: Stretches whose noise is looked at by itself: their length, and the least of their measurements.
QUIET_S, QUIET_LEAST = 1.0, 100
#: Change between measurements, in steps of the rounding, that rounding does not hide as at rest.
CHANGING_STEPS = 0.5
#: Percentile of the stretches at which they are quiet, and the share of its typical noise that
#: white noise shows there at least.
QUIET, QUIET_SHARE = 5.0, 0.65

#: A recording's times, s, shape (T,), and values, shape (T, J).
Signal: TypeAlias = tuple[Array, Array]


def noise_std(signal: Array) -> Array:
    """Returns the standard deviation of the noise on each column, shape (J,).

    From differences of a high order, in which a smooth signal vanishes and white noise of variance
    s^2 becomes noise of variance binom(2k, k) s^2; the median makes jumps harmless. Never less than
    what rounding to the finest step seen would give.

    Args:
        signal: Evenly sampled, shape (T, J).
    """
    differences = np.diff(signal, n=NOISE_ORDER, axis=0)
    spread = np.median(np.abs(differences), axis=0) / 0.6745
    white = spread / np.sqrt(comb(2 * NOISE_ORDER, NOISE_ORDER))
    return np.asarray(
        np.maximum(np.maximum(white, resolution(signal) / np.sqrt(12.0)), LEAST_NOISE)
    )


def typical_noise(signals: Sequence[Signal]) -> Array:
    """Returns the noise on each column, shape (J,): the median over recordings in which it changes.

    Never less than what rounding makes.
    """
    white = [noise_std(evenly(*signal)[1]) for signal in signals]
    typical = _over(np.median, white, _changing(signals))
    return np.asarray(np.maximum(typical, rounding_noise(signals)))


def steady_noise(signals: Sequence[Signal]) -> Array:
    """Returns the noise on each column that is there at all times, shape (J,).

    The typical noise, unless quiet stretches show far less: a sensor's noise does not come and go,
    while a loop that rings about as fast as it is sampled does.
    """
    white, shown = [], []
    for time_s, values in signals:
        least = CHANGING_STEPS * resolution(values)
        for part in _stretches(*evenly(time_s, values)):
            white.append(noise_std(part))
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


def _stretches(time_s: Array, values: Array) -> list[Array]:
    """Returns an evenly sampled recording in stretches long enough to show their noise."""
    count = max(round(QUIET_S / (time_s[1] - time_s[0])), QUIET_LEAST)
    return [values[i : i + count] for i in range(0, len(values) - count + 1, count)]


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
