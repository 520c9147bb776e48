"""Multisines: all frequencies of a band at once, each joint with frequencies of its own.

Harmonics of the motion's length are dealt out to the joints in turn, so that over the motion the
joints are uncorrelated; phases are random, then improved until the velocity has few peaks (a low
crest factor): more of it for the same limits. Morelli 2003 deals out harmonics so; the phases are
those of Van der Ouderaa, Schoukens and Renneboog 1988 (clip, transform, keep the phases).

Shape letters: N control periods, J joints, H harmonics.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.excitation.motion import JointRanges, minimum_jerk
from gfm.excitation.shapes import REST_S, within

#: Lowest and highest frequency, Hz; never more than the second share of the control rate.
BAND_HZ = (0.1, 2.5)
_RATE_SHARE = 0.1
_ROUNDS, _CLIP = 60, 0.85


def crest_multisine(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns a band of sines for each joint, equally strong in velocity."""
    count, joints = len(time_s), len(ranges.center)
    period_s = time_s[1] - time_s[0]
    length_s = count * period_s
    highest = min(BAND_HZ[1], _RATE_SHARE / period_s)
    first, last = int(np.ceil(BAND_HZ[0] * length_s)), int(highest * length_s)
    offset = np.empty((count, joints))
    for joint in range(joints):
        harmonics = np.arange(first + joint, max(last, first + joint) + 1, joints)
        phase = few_peaks(harmonics, rng.uniform(0.0, 2 * np.pi, len(harmonics)), count)
        spectrum = np.zeros(count // 2 + 1, np.complex128)
        # A sine of velocity is a sine of position, smaller by its angular frequency.
        spectrum[harmonics] = np.exp(1j * phase) / (2j * np.pi * harmonics / length_s)
        offset[:, joint] = np.fft.irfft(spectrum, count)
    fade = minimum_jerk((time_s - REST_S) / 1.0) * minimum_jerk(time_s[-1] - REST_S - time_s)
    large = np.abs(offset).max(axis=0)
    return within(ranges, time_s, fade[:, np.newaxis] * offset / large * ranges.half_width)


def few_peaks(harmonics: NDArray[np.intp], phase: Array, count: int) -> Array:
    """Returns phases, shape (H,), for which the sum of equal sines has a low crest factor.

    Args:
        harmonics: Of the whole length, shape (H,).
        phase: To begin with, shape (H,).
        count: Samples of the whole length.
    """
    best, lowest = phase, np.inf
    for _ in range(_ROUNDS):
        wave = _wave(harmonics, phase, count)
        crest = crest_factor(wave)
        if crest < lowest:
            best, lowest = phase, crest
        top = _CLIP * np.abs(wave).max()
        phase = np.angle(np.fft.rfft(np.clip(wave, -top, top))[harmonics])
    return best


def crest_factor(wave: Array) -> float:
    """Returns the peak over the root mean square."""
    return float(np.abs(wave).max() / np.sqrt(np.mean(wave**2)))


def _wave(harmonics: NDArray[np.intp], phase: Array, count: int) -> Array:
    spectrum = np.zeros(count // 2 + 1, np.complex128)
    spectrum[harmonics] = np.exp(1j * phase)
    return np.fft.irfft(spectrum, count)
