"""The simulated arm in Drake: another engine for the same controller, sensors and secrets.

The drives, and what hides in the joints, act as torques at the beginning of each of Drake's steps.
What hides in bodies is part of the plant.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm_robot_bridge.simulated.cell import Cell, cell_model, known_model
from gfm_robot_bridge.simulated.coupling import coupling_of
from gfm_robot_bridge.simulated.drake_cell import STEP_S, DrakeCell
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.laws import JointForces, encoder_offset
from gfm_robot_bridge.simulated.mechanics import Mechanics, no_object
from gfm_robot_bridge.simulated.servo import Servo
from gfm_wire import SetPayload

#: Times that differ by less than this share of a step are the same: they are sums of fractions.
_SAME = 1e-6


@final
class DrakeArm(Mechanics):
    """The arm with its drives and whatever it hides; at rest at first, holding its position.

    Its steps are fixed: what is reported between two of them is that of the earlier one.

    Args:
        position: Of the joints, rad, shape (J,).
        effects: What it hides.
        cell: What it has in its hand and in front of it.

    Raises:
        ConfigError: it cannot hide that.
    """

    def __init__(
        self, position: Array, effects: Sequence[HiddenEffect] = (), cell: Cell = Cell.NONE
    ) -> None:
        if coupling_of(effects) is not None:
            raise ConfigError(
                f"hidden effects are {', '.join(one.effect for one in effects)}: expected none of "
                "backlash and joint_elasticity, Drake's arm has no motors apart from its links"
            )
        self._kind = cell
        self._cell = DrakeCell(cell_model(cell, effects))
        self._cell.position = position
        self._upright = DrakeCell(known_model(cell))
        self._encoder_offset = encoder_offset(effects)
        self._forces = JointForces(effects, position)
        self._owed_s = 0.0
        self.servo = Servo(position + self._encoder_offset, effects)

    @property
    @override
    def position(self) -> Array:
        return np.asarray(self._cell.position + self._encoder_offset)

    @property
    @override
    def velocity(self) -> Array:
        return self._cell.velocity

    @property
    @override
    def object_pose(self) -> Array | None:
        return self._cell.object_pose if self._cell.has_object else None

    @override
    def put_object(self, pose: Array) -> None:
        if not self._cell.has_object:
            raise no_object()
        self._cell.put_object(pose)

    @override
    def carry(self, payload: SetPayload) -> None:
        self._upright = DrakeCell(known_model(self._kind, payload))

    @override
    def drive(self) -> Array:
        return self._drive(self._cell.position, self._cell.velocity)

    @override
    def step(self, h: float) -> None:
        self._owed_s += h
        while self._owed_s > (1.0 - _SAME) * STEP_S:
            self._step()
            self._owed_s -= STEP_S

    def _step(self) -> None:
        q, v = self._cell.position, self._cell.velocity
        drive = self._drive(q, v)
        torque = drive.copy()
        self._forces.add(q, v, drive, torque)
        self._cell.step(torque)
        self.servo.pass_time(STEP_S)
        if self._forces.slides:
            self._forces.slide(self._cell.position, self._cell.velocity, self.drive())

    def _drive(self, q: Array, v: Array) -> Array:
        """Returns the torque of the drives with gravity compensation, N m, shape (J,).

        The controller knows the arm with its tool, and with the payload that it was told of,
        upright, where the encoders say it is.
        """
        reported = q + self._encoder_offset
        self._upright.position = reported
        return np.asarray(self.servo.torque(reported, v, 0.0) - self._upright.weight())
