"""What a gravity compensation that errs does to a robot.

Shape letters: T positions, J joints.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

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
        drive: To be counted to the drives beside what MuJoCo counts, N m, shape (T, nv).
    """

    force: Array
    drive: Array


@final
class ErringCompensation:
    """The errors of one robot's compensation, at any position.

    What the controller computes, less what MuJoCo does: under the gravity in which it believes, at
    the position with all that is added to it. Effects that mislead it together are one error.
    """

    def __init__(self, model: mujoco.MjModel, told: Sequence[Compensation]) -> None:
        believed = [one.gravity for one in told if one.gravity is not None]
        shifts = [one.shift for one in told if one.shift is not None]
        self._shift = np.sum(shifts, axis=0) if shifts else np.zeros(model.nq)
        self._moved = [one.moved for one in told if one.moved is not None]
        self._own = _Borne(model, model.opt.gravity)
        self._meant = _Borne(model, believed[-1] if believed else model.opt.gravity)

    def at(self, qpos: Array) -> CompensationError:
        """Returns the errors at positions of shape (T, nq)."""
        meant = self._meant.torques(qpos + self._shift)
        drive = meant - self._own.torques(qpos)
        force = drive.copy()
        for link, motor in self._moved:
            force[:, link] -= meant[:, link]
            force[:, motor] += meant[:, link]
        return CompensationError(force=force, drive=drive)


def compensation_error(plant: Plant, position: Array) -> CompensationError | None:
    """Returns the torques along measured positions (T, J); None where the compensation is right.

    They vary slowly with the position: taking them at the measured one is exact to first order.
    """
    told = plant.compensations
    if not told:
        return None
    qpos = np.tile(plant.model.qpos0, (len(position), 1))
    qpos[:, plant.qpos] = position
    return ErringCompensation(plant.model, told).at(qpos)


@final
class _Borne:
    """What bears the weight of the bodies that a compensation knows, and of no others."""

    def __init__(self, model: mujoco.MjModel, gravity: Array) -> None:
        self._model = copy.copy(model)
        self._model.opt.gravity = gravity
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self._data = mujoco.MjData(self._model)

    def torques(self, qpos: Array) -> Array:
        """Returns the torques at rest, N m, shape (T, nv)."""
        torques = np.empty((len(qpos), self._model.nv))
        for row, place in zip(torques, qpos, strict=True):
            self._data.qpos[:] = place
            mujoco.mj_fwdPosition(self._model, self._data)
            mujoco.mj_fwdVelocity(self._model, self._data)
            row[:] = self._data.qfrc_gravcomp
        return torques
