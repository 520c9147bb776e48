"""What the robot is told for one period: setpoints one after the other, so that none is a jump.

Shape letters: J joints, K setpoints.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gfm.core import CommandKind, Reason
from gfm.core.checks import Array

#: Setpoints follow one another no faster than this, s. The speed servo of the arm answers a step
#: with a time constant of 20 ms at least: in steps of 4 ms it feels a ramp.
SPACING_S = 0.004
#: rad. A position servo answers a jump of its setpoint with stiffness over inertia, 800 1/s^2 at
#: most: 3 mrad make 2.4 rad/s^2.
_SMALL_RAD = 0.003


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Setpoints of one kind, evenly in time; the last one stays in force.

    Attributes:
        kind: What the values are: rad, rad/s or N m.
        values: Shape (K, J), the first at once.
        spacing_s: Between two of them.
        reason: Why they are not what was requested.
    """

    kind: CommandKind
    values: Array
    spacing_s: float
    reason: Reason = Reason.NONE


def smaller(one: Array, other: Array) -> Array:
    """Returns of two speeds the one nearer to 0, and 0 where they differ in sign, shape (J,)."""
    nearer = np.minimum(np.abs(one), np.abs(other))
    return np.asarray(np.where(one * other > 0.0, np.sign(one) * nearer, 0.0))


def count_in(period_s: float) -> int:
    """Returns how many setpoints fit into a period."""
    return max(1, round(period_s / SPACING_S))


def speeds(first: Array, last: Array, acceleration: Array, period_s: float) -> Array:
    """Returns setpoints of a ramp as steep as allowed, then level, rad/s, shape (K, J).

    Args:
        first: In force until now, rad/s, shape (J,).
        last: To reach within the period, rad/s, shape (J,).
        acceleration: rad/s^2, shape (J,).
        period_s: Of the ramp.
    """
    count = count_in(period_s)
    step = acceleration * period_s / count
    change = last - first
    needed = math.ceil(float(np.max(np.abs(change) / step)) - 1e-9)
    if needed <= 1:
        return last[None]
    steps = np.arange(1, min(needed, count) + 1)[:, None]
    ramp = first + np.clip(change, -steps * step, steps * step)
    ramp[-1] = last
    return np.asarray(ramp)


def positions(first: Array, last: Array, period_s: float) -> tuple[Array, float]:
    """Returns setpoints on an even way, rad, shape (K, J), and the time between two of them, s."""
    way = last - first
    wanted = math.ceil(float(np.abs(way).max()) / _SMALL_RAD)
    count = min(max(wanted, 1), count_in(period_s))
    share = (np.arange(count) + 1.0)[:, None] / count
    values = first + share * way
    values[-1] = last
    return values, period_s / count
