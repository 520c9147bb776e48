"""What a robot may do, and what the bridge lets through of a wish.

Every function here is pure: arrays in, arrays out.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gfm.core import Reason
from gfm.core.checks import Array


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


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Within which setpoints stay, so that the arm behind them keeps to the robot's limits.

    Attributes:
        lower: rad, shape (J,).
        upper: rad, shape (J,).
        velocity: rad/s, shape (J,).
        velocity_limit: Of the robot itself, rad/s, shape (J,).
        acceleration: Of what is driven, rad/s^2, shape (J,).
        braking: Of a stop, rad/s^2, shape (J,).
        effort: N m, shape (J,).
        still: Slower than this a joint is at rest, rad/s, shape (J,).
        power_w: That torques may put into the arm, W.
        patience_s: For how long a setpoint may be in force: until the robot stops by itself.
    """

    lower: Array
    upper: Array
    velocity: Array
    velocity_limit: Array
    acceleration: Array
    braking: Array
    effort: Array
    still: Array
    power_w: float
    patience_s: float

    def within(self, share: float) -> Bounds:
        """Returns bounds whose speeds are no more than a share of the robot's limits, either."""
        slower = np.minimum(self.velocity, share * self.velocity_limit)
        return replace(self, velocity=slower)


def approach_speed(distance: Array, acceleration: Array, after_s: float) -> Array:
    """Returns from which speed a joint still comes to rest within a distance, rad/s, shape (J,).

    It goes on for `after_s`, then brakes: v after_s + v^2 / (2 acceleration) = distance.

    Args:
        distance: rad, shape (J,); 0 is returned where it is negative.
        acceleration: rad/s^2, shape (J,).
        after_s: s.
    """
    lost = acceleration * after_s
    left = np.maximum(distance, 0.0)
    return np.asarray(np.sqrt(lost**2 + 2.0 * acceleration * left) - lost)


def limited_speed(
    wanted: Array, last: Array, position: Array, bounds: Bounds, *, period_s: float, after_s: float
) -> tuple[Array, Reason]:
    """Returns the speed at the end of a period, rad/s, shape (J,), and why it is not as wanted.

    Args:
        wanted: rad/s, shape (J,).
        last: At the end of the last period, rad/s, shape (J,).
        position: rad, shape (J,).
        bounds: To keep to.
        period_s: Over which the speed changes.
        after_s: For how long it must be possible to go on before braking.
    """
    slow, fast = clipped(wanted, bounds.velocity, Reason.VELOCITY)
    down = approach_speed(position - bounds.lower, bounds.acceleration, after_s)
    up = approach_speed(bounds.upper - position, bounds.acceleration, after_s)
    inside = np.clip(slow, -down, up)
    outside = Reason.POSITION if (inside != slow).any() else Reason.NONE
    # Last, because it can always be kept; the approach leaves room for it.
    step, sudden = clipped(inside - last, bounds.acceleration * period_s, Reason.ACCELERATION)
    return (last + step if sudden else inside), fast | outside | sudden


def limited_position(
    wanted: Array, last: Array, speed: Array, bounds: Bounds, *, period_s: float
) -> tuple[Array, Reason]:
    """Returns the position at the end of a period, rad, shape (J,), and why it is not as wanted.

    The way to the wanted position becomes a speed, and that is limited. A position that is far away
    is approached so that the arm comes to rest there; one that moves evenly is followed.

    Args:
        wanted: rad, shape (J,).
        last: At the end of the last period, rad, shape (J,).
        speed: During the last period, rad/s, shape (J,).
        bounds: To keep to.
        period_s: Of both.
    """
    inside = np.clip(wanted, bounds.lower, bounds.upper)
    outside = Reason.POSITION if (inside != wanted).any() else Reason.NONE
    asked = (inside - last) / period_s
    near = approach_speed(np.abs(inside - last), bounds.acceleration, period_s)
    even = np.abs(asked - speed) <= bounds.acceleration * period_s
    towards = np.where(even, asked, np.clip(asked, -near, near))
    after, reason = limited_speed(towards, speed, last, bounds, period_s=period_s, after_s=period_s)
    reason |= clipped(asked, bounds.velocity, Reason.VELOCITY)[1]
    reason |= Reason.ACCELERATION if (towards != asked).any() else Reason.NONE
    return (last + after * period_s if reason else inside), outside | reason


def clipped(values: Array, limit: Array, reason: Reason) -> tuple[Array, Reason]:
    """Returns values within plus and minus a limit, and the reason where that changed any."""
    within = np.clip(values, -limit, limit)
    return within, reason if (within != values).any() else Reason.NONE
