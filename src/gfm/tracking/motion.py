"""How an object moves between two looks: a Kalman filter at constant velocity.

State: an error of the pose, and a velocity; m, rad, m/s and rad/s about the base frame's axes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.tracking.fusion import Expected, Fused
from gfm.tracking.rigid import Pose, apart, moved


@dataclass(frozen=True, kw_only=True)
class Agility:
    """How suddenly an object may change its motion.

    Attributes:
        acceleration_m_s2: Standard deviation of its acceleration along each axis, as it usually is:
            how fast the filtered velocity follows.
        acceleration_rad_s2: About each axis.
        hit_m_s: Of a change of its velocity at once, as a tool that hits it makes: what may be
            believed of a next pose.
        hit_rad_s: About each axis.
        speed_m_s: Of its velocity when it is first seen.
        speed_rad_s: About each axis.
    """

    acceleration_m_s2: float = 1.0
    acceleration_rad_s2: float = 3.0
    hit_m_s: float = 0.1
    hit_rad_s: float = 1.0
    speed_m_s: float = 0.3
    speed_rad_s: float = 3.0


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Where an object is, and how it moves.

    Attributes:
        time_s: When.
        pose: In the base frame.
        velocity: m/s and rad/s, shape (6,).
        covariance: Of the error of pose and velocity, shape (12, 12).
    """

    time_s: float
    pose: Pose
    velocity: Array
    covariance: Array


def begun(time_s: float, first: Fused, agility: Agility) -> Motion:
    """Returns the motion of what is seen for the first time."""
    covariance = np.zeros((12, 12))
    covariance[:6, :6] = first.covariance
    covariance[6:, 6:] = np.diag(np.repeat([agility.speed_m_s, agility.speed_rad_s], 3) ** 2)
    return Motion(time_s=time_s, pose=first.pose, velocity=np.zeros(6), covariance=covariance)


def at(motion: Motion, time_s: float, agility: Agility) -> Motion:
    """Returns a motion some time later (not earlier), as far as it can be foreseen.

    The acceleration is white noise held from one look to the next.
    """
    step = time_s - motion.time_s
    ahead = np.eye(12)
    ahead[:6, 6:] = step * np.eye(6)
    push = np.concatenate([0.5 * step**2 * np.eye(6), step * np.eye(6)])
    sudden = np.repeat([agility.acceleration_m_s2, agility.acceleration_rad_s2], 3) ** 2
    return Motion(
        time_s=time_s,
        pose=moved(motion.pose, step * motion.velocity),
        velocity=motion.velocity,
        covariance=ahead @ motion.covariance @ ahead.T + (push * sudden) @ push.T,
    )


def expected(motion: Motion, time_s: float, agility: Agility) -> Expected:
    """Returns the pose that is expected at a time, even after a hit."""
    ahead = at(motion, time_s, agility)
    hit = (time_s - motion.time_s) * np.repeat([agility.hit_m_s, agility.hit_rad_s], 3)
    return Expected(pose=ahead.pose, covariance=ahead.covariance[:6, :6] + np.diag(hit**2))


def corrected(motion: Motion, seen: Fused) -> Motion:
    """Returns a motion after a look at the same time."""
    spread = motion.covariance[:6, :6] + seen.covariance
    gain = np.linalg.solve(spread, motion.covariance[:6]).T
    change = gain @ apart(seen.pose, motion.pose)
    keep = np.eye(12)
    keep[:, :6] -= gain
    return Motion(
        time_s=motion.time_s,
        pose=moved(motion.pose, change[:6]),
        velocity=motion.velocity + change[6:],
        covariance=keep @ motion.covariance @ keep.T + gain @ seen.covariance @ gain.T,
    )
