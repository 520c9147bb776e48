"""Signals that come in steps, as encoders give them.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array

#: How near to a whole number of steps changes of a rounded signal are, and how many of them.
_WHOLE_WITHIN, _MOSTLY = 0.05, 0.9


def resolution(signal: Array) -> Array:
    """Returns the step to which each column is rounded; 0 where it is not, shape (J,).

    All changes of a rounded signal are whole multiples of its step; those of others never are.
    """
    steps = np.zeros(signal.shape[1])
    for j, column in enumerate(signal.T):
        jumps = np.round(np.abs(np.diff(column)), 9)
        jumps = jumps[jumps > 0.0]
        sizes, counts = np.unique(jumps, return_counts=True)
        usual = sizes[counts >= max(0.01 * len(jumps), 2)]
        if len(usual):
            multiples = jumps / usual[0]
            whole = np.abs(multiples - np.round(multiples)) < _WHOLE_WITHIN
            steps[j] = usual[0] if np.mean(whole) > _MOSTLY else 0.0
    return steps


def in_steps_of(signal: Array, original: Array) -> Array:
    """Returns `signal` rounded to the steps in which `original` comes, both of shape (T,).

    What is interpolated between rounded values is no more exact than they are: left as it is, it
    would look as if it were.
    """
    step = float(resolution(original[:, None])[0])
    if step == 0.0:
        return signal
    return np.asarray(original[0] + step * np.round((signal - original[0]) / step))
