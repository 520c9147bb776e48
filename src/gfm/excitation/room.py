"""The room of a robot: ranges of all joints at once in which it can rest, touching nothing.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.excitation.limits import RobotLimits
from gfm.excitation.motion import JointRanges
from gfm.excitation.safety import Fault, FaultKind, SafetyCheck

#: Points of the room that are tried, and how often all of them.
_POINTS, _PASSES = 400, 4
#: A side that is to blame keeps this share of itself; the least that a joint may be left.
_SMALLER, _SLOWER, _LEAST_SHARE = 0.95, 0.85, 0.02
_LEAST_PACE = 0.1
#: So near, rad, a joint stands where it starts.
_AT_START = 1e-9


@dataclass(frozen=True, kw_only=True)
class Room:
    """Where motions may go, and at which share of the limits on speed, shape (J,) each."""

    lower: Array
    upper: Array
    pace: Array

    @property
    def middle(self) -> Array:
        """Half way between its ends, shape (J,)."""
        return np.asarray(0.5 * (self.lower + self.upper))

    def smaller(self, limits: RobotLimits, fault: Fault) -> Room:
        """Returns less of the room, so that the fault becomes less likely.

        Joints that are to blame and stand where they start cannot come nearer to it: all others do.
        """
        if fault.kind is FaultKind.DYNAMICS:
            return replace(self, pace=np.where(fault.joints, _SLOWER, 1.0) * self.pace)
        away = np.where(mask(limits), fault.position - limits.start, 0.0)
        moved = np.abs(away) > _AT_START
        blamed = fault.joints & moved if (fault.joints & moved).any() else moved
        low, high = blamed & (away < 0.0), blamed & (away > 0.0)
        kept = limits.start + _SMALLER * (np.stack([self.lower, self.upper]) - limits.start)
        return replace(
            self,
            lower=np.where(low, kept[0], self.lower),
            upper=np.where(high, kept[1], self.upper),
        )

    def exhausted(self, limits: RobotLimits) -> bool:
        """Returns whether there is nothing left to make smaller."""
        moving = mask(limits)
        share = (self.upper - self.lower)[moving] / (limits.upper - limits.lower)[moving]
        return bool(share.min() < _LEAST_SHARE or self.pace.min() < _LEAST_PACE)

    def ranges(self, limits: RobotLimits, share: float = 1.0) -> JointRanges:
        """Returns the ranges of the moving joints."""
        moving = mask(limits)
        return JointRanges(
            joint_names=tuple(np.array(limits.joint_names)[moving]),
            center=self.middle[moving],
            half_width=(0.5 * share * (self.upper - self.lower))[moving],
            speed=(self.pace * limits.speed)[moving],
            acceleration=(self.pace * limits.acceleration)[moving],
        )


def find_room(check: SafetyCheck, limits: RobotLimits) -> tuple[Room, list[str]]:
    """Returns ranges of all joints at once in which it can rest, and why they are smaller.

    Points all over the room are tried, and the way to its middle; a fault makes it smaller at the
    side of those to blame. A point deep inside something may look free: whole paths, which begin
    free, are checked later.
    """
    moving = mask(limits)
    room = Room(
        lower=np.where(moving, limits.lower, limits.start),
        upper=np.where(moving, limits.upper, limits.start),
        pace=np.ones(len(moving)),
    )
    if (fault := check.at_rest(limits.start)) is not None:
        raise ConfigError(f"no room where motions begin: {fault.words}")
    points = qmc.Halton(len(moving), scramble=False).random(_POINTS)
    looks = [partial(_rest_fault, check, point) for point in points]
    looks.append(partial(_way_fault, check, limits.start))
    reasons: dict[str, None] = {}
    for _ in range(_PASSES):
        before = room
        for look in looks:
            while (fault := look(room)) is not None:
                reasons[fault.words] = None
                room = room.smaller(limits, fault)
                if room.exhausted(limits):
                    raise ConfigError(f"no room around where motions begin: {fault.words}")
        if room is before:
            break
    return room, [_less_room(limits, room, list(reasons))] if reasons else []


def _rest_fault(check: SafetyCheck, point: Array, room: Room) -> Fault | None:
    """Returns why the robot cannot rest at a point of the room, given in shares, shape (J,)."""
    return check.at_rest(room.lower + point * (room.upper - room.lower))


def _way_fault(check: SafetyCheck, start: Array, room: Room) -> Fault | None:
    """Returns what is in the straight way from where the robot starts to the room's middle."""
    return check.way(start, room.middle)


def mask(limits: RobotLimits) -> NDArray[np.bool_]:
    """Returns which joints move, shape (J,)."""
    return np.isin(limits.joint_names, limits.moving)


def _less_room(limits: RobotLimits, room: Room, reasons: Sequence[str]) -> str:
    whole, kept = limits.upper - limits.lower, room.upper - room.lower
    less = [
        f"{name} {room.lower[j]:.2f} to {room.upper[j]:.2f}"
        for j, name in enumerate(limits.joint_names)
        if name in limits.moving and kept[j] < 0.99 * whole[j]
    ]
    more = f" (and {len(reasons) - 3} more)" if len(reasons) > 3 else ""
    return (
        f"less than the joints' ranges, so that the robot can rest anywhere in them: "
        f"{', '.join(less)} rad; beyond, {', '.join(reasons[:3])}{more}"
    )
