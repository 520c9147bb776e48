"""Whether the arm follows what it is told, or something holds it.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from gfm.core import Observation
from gfm.core.checks import Array

#: Joints that go at less than this share of the speed that they are told fall behind.
_SLOW = 0.3
#: A position servo follows its setpoint by at most so much later, s.
LAG_S = 0.15


@dataclass(frozen=True, kw_only=True)
class Told:
    """What the arm was told last.

    Attributes:
        speed: At which its setpoints go, rad/s, shape (J,).
        position: Its setpoints, rad, shape (J,); None where they are speeds.
    """

    speed: Array
    position: Array | None = None


def behind(
    before: Array, told: Told, position: Array, velocity: Array, still: Array, period_s: float
) -> Array:
    """Returns how far joints have fallen behind, rad, shape (J,).

    Of setpoints that are positions: how far the joint is from them, beyond its servo's lag. Of
    speeds: the way that it did not go, at less than a part of the speed told; what it goes faster
    makes up for it.

    Args:
        before: How far they had, rad, shape (J,).
        told: By the last plan.
        position: rad, shape (J,).
        velocity: rad/s, shape (J,).
        still: Slower than that a joint is at rest, rad/s, shape (J,).
        period_s: Since `before`.
    """
    if told.position is not None:
        lag = LAG_S * np.abs(told.speed)
        return np.asarray(np.maximum(np.abs(told.position - position) - lag, 0.0))
    missing = _SLOW * np.abs(told.speed) - np.abs(velocity) - still
    return np.asarray(np.maximum(before + missing * period_s, 0.0))


@final
class Following:
    """Watches joints fall behind.

    Args:
        still: Slower than that a joint is at rest, rad/s, shape (J,).
        most_rad: How far it may fall behind ...
        most_s: ... and for how long.
    """

    def __init__(self, still: Array, most_rad: float, most_s: float) -> None:
        self._still = still
        self._most_rad = most_rad
        self._most_s = most_s
        self._behind = np.zeros_like(still)
        self._late_s = np.zeros_like(still)

    def problem(self, told: Told | None, report: Observation, period_s: float) -> str:
        """Returns in words which joint is held by something; empty where none is.

        Args:
            told: What the arm was to follow; None where nothing.
            report: What it did.
            period_s: Since the last report.
        """
        if told is None:
            self._behind[:] = self._late_s[:] = 0.0
            return ""
        self._behind = behind(
            self._behind, told, report.position, report.velocity, self._still, period_s
        )
        self._late_s = np.where(self._behind > self._most_rad, self._late_s + period_s, 0.0)
        joint = int(np.argmax(self._late_s))
        if self._late_s[joint] < self._most_s or self._late_s[joint] == 0.0:
            return ""
        far, late_s = self._behind[joint], self._late_s[joint]
        self._behind[:] = self._late_s[:] = 0.0
        return (
            f"{report.joint_names[joint]} is {far:.2f} rad behind what it is told for "
            f"{late_s:.2f} s, expected at most {self._most_rad:g} rad: something holds it"
        )
