"""What the bridge lets through: limits on commands, and why a command was changed.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from typing import final

import numpy as np

from gfm.core import Command, CommandKind
from gfm.core.checks import Array


class Reason(IntFlag):
    """Why the applied command differs from the requested one."""

    NONE = 0
    """It does not."""
    POSITION = 1
    """It would have led out of the joint range."""
    VELOCITY = 2
    """It was faster than allowed."""
    ACCELERATION = 4
    """It changed speed more quickly than allowed."""
    EFFORT = 8
    """It was stronger than allowed."""
    WATCHDOG = 16
    """None came in time: the robot holds."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a robot's joints may do; every array has shape (J,).

    Attributes:
        lower: rad.
        upper: rad.
        velocity: rad/s.
        acceleration: rad/s^2.
        effort: N m.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    effort: Array


#: Towards the end of its range a joint may go at this rate of what is left, 1/s.
_APPROACH_RATE = 5.0


@final
class Limiter:
    """Changes commands so that they keep to the limits.

    Args:
        limits: The robot's.
        period_s: Between two commands.
        margin_rad: How far from the ends of the joint ranges commands stay.
        velocity_share: Share of the robot's velocity limit that is allowed.
    """

    def __init__(
        self, limits: Limits, *, period_s: float, margin_rad: float, velocity_share: float
    ) -> None:
        self._lower = limits.lower + margin_rad
        self._upper = limits.upper - margin_rad
        self._velocity = velocity_share * limits.velocity
        self._speed_step = limits.acceleration * period_s
        self._effort = limits.effort
        self._period_s = period_s
        self._kind: CommandKind | None = None
        self._last = np.zeros(len(limits.lower))

    def forget(self) -> None:
        """Starts the next command from where the robot then is, not from the last command."""
        self._kind = None

    def limited(self, command: Command, position: Array, velocity: Array) -> tuple[Array, Reason]:
        """Returns the setpoints to apply, shape (J,), and why they differ.

        Args:
            command: Finite, in the order of the joints.
            position: Measured, rad, shape (J,).
            velocity: Measured, rad/s, shape (J,).
        """
        if command.kind is not self._kind:
            moving = {CommandKind.POSITION: position, CommandKind.VELOCITY: velocity}
            self._last = moving.get(command.kind, np.zeros_like(position))
            self._kind = command.kind
        match command.kind:
            case CommandKind.POSITION:
                values, reason = self._position(command.values)
            case CommandKind.VELOCITY:
                values, reason = self._speed(command.values, position)
            case CommandKind.EFFORT:
                values, reason = _clipped(command.values, self._effort, Reason.EFFORT)
        self._last = values
        return values, reason

    def _position(self, wanted: Array) -> tuple[Array, Reason]:
        inside = np.clip(wanted, self._lower, self._upper)
        step, fast = _clipped(inside - self._last, self._velocity * self._period_s, Reason.VELOCITY)
        outside = Reason.POSITION if (inside != wanted).any() else Reason.NONE
        return (self._last + step if fast else inside), outside | fast

    def _speed(self, wanted: Array, position: Array) -> tuple[Array, Reason]:
        slow, fast = _clipped(wanted, self._velocity, Reason.VELOCITY)
        step, sudden = _clipped(slow - self._last, self._speed_step, Reason.ACCELERATION)
        smooth = self._last + step if sudden else slow
        down = np.minimum(_APPROACH_RATE * (self._lower - position), 0.0)
        up = np.maximum(_APPROACH_RATE * (self._upper - position), 0.0)
        # Last, because it is what must hold: a stop at the end of the range may be sudden.
        safe = np.clip(smooth, down, up)
        outside = Reason.POSITION if (safe != smooth).any() else Reason.NONE
        return safe, fast | sudden | outside


def _clipped(values: Array, limit: Array, reason: Reason) -> tuple[Array, Reason]:
    """Returns values within plus and minus a limit, and the reason where that changed any."""
    clipped = np.clip(values, -limit, limit)
    return clipped, reason if (clipped != values).any() else Reason.NONE
