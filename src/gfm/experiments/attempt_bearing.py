"""What speeds make up for where a robot's gravity compensation goes by joints that count wrong.

Shape letters: J joints.
"""

from __future__ import annotations

import copy
from typing import final

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.envs.arm import VELOCITY_SHARE, ArmProblem


@final
class Bearing:
    """Knows by how much a robot's gravity compensation errs, and what speed bears that.

    A compensation goes by what the encoders say; that of a model goes by where the model is. So a
    policy that was made for the model finds the robot's arm rising or sinking: under 0.05 rad at
    right_j1 by 1 N m, of the 3.3 that its actions bring there.

    Args:
        arm: The cell, with what its encoders read at zero.
    """

    def __init__(self, arm: ArmProblem) -> None:
        self._layout, self._zero = arm.model.layout, arm.zero
        self._model = copy.copy(arm.nominal)
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        self._data = mujoco.MjData(self._model)
        self._limit = arm.velocity_limit
        self._gain = arm.nominal.actuator_gainprm[self._layout.actuator, 0]

    def speed(self, reported: Array) -> Array:
        """Returns what has to be added to the speeds of a policy, rad/s, shape (J,).

        Args:
            reported: Positions, rad, shape (J,).
        """
        if not self._zero.any():
            return np.zeros_like(reported)
        given, right = (self._compensation(at) for at in (reported + self._zero, reported))
        return np.asarray((right - given) / self._gain)

    def share(self, added: Array) -> float:
        """Returns the share of the speed limits that a policy with such speeds added has.

        Args:
            added: What `speed` returned, rad/s, shape (J,).
        """
        return VELOCITY_SHARE * (1.0 + float((np.abs(added) / self._limit).max()))

    def _compensation(self, position: Array) -> Array:
        """Returns the torques of the model's compensation, N m, (J,), where encoders read that."""
        self._data.qpos[self._layout.qpos] = position
        mujoco.mj_forward(self._model, self._data)
        return np.array(self._data.qfrc_gravcomp[self._layout.dof])
