"""What a gravity compensation that errs does to a robot, along a measured motion.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.effects.effect import Compensation
from gfm.sim.plant import Plant


@dataclass(frozen=True, kw_only=True)
class CompensationError:
    """Torques that MuJoCo's own compensation lacks.

    Attributes:
        force: On the degrees of freedom, N m, shape (T, nv).
        drive: To be counted to the drives beside what MuJoCo counts, N m, shape (T, J).
    """

    force: Array
    drive: Array


def compensation_error(plant: Plant, position: Array) -> CompensationError | None:
    """Returns the torques along measured positions (T, J); None where the compensation is right.

    They vary slowly with the position: taking them at the measured one is exact to first order.
    """
    told = plant.compensations
    if not told:
        return None
    force = np.zeros((len(position), plant.model.nv))
    drive = np.zeros((len(position), len(plant.joints)))
    for compensation in told:
        meant = _weights(plant, position, compensation, compensation.shift)
        if not compensation.missing:
            meant -= _weights(plant, position, compensation, np.zeros_like(compensation.shift))
            force += meant
        drive += meant[:, plant.dof]
    return CompensationError(force=force, drive=drive)


def _weights(plant: Plant, position: Array, compensation: Compensation, shift: Array) -> Array:
    """Returns the torques that hold the robot's weight at shifted positions, shape (T, nv)."""
    model = copy.copy(plant.model)
    model.opt.gravity = compensation.gravity
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    torques = np.empty((len(position), model.nv))
    for i, row in enumerate(position):
        data.qpos[plant.qpos] = row
        data.qpos += shift
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        torques[i] = data.qfrc_bias
        data.qpos -= shift
    return torques
