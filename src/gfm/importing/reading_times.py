"""Measurements that were taken a little after, or before, the stamp of their row.

Shape letters: T rows.
"""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array, Stamps


def at_stamps(stamp_ns: Stamps, values: Array, offset_s: float) -> Array:
    """Returns what a signal was at the stamps when it was read `offset_s` after them, shape (T,).

    By cubic pieces between the readings, with slopes from their neighbours: second order in the
    period, and only the four readings around a stamp count. Before the first reading, and after the
    last, the nearest piece is continued.

    Args:
        stamp_ns: Of the rows, increasing, shape (T,).
        values: As read, shape (T,).
        offset_s: Time of reading after the stamp.
    """
    if offset_s == 0.0:
        return values
    time_s = (stamp_ns - stamp_ns[0]) * 1e-9
    slopes = np.gradient(values, time_s)
    piece = np.searchsorted(time_s, time_s - offset_s, side="right") - 1
    left = np.clip(piece, 0, len(values) - 2)
    width = time_s[left + 1] - time_s[left]
    x = (time_s - offset_s - time_s[left]) / width
    rise = values[left + 1] - values[left]
    first, last = width * slopes[left] - rise, width * slopes[left + 1] - rise
    bend = (1.0 - x) * first - x * last
    return np.asarray(values[left] + x * rise + x * (1.0 - x) * bend)
