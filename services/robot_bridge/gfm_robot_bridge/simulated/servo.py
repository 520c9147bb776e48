"""The drives of the simulated arm: from a setpoint to a torque.

Shape letters: J joints.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm_robot_bridge.simulated.hidden import HiddenEffect

#: What the manufacturer's controller does: stiffness N m/rad and damping N m s/rad in position
#: mode, gain N m s/rad in velocity mode, torque limits N m.
STIFFNESS = (800.0, 800.0, 800.0, 800.0, 500.0, 500.0, 500.0)
DAMPING = (80.0, 80.0, 80.0, 80.0, 50.0, 50.0, 50.0)
VELOCITY_GAIN = 50.0
TORQUE_LIMIT = (80.0, 80.0, 40.0, 40.0, 9.0, 9.0, 9.0)


@final
class Servo:
    """Seven drives with one kind of setpoint; without a command they hold the first position."""

    def __init__(self, position: Array, effects: Sequence[HiddenEffect]) -> None:
        size = len(position)
        self.kind = CommandKind.POSITION
        self.setpoint = position.copy()
        self._scale = np.ones(size)
        self._limit = np.array(TORQUE_LIMIT)
        self._lags: dict[int, float] = {}
        self._lagged = position.copy()
        for effect in effects:
            self._take(effect)
        self._lower = -self._limit
        self._stiffness = self._scale * STIFFNESS
        self._damping = self._scale * DAMPING
        self._velocity_gain = self._scale * VELOCITY_GAIN

    def _take(self, effect: HiddenEffect) -> None:
        match effect.effect:
            case "actuator_gain":
                self._scale[effect.joints[0]] = effect.parameters["scale"]
            case "torque_saturation":
                self._limit[effect.joints[0]] = effect.parameters["limit"]
            case "actuator_lag":
                self._lags[effect.joints[0]] = effect.parameters["time_constant"]

    def command(self, kind: CommandKind, setpoint: Array, position: Array) -> None:
        """Takes a new setpoint; where its kind is new, the lags start from where the arm is."""
        if kind is not self.kind:
            self._lagged = position.copy() if kind is CommandKind.POSITION else 0.0 * position
        self.kind = kind
        self.setpoint = setpoint.copy()

    def torque(self, position: Array, velocity: Array, after_s: float) -> Array:
        """Returns the torques within the limits, without gravity compensation, N m, shape (J,).

        Args:
            position: Reported, rad, shape (J,).
            velocity: rad/s, shape (J,).
            after_s: Time since the last `pass_time`; lags follow the setpoint meanwhile.
        """
        setpoint = self._followed(after_s)
        match self.kind:
            case CommandKind.POSITION:
                torque = self._stiffness * (setpoint - position) - self._damping * velocity
            case CommandKind.VELOCITY:
                torque = self._velocity_gain * (setpoint - velocity)
            case CommandKind.EFFORT:
                torque = self._scale * setpoint
        return np.asarray(np.minimum(np.maximum(torque, self._lower), self._limit))

    def pass_time(self, elapsed_s: float) -> None:
        """Lets the lags follow the setpoint for a while."""
        self._lagged = self._followed(elapsed_s)

    def _followed(self, after_s: float) -> Array:
        """Returns the setpoint behind the lags, by their exact solution for a constant input."""
        if not self._lags:
            return self.setpoint
        followed = self.setpoint.copy()
        for joint, time_constant in self._lags.items():
            behind = self._lagged[joint] - self.setpoint[joint]
            followed[joint] += behind * math.exp(-after_s / time_constant)
        return followed
