"""Smooth motion from noisy samples: cubic smoothing splines, no phase, as strong as the noise asks.

Shape letters: T samples, D signals.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BSpline, make_smoothing_spline

from gfm.core.checks import Array

#: Half-amplitude frequencies that are tried, Hz.
CUTOFFS_HZ = (0.7, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 22.0)
#: How much is added at each end.
_PAD_S = 0.25
#: Fewer samples than this are no motion.
LEAST_SAMPLES = 5


def smoothing_spline(time_s: Array, values: Array) -> BSpline:
    """Returns the spline of every signal, each with the cutoff of least cross-validation error.

    A smoothing spline of weight lam on samples dt apart passes a frequency w with the gain
    1 / (1 + lam dt w^4). Its trace follows from that, and with it the generalized cross-validation
    score of Craven and Wahba 1979, at a hundredth of the cost of the exact one.

    Args:
        time_s: Increasing, at least five, shape (T,).
        values: shape (T, D).
    """
    dt = float(np.median(np.diff(time_s)))
    padded_time, padded, inside = _extended(time_s, values, dt)
    usable = [cutoff for cutoff in CUTOFFS_HZ if cutoff < 0.45 / dt] or [0.45 / dt]
    best = np.full(values.shape[1], np.inf)
    chosen: BSpline | None = None
    for cutoff in usable:
        weight = 1.0 / (dt * (2.0 * np.pi * cutoff) ** 4)
        spline = make_smoothing_spline(padded_time, padded, lam=weight)
        score = _cross_validation_score(values - spline(padded_time)[inside], weight, dt)
        coefficients = spline.c if chosen is None else np.where(score < best, spline.c, chosen.c)
        chosen = BSpline(spline.t, coefficients, spline.k)
        best = np.minimum(best, score)
    return chosen


def _extended(time_s: Array, values: Array, dt: float) -> tuple[Array, Array, slice]:
    """Returns times and values with some more at both ends, and where the old ones are.

    Smoothing splines end without curvature, which motion does not: made-up samples move those ends
    to where nothing is recorded.
    """
    count = min(max(LEAST_SAMPLES, math.ceil(_PAD_S / dt)), len(time_s) - 1)
    first, last = time_s[: count + 1] - time_s[0], (time_s[-1] - time_s[::-1])[: count + 1]
    padded_time = np.concatenate([time_s[0] - first[:0:-1], time_s, time_s[-1] + last[1:]])
    before = _mirrored(first, values[: count + 1])[::-1]
    after = _mirrored(last, values[::-1][: count + 1])
    return padded_time, np.concatenate([before, values, after]), slice(count, count + len(time_s))


def _mirrored(elapsed: Array, values: Array) -> Array:
    """Returns samples at `-elapsed[1:]`: a parabola goes on, the rest is turned about its end.

    Args:
        elapsed: From the end inwards, s, from 0 on, shape (P + 1,).
        values: At those times, shape (P + 1, D).
    """
    parabola = np.polynomial.polynomial.polyfit(elapsed, values, 2)
    evaluate = np.polynomial.polynomial.polyval
    rest = values - evaluate(elapsed, parabola).T
    return np.asarray(evaluate(-elapsed[1:], parabola).T + 2.0 * rest[0] - rest[1:])


def _cross_validation_score(residual: Array, weight: float, dt: float) -> Array:
    """Returns the score of every signal, shape (D,)."""
    omega = np.linspace(0.0, np.pi, 512)
    gain = 1.0 / (1.0 + weight * dt * (2.0 * np.sin(omega / 2.0) / dt) ** 4)
    score: Array = (residual**2).mean(axis=0) / (1.0 - gain.mean()) ** 2
    return score
