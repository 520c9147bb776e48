"""What acts on the arm beside its drives and its own weight: a load that nobody told the robot of.

A momentum observer (De Luca and Mattone, 2003): what the drives' torques and the model do not
explain of the arm's momentum is a torque from outside. From one report to the next

    e = M (v' - v) / h + C v + g - tau

is that torque, by the model in the middle between them, and the observer is its low-pass. Momenta
telescope: the noise of speeds is divided by the observer's time, not by the time between two
reports. The model knows arm, tool, and what the robot was told that it carries.

Shape letters: J joints.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import Observation, Reason
from gfm.core.checks import Array
from gfm_robot_bridge.limits import Bounds
from gfm_robot_bridge.torque import Dynamics
from gfm_wire import SetPayload

#: Of the low-pass, s. A load that is put down is known by two thirds after it: half of the robot's
#: patience. At 2e-3 rad/s of noise it lets through 0.1 N m where a joint moves 5 kg m^2.
SETTLES_S = 0.1
#: After so long without reports it begins anew, s.
_GONE_S = 0.5
#: Longer than a joint takes to the highest speed, ns: what a load takes to be accelerated is over.
_REMEMBERED_NS = 500_000_000
#: By so much a load may grow until a servo has followed: by its lever as the posture changes, and
#: by its inertia where it is slowed down.
_GROWS = 1.5
#: A load that is less sinks an arm by some millimetres while it is stopped by speeds, N m, which is
#: quicker. What steps of setpoints make of none is less as well.
_STAYS_NM = 3.0
#: Of the torque that a drive has, a load may take so much: the rest is left to brake with.
_STRENGTH = 0.8


class Balance(ABC):
    """What a model says that the joints' torques come to."""

    @abstractmethod
    def needed(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        """Returns the torques of a motion, weight included, N m; all arrays of shape (J,)."""

    @abstractmethod
    def carry(self, payload: SetPayload) -> None:
        """Knows from now on what the robot was told that it carries, instead of before."""


@dataclass(frozen=True, kw_only=True)
class Load:
    """What acts on the joints from outside.

    Attributes:
        torque: N m, shape (J,).
        sinking: At which speed a speed servo that is told 0 gives way to it, rad/s, shape (J,).
        lately: How fast it may become, by the least and the most of the last half second, rad/s,
            shape (2, J): what a load takes to be accelerated hides a part of its weight meanwhile.
    """

    torque: Array
    sinking: Array
    lately: Array

    @property
    def stays(self) -> bool:
        """Whether positions are stopped as positions: at speeds of 0 the arm would sink."""
        return bool(np.abs(self.torque).max() > _STAYS_NM)


def by_load(reason: Reason) -> Reason:
    """Returns why a load had something changed, with that it was the load; nothing of nothing."""
    return reason | Reason.LOAD if reason else reason


@final
class Loaded(Dynamics):
    """An arm on which a load acts.

    Args:
        dynamics: Of the arm.
        torque: Of the load, N m, shape (J,).
    """

    def __init__(self, dynamics: Dynamics, torque: Array) -> None:
        self._dynamics = dynamics
        self._torque = torque

    @override
    def accelerations(self, position: Array, velocity: Array, torque: Array) -> Array:
        return self._dynamics.accelerations(position, velocity, torque + self._torque)

    @override
    def torques(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        return self._dynamics.torques(position, velocity, acceleration) - self._torque


@final
class LoadObserver:
    """Knows the load by the newest report.

    Args:
        balance: Of the arm.
        servo_gain: Of the robot's speed servos, N m s/rad.
        unnoticed_nm: A load of which every joint feels less than this is none.

    Attributes:
        torque: That acts on the joints from outside, N m, shape (J,); empty before a report.
    """

    def __init__(self, balance: Balance, servo_gain: float, unnoticed_nm: float) -> None:
        self.torque = np.empty(0)
        self._balance = balance
        self._servo_gain = servo_gain
        self._unnoticed_nm = unnoticed_nm
        self._before: Observation | None = None
        self._lately: deque[tuple[int, Array]] = deque()

    @property
    def load(self) -> Load | None:
        """What acts on the joints from outside; None where that is nothing."""
        if np.abs(self.torque).max(initial=0.0) < self._unnoticed_nm:
            return None
        lately = _GROWS / self._servo_gain * np.array([torque for _, torque in self._lately])
        return Load(
            torque=self.torque,
            sinking=self.torque / self._servo_gain,
            lately=np.array([lately.min(axis=0), lately.max(axis=0)]),
        )

    def words(self, bounds: Bounds) -> str:
        """Returns which joint bears most of the load, and how much more it might.

        Args:
            bounds: That the arm is to keep to.
        """
        if self._before is None:
            return ""
        allowed = self._allowed(bounds)
        joint = int(np.argmax(np.abs(self.torque) / allowed))
        torque, sinks = self.torque[joint], self.torque[joint] / self._servo_gain
        name = self._before.joint_names[joint]
        return (
            f"{name} bears {abs(torque):.1f} N m of a load that nobody told the robot of, and at "
            f"speeds of 0 sinks at {abs(sinks):.2f} rad/s; velocities and torques are taken up to "
            f"{allowed[joint]:.1f} N m"
        )

    def too_heavy(self, bounds: Bounds) -> bool:
        """Returns whether an arm that is not held in its position is beyond control.

        A load that a joint moves against may be friction, and that is none.

        Args:
            bounds: That the arm is to keep to.
        """
        if self._before is None:
            return False
        velocity = np.where(
            np.abs(self._before.velocity) < bounds.still, 0.0, self._before.velocity
        )
        drives = self.torque * velocity >= 0.0
        return bool((drives & (np.abs(self.torque) > self._allowed(bounds))).any())

    def _allowed(self, bounds: Bounds) -> Array:
        """Returns the torques at which joints sink as fast as is allowed, N m, shape (J,)."""
        return np.minimum(self._servo_gain * bounds.velocity, _STRENGTH * bounds.effort)

    def carry(self, payload: SetPayload) -> None:
        """Takes note of what the robot was told that it carries."""
        self._balance.carry(payload)

    def take(self, reports: Sequence[Observation]) -> None:
        """Takes reports, oldest first; those that are not newer than the last are left out."""
        for report in reports:
            if self._before is None or report.stamp_ns > self._before.stamp_ns:
                self._take(report)
                self._lately.append((report.stamp_ns, self.torque))
                while report.stamp_ns - self._lately[0][0] > _REMEMBERED_NS:
                    self._lately.popleft()

    def _take(self, report: Observation) -> None:
        before, self._before = self._before, report
        h = math.inf if before is None else (report.stamp_ns - before.stamp_ns) * 1e-9
        if before is None or h > _GONE_S:  # it holds, or moves evenly
            still = np.zeros_like(report.velocity)
            needed = self._balance.needed(report.position, report.velocity, still)
            self.torque = needed - report.effort
            return
        needed = self._balance.needed(
            0.5 * (before.position + report.position),
            0.5 * (before.velocity + report.velocity),
            (report.velocity - before.velocity) / h,
        )
        outside = needed - 0.5 * (before.effort + report.effort)
        self.torque = self.torque + (1.0 - math.exp(-h / SETTLES_S)) * (outside - self.torque)
