"""How near an arm is to what stands around it, to the walls of its workspace, and to itself.

Distances are those of MuJoCo's collision detection. Neighbours in the chain of links, which always
overlap, are left out there.

Shape letters: J joints, C places where two shapes are near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import Reason
from gfm.core.checks import Array

#: Distances beyond this are not measured, m.
SEEN_M = 0.1
_WALL = "workspace_wall_"
#: A cylinder is taken as a prism around it with so many sides.
_SIDES = 16
_GEOM = mujoco.mjtGeom

#: Lower corner x, y, z and upper corner x, y, z, m, in the robot's base frame.
Box = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Near:
    """Where two shapes are near one another.

    Attributes:
        pair: Which two, as a number; the same two may be near in several places, shape (C,).
        distance: Between them, m; negative where they overlap, shape (C,).
    """

    pair: NDArray[np.int32]
    distance: Array


@final
class Surroundings:
    """Distances of an arm in any posture.

    Args:
        model: As `guarded_model` makes it; its joints are the arm's, in their order.

    Attributes:
        pairs: Numbers of pairs are below this.
        reach: How far a point of the arm moves at most where one joint moves by 1 rad (or m), m,
            shape (J,).
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self.pairs = model.ngeom**2
        self.reach = _reach(model)
        self._model, self._data = model, mujoco.MjData(model)
        names = (model.geom(i).name for i in range(model.ngeom))
        self._is_wall = np.array([name.startswith(_WALL) for name in names])

    def near(self, position: Array) -> Near:
        """Returns what is nearer than `SEEN_M`, or overlaps, in a posture, rad, shape (J,)."""
        model, data = self._model, self._data
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        found = data.contact
        return Near(pair=found.geom1 * model.ngeom + found.geom2, distance=found.dist.copy())

    def reason(self, pair: int) -> Reason:
        """Returns what it is called when a pair is too near."""
        ends = self._is_wall[list(divmod(pair, self._model.ngeom))]
        return Reason.WORKSPACE if ends.any() else Reason.COLLISION

    def named(self, pair: int) -> str:
        """Returns the names of a pair's shapes."""
        return " and ".join(self._model.geom(end).name for end in divmod(pair, self._model.ngeom))

    def parting(self) -> Array:
        """Returns how fast the shapes of the last `near` part when joints move, m/rad, (C, J)."""
        model, data = self._model, self._data
        mujoco.mj_comPos(model, data)
        rows, jacobian = np.empty((data.ncon, model.nv)), np.empty((2, 3, model.nv))
        bodies = model.geom_bodyid[data.contact.geom]
        for row, place, frame, ends in zip(
            rows, data.contact.pos, data.contact.frame, bodies, strict=True
        ):
            for end in (0, 1):
                mujoco.mj_jac(model, data, jacobian[end], None, place, ends[end])
            row[:] = frame[:3] @ (jacobian[1] - jacobian[0])
        return rows


def guarded_model(spec: mujoco.MjSpec, workspace: Box) -> mujoco.MjModel:
    """Returns the model in which distances are measured; the spec is changed.

    Boxes and cylinders that move become hulls of their corners: between two boxes MuJoCo misses
    what is near an edge or a corner, between hulls it does not.

    Args:
        spec: Of the arm and what stands around it.
        workspace: What no part of the arm may leave; empty for no such box.
    """
    for geom in list(spec.geoms):
        if geom.type in (_GEOM.mjGEOM_BOX, _GEOM.mjGEOM_CYLINDER) and _moves(geom.parent):
            _make_hull(spec, geom)
    for side in range(len(workspace)):
        _add_wall(spec, side, workspace)
    for geom in spec.geoms:
        geom.margin, geom.gap = SEEN_M / 2.0, 0.0  # of two shapes they are summed
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_MULTICCD  # one place of two hulls will do
    return model


def _moves(body: mujoco.MjsBody) -> bool:
    while body.parent is not None:
        if body.joints:
            return True
        body = body.parent
    return False


def _make_hull(spec: mujoco.MjSpec, geom: mujoco.MjsGeom) -> None:
    x, y, z = geom.size
    if geom.type == _GEOM.mjGEOM_BOX:
        outline = [(sx * x, sy * y) for sx in (-1, 1) for sy in (-1, 1)]
    else:
        radius, z = x / math.cos(math.pi / _SIDES), y
        angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
        outline = [(radius * math.cos(angle), radius * math.sin(angle)) for angle in angles]
    corners = [(*corner, end) for corner in outline for end in (-z, z)]
    name = f"hull_of_{geom.name}"
    spec.add_mesh(name=name, uservert=np.ravel(corners))
    geom.type, geom.meshname = _GEOM.mjGEOM_MESH, name


def _add_wall(spec: mujoco.MjSpec, side: int, workspace: Box) -> None:
    """Adds one of six planes: lower x, y, z, then upper."""
    place, inwards = np.zeros(3), np.zeros(3)
    place[side % 3], inwards[side % 3] = workspace[side], 1.0 if side < 3 else -1.0
    wall = spec.worldbody.add_geom(
        name=f"{_WALL}{side}", type=_GEOM.mjGEOM_PLANE, size=(0.0, 0.0, 1.0), pos=place
    )
    wall.alt.type = mujoco.mjtOrientation.mjORIENTATION_ZAXIS
    wall.alt.zaxis = inwards


def _reach(model: mujoco.MjModel) -> Array:
    """Returns the chains' lengths: from each joint to the farthest point that it moves, (J,)."""
    reach = np.zeros(model.nv)
    for geom, first in enumerate(model.geom_bodyid):
        far, body = model.geom_rbound[geom] + np.linalg.norm(model.geom_pos[geom]), int(first)
        while body:
            for joint in range(model.njnt)[model.body_jntadr[body] :][: model.body_jntnum[body]]:
                arm = far + np.linalg.norm(model.jnt_pos[joint])
                slides = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE
                dof = model.jnt_dofadr[joint]
                reach[dof] = max(reach[dof], 1.0 if slides else arm)
            far += np.linalg.norm(model.body_pos[body])
            body = int(model.body_parentid[body])
    return reach
