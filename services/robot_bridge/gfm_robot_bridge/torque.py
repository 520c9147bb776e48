"""Torques, limited by the motion that they would cause.

Shape letters: J joints.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from gfm.core import Reason
from gfm.core.checks import Array
from gfm_robot_bridge.limits import Bounds, approach_speed, clipped


class Dynamics(ABC):
    """What a robot's model says of torque and motion; gravity is the robot's own affair."""

    @abstractmethod
    def accelerations(self, position: Array, velocity: Array, torque: Array) -> Array:
        """Returns what torques cause, rad/s^2, all arrays of shape (J,)."""

    @abstractmethod
    def torques(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        """Returns what causes accelerations, N m, all arrays of shape (J,)."""


def limited_torque(
    wanted: Array, position: Array, velocity: Array, dynamics: Dynamics, bounds: Bounds
) -> tuple[Array, Reason]:
    """Returns torques, N m, shape (J,), and why they are not as wanted.

    Were they in force for all of the robot's patience, no joint would become too fast, and each
    could still be stopped before the end of its range.

    Args:
        wanted: N m, shape (J,).
        position: rad, shape (J,).
        velocity: rad/s, shape (J,).
        dynamics: Of the robot.
        bounds: To keep to.
    """
    weak, strong = clipped(wanted, bounds.effort, Reason.EFFORT)
    caused = dynamics.accelerations(position, velocity, weak)
    slow = np.clip(caused, *_speed_window(velocity, bounds))
    inside = np.clip(slow, *_range_window(position, velocity, bounds))
    smooth, sudden = clipped(inside, bounds.acceleration, Reason.ACCELERATION)
    reason = strong | sudden
    reason |= Reason.VELOCITY if (slow != caused).any() else Reason.NONE
    reason |= Reason.POSITION if (inside != slow).any() else Reason.NONE
    torque = weak
    if (smooth != caused).any():
        torque = dynamics.torques(position, velocity, smooth)
        torque = np.clip(torque, -bounds.effort, bounds.effort)
    return _within_power(torque, velocity, bounds.power_w, reason)


def _speed_window(velocity: Array, bounds: Bounds) -> tuple[Array, Array]:
    """Returns between which accelerations the speed stays allowed, rad/s^2, shape (J,) each."""
    lowest = (-bounds.velocity - velocity) / bounds.patience_s
    return lowest, (bounds.velocity - velocity) / bounds.patience_s


def _range_window(position: Array, velocity: Array, bounds: Bounds) -> tuple[Array, Array]:
    """Returns between which accelerations the range can still be kept, rad/s^2, shape (J,) each."""
    up = _towards_end(bounds.upper - position, velocity, bounds)
    return -_towards_end(position - bounds.lower, -velocity, bounds), up


def _towards_end(distance: Array, speed: Array, bounds: Bounds) -> Array:
    """Returns the highest acceleration towards an end of the range, rad/s^2, shape (J,).

    In force for the robot's patience h it leads to speed w = v + a h and then, braked, to rest:
    (v + w) h / 2 + w^2 / (2 braking) = distance. Where v h / 2 is more than that, the joint has to
    stop within h: a = -v^2 / (2 distance).
    """
    h = bounds.patience_s
    left = distance - speed * h / 2.0
    after = approach_speed(left, bounds.acceleration, h / 2.0)
    stopping = -(speed**2) / (2.0 * np.maximum(distance, 1e-6))
    late = (left <= 0.0) & (speed > 0.0)
    return np.asarray(np.where(late, stopping, (after - speed) / h))


def _within_power(
    torque: Array, velocity: Array, power_w: float, reason: Reason
) -> tuple[Array, Reason]:
    """Returns torques of which those that drive are weakened, where together they do too much."""
    driving = np.maximum(torque * velocity, 0.0)
    power = float(driving.sum())
    if power <= power_w:
        return torque, reason
    return np.where(driving > 0.0, torque * (power_w / power), torque), reason | Reason.POWER
