"""The mechanics of the simulated arm, integrated by a Runge-Kutta method of third order.

Geometry and inertias of the arm, and of the cell around it, come from the published model; what
acts on the arm is computed here. Where a joint has play or a spring, its motor is a mass of its own
that drives the link through it: the motor side is then the last element of the state. An object
that lies in the basket is moved by contact alone, and by the same method.

Shape letters: J joints, Q positions and S speeds of everything: those of the arm first, then an
object's seven and six, then a motor side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.simulated.cell import Cell, cell_model, known_model
from gfm_robot_bridge.simulated.coupling import coupling_of
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.laws import JointForces, encoder_offset
from gfm_robot_bridge.simulated.mechanics import Mechanics, no_object
from gfm_robot_bridge.simulated.servo import Servo
from gfm_wire import SetPayload

_COUNT = len(JOINT_NAMES)
#: Where an object lies in positions and in speeds, behind the joints.
_POSE, _TWIST = slice(_COUNT, _COUNT + 7), slice(_COUNT, _COUNT + 6)


@final
class Arm(Mechanics):
    """The arm with its drives and whatever it hides; at rest at first, holding its position.

    Args:
        position: Of the joints, rad, shape (J,).
        effects: What it hides.
        cell: What it has in its hand and in front of it.
    """

    def __init__(
        self, position: Array, effects: Sequence[HiddenEffect] = (), cell: Cell = Cell.NONE
    ) -> None:
        self._cell = cell
        self._model = cell_model(cell, effects)
        self._data = mujoco.MjData(self._model)
        self._has_object = self._model.nq > _COUNT
        self._compensation = _GravityCompensation(known_model(cell))
        self._encoder_offset = encoder_offset(effects)
        self._forces = JointForces(effects, position)
        self._coupling = coupling_of(effects)
        self._q, self._v = np.array(self._model.qpos0), np.zeros(self._model.nv)
        self._q[:_COUNT] = position
        if self._coupling is not None:
            self._q = np.append(self._q, position[self._coupling.joint])
            self._v = np.append(self._v, 0.0)
            self._motor_inertia, self._motor_damping = _split_motor(
                self._model, self._coupling.joint
            )
        self.servo = Servo(position + self._encoder_offset, effects)

    @property
    @override
    def position(self) -> Array:
        return np.asarray(self._q[:_COUNT] + self._encoder_offset)

    @property
    @override
    def velocity(self) -> Array:
        return self._v[:_COUNT].copy()

    @property
    @override
    def object_pose(self) -> Array | None:
        return self._q[_POSE].copy() if self._has_object else None

    @override
    def put_object(self, pose: Array) -> None:
        if not self._has_object:
            raise no_object()
        self._q[_POSE] = pose
        self._v[_TWIST] = 0.0

    @override
    def carry(self, payload: SetPayload) -> None:
        self._compensation = _GravityCompensation(known_model(self._cell, payload))

    @override
    def drive(self) -> Array:
        return self._drive(self._q, self._v, 0.0)

    @override
    def step(self, h: float) -> None:
        """Advances by `h` seconds: y + h (k1 + k2 + 4 k3) / 6 with k2 at h and k3 at h / 2.

        This is Shu and Osher's third-order method, 1988, eq. 2.18.
        """
        q, v1 = self._q, self._v
        a1 = self._acceleration(q, v1, 0.0)
        v2 = v1 + h * a1
        a2 = self._acceleration(self._moved(q, v1, h), v2, h)
        v3 = v1 + (h / 4) * (a1 + a2)
        a3 = self._acceleration(self._moved(q, v1 + v2, h / 4), v3, h / 2)
        self._q = self._moved(q, v1 + v2 + 4 * v3, h / 6)
        self._v = v1 + (h / 6) * (a1 + a2 + 4 * a3)
        self.servo.pass_time(h)
        if self._forces.slides:
            self._forces.slide(self._q, self._v, self.drive())

    def _moved(self, q: Array, v: Array, h: float) -> Array:
        """Returns positions after `h` seconds at speeds `v`; an object turns about its axes."""
        moved = self._moved_with_object(q, v, h) if self._has_object else q + h * v
        return np.asarray(moved)

    def _moved_with_object(self, q: Array, v: Array, h: float) -> Array:
        moved = q.copy()
        mujoco.mj_integratePos(self._model, moved[: self._model.nq], v[: self._model.nv], h)
        moved[self._model.nq :] += h * v[self._model.nv :]
        return moved

    def _acceleration(self, q: Array, v: Array, after_s: float) -> Array:
        """Returns rad/s^2 and m/s^2, shape (S,), `after_s` after the beginning of the step."""
        drive, torque = self._drive(q, v, after_s), np.zeros(self._model.nv)
        torque[:_COUNT] = drive
        self._forces.add(q, v, drive, torque)
        if self._coupling is None:
            return self._link_acceleration(q, v, torque)
        j = self._coupling.joint
        transmitted = self._coupling.torque(float(q[-1] - q[j]), float(v[-1] - v[j]))
        motor = (torque[j] - self._motor_damping * v[-1] - transmitted) / self._motor_inertia
        torque[j] = transmitted
        return np.append(self._link_acceleration(q[:-1], v[:-1], torque), motor)

    def _link_acceleration(self, q: Array, v: Array, torque: Array) -> Array:
        data = self._data
        data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, torque
        mujoco.mj_forward(self._model, data)
        return np.array(data.qacc)

    def _drive(self, q: Array, v: Array, after_s: float) -> Array:
        """Returns the torque of the drives, N m, shape (J,).

        The servo sees the motors (with the encoders' offset), the compensation the links.
        """
        reported = q[:_COUNT] + self._encoder_offset
        motor, speed = reported, v[:_COUNT]
        if self._coupling is not None:
            motor, speed = reported.copy(), speed.copy()
            motor[self._coupling.joint], speed[self._coupling.joint] = q[-1], v[-1]
        servo = self.servo.torque(motor, speed, after_s)
        return np.asarray(servo + self._compensation.torque(reported))


@final
class _GravityCompensation:
    """What the controller believes that gravity does to the arm that it knows."""

    def __init__(self, known: mujoco.MjModel) -> None:
        self._model = known
        self._data = mujoco.MjData(known)
        self._torque = np.zeros(_COUNT)

    def torque(self, position: Array) -> Array:
        """Returns the torque that holds the arm, N m, shape (J,)."""
        self._data.qpos[:] = position
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_rne(self._model, self._data, 0, self._torque)
        return self._torque


def _split_motor(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Takes a joint's armature and damping off its link; returns them."""
    inertia, damping = float(model.dof_armature[joint]), float(model.dof_damping[joint])
    model.dof_armature[joint] = model.dof_damping[joint] = 0.0
    return inertia, damping
