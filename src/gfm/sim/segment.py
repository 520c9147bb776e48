"""Stretches of recordings that are to be predicted, and their predictions.

Shape letters: T measurements of a segment, J joints, C commands.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array

#: Time over which a segment tells with which acceleration it begins, s, and the measurements that
#: takes at least.
FIRST_S, FIRST = 0.05, 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A part of one recording, to be predicted from its initial state.

    Attributes:
        time_s: Measurement times from the start of the segment, shape (T,).
        position: Measured, rad, shape (T, J).
        effort: Measured drive torque, N m, shape (T, J), or None.
        kind: What the commands are.
        command_time_s: When each command took effect, on the same clock, shape (C,).
        command: rad, rad/s or N m, shape (C, J).
        initial_position: rad, shape (J,).
        initial_velocity: rad/s, shape (J,).
        servo_gain: Factor on the servo's gain, shape (J,).
        recording: Index of the recording that it was cut from.
        effort_noise: Standard deviation of that recording's efforts, N m, shape (J,), or None.
        same_stamp_s: How far apart a command and a measurement are of the same stamp, s.
        initial_motor: How far motor sides are ahead of where their loads hold them, rad, and how
            much faster than their links they are, rad/s, shape (2, J); None for not at all.
        object_pose: Where a free object is at first, m and quaternion w x y z, shape (7,); None
            where that is not known.
        measured: The same as it was measured to begin, where its initial state was fitted.
    """

    time_s: Array
    position: Array
    effort: Array | None
    kind: CommandKind
    command_time_s: Array
    command: Array
    initial_position: Array
    initial_velocity: Array
    servo_gain: Array
    recording: int = 0
    effort_noise: Array | None = None
    same_stamp_s: float = 0.0
    initial_motor: Array | None = None
    object_pose: Array | None = None
    measured: Segment | None = None

    def initial_acceleration(self) -> Array:
        """Returns the measured acceleration at first, rad/s^2, shape (J,); none at rest."""
        first = max(int(np.searchsorted(self.time_s, FIRST_S, side="right")), FIRST)
        bend = np.polyfit(self.time_s[:first], self.position[:first], 2)[0]
        return np.where(self.initial_velocity == 0.0, 0.0, 2.0 * bend)


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What a plant predicts for a segment, at its measurement times.

    Attributes:
        position: rad, shape (T, J).
        effort: Drive torque at each measurement time, N m, shape (T, J); NaN where it was not
            asked for.
        diverged: Whether the simulation broke off.
    """

    position: Array
    effort: Array
    diverged: bool


def extrapolated(prediction: Prediction, halved: Prediction | None = None) -> Prediction:
    """Returns what predictions on ever shorter time steps come to, to second order.

    Args:
        prediction: On some step, of first order in it.
        halved: On half the step; without it `prediction` is told as it is.
    """
    if halved is None:
        return prediction
    return Prediction(
        position=2.0 * halved.position - prediction.position,
        effort=2.0 * halved.effort - prediction.effort,
        diverged=prediction.diverged or halved.diverged,
    )
