"""Sawyer's torques and accelerations by its published model.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.sawyer import sawyer_spec
from gfm_robot_bridge.torque import Dynamics


@final
class SawyerDynamics(Dynamics):
    """The nominal arm: rigid links and motors, some damping; its gravity compensation is exact."""

    def __init__(self) -> None:
        self._model = sawyer_spec(command=CommandKind.EFFORT).compile()
        self._model.opt.gravity[:] = 0.0
        self._data = mujoco.MjData(self._model)
        self._inertia = np.zeros((self._model.nv, self._model.nv))

    @override
    def accelerations(self, position: Array, velocity: Array, torque: Array) -> Array:
        lost = self._lost(position, velocity)
        return np.asarray(np.linalg.solve(self._inertia, torque - lost))

    @override
    def torques(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        lost = self._lost(position, velocity)
        return np.asarray(self._inertia @ acceleration + lost)

    def _lost(self, position: Array, velocity: Array) -> Array:
        """Returns the torque that accelerates nothing, N m, shape (J,); takes the mass matrix."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = position, velocity
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, self._inertia)
        return np.asarray(data.qfrc_bias - data.qfrc_passive)
