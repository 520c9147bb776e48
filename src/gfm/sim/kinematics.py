"""Where a site is, how a free object is turned, and what acts along a motion, without stepping.

Shape letters: N states, J joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import final

import mujoco
import numpy as np

from gfm.core import UnknownNameError
from gfm.core.checks import Array
from gfm.sim.plant import Plant


@final
class SiteKinematics:
    """The place of one site for given joint positions; the same numbers a robot's would give."""

    def __init__(self, model: mujoco.MjModel, site: str) -> None:
        names = [model.site(i).name for i in range(model.nsite)]
        if site not in names:
            raise UnknownNameError("site", site, names)
        self._model, self._data = model, mujoco.MjData(model)
        self._site = names.index(site)

    def positions(self, qpos: Array) -> Array:
        """Returns the site in the base frame, m, shape (N, 3), for positions (N, nq)."""
        places = np.empty((len(qpos), 3))
        for place, row in zip(places, qpos, strict=True):
            self._data.qpos[:] = row
            mujoco.mj_kinematics(self._model, self._data)
            place[:] = self._data.site_xpos[self._site]
        return places

    def jacobian(self, qpos: Array) -> Array:
        """Returns how the site moves with each degree of freedom, m/rad, (3, nv), at qpos (nq,)."""
        rows = np.empty((3, self._model.nv))
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_jacSite(self._model, self._data, rows, None, self._site)
        return rows


def along(plant: Plant, position: Array, velocity: Array) -> Iterator[mujoco.MjData]:
    """Yields a model's state along a motion (N, J), with passive forces and energies."""
    model, data = plant.model, mujoco.MjData(plant.model)
    for q, v in zip(position, velocity, strict=True):
        data.qpos[plant.qpos], data.qvel[plant.dof] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        yield data


def body_axes(quaternion: Array) -> Array:
    """Returns the body's x and z axes in the world, shape (N, 6).

    Unlike the quaternion (w x y z, of unit length, shape (N, 4)) they have no sign to choose, and
    turn continuously all the way round.
    """
    w, x, y, z = quaternion.T
    forward = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y))
    upward = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    return np.stack([*forward, *upward], axis=1)


def yaw_of(axes: Array) -> Array:
    """Returns the turn about the vertical, rad in (-pi, pi], shape (N,), of `body_axes` (N, 6)."""
    return np.asarray(np.arctan2(axes[:, 1], axes[:, 0]))


def wrapped(angle: Array) -> Array:
    """Returns angles, rad, in [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)
