"""How near the arm came to what it must not touch, and commands that aim at it.

Distances are MuJoCo's between two shapes, in the published model of arm, tool and basket, for every
pair that could meet. Nothing here is the bridge's.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim import sawyer_numbers as numbers
from gfm.sim.sawyer import sawyer_spec

#: Distances beyond this are taken as this, m.
FAR_M = 0.5
#: How far from each joint's axis any point of arm and tool can be, m: the links' lengths after it.
_REACH_M = np.array([1.7, 1.5, 1.3, 1.0, 0.8, 0.5, 0.35])
TARGETS = ("box", "basket", "itself")
_GEOM = mujoco.mjtGeom
_AIMED = ("right_l3", "right_l4", "right_l5", "right_l6", "plate", "plate")


@final
class Geometry:
    """The published cell.

    Args:
        box: Lower and upper corner of the workspace, m, shape (6,).
    """

    def __init__(self, box: tuple[float, ...]) -> None:
        spec = sawyer_spec(command=CommandKind.EFFORT, end_effector="plate", basket=True)
        self._model = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._box = np.array(box).reshape(2, 3)
        count, moves = self._model.ngeom, self._model.body_weldid[self._model.geom_bodyid]
        self._moving = np.flatnonzero(moves)
        self._shapes = _Shapes(self._model, self._moving)
        pairs = [(int(i), j) for i in self._moving for j in range(count)]
        self._pairs = {
            "basket": [(i, j) for i, j in pairs if not moves[j]],
            "itself": [(i, j) for i, j in pairs if i < j and self._could_meet(moves[i], moves[j])],
        }

    def distances(self, position: Array) -> dict[str, float]:
        """Returns how near the arm is to each of TARGETS, m, at most FAR_M; joints rad, (J,)."""
        model, data = self._model, self._data
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        return {"box": self._to_box()} | {
            name: min(mujoco.mj_geomDistance(model, data, *pair, FAR_M, None) for pair in pairs)
            for name, pairs in self._pairs.items()
        }

    def moved(self, before: Array, after: Array) -> float:
        """Returns how far a point of the arm went at most between two positions, m."""
        return float(_REACH_M @ np.abs(after - before))

    def speed_towards(self, target: str, position: Array, choice: Array) -> Array:
        """Returns joint speeds that lead a link straight to a target, rad/s for 1 m/s, shape (J,).

        Args:
            target: One of TARGETS.
            position: rad, shape (J,).
            choice: In [0, 1], shape (4,): of a link, and of a place on the target.
        """
        model, data = self._model, self._data
        data.qpos[:] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        body = model.body(_AIMED[int(choice[0] * len(_AIMED)) % len(_AIMED)]).id
        place = data.geom_xpos[model.body_geomadr[body]].copy()
        way = self._place(target, choice[1:]) - place
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, place, body)
        return np.asarray(np.linalg.pinv(jacobian, rcond=0.05) @ way / np.linalg.norm(way))

    def _place(self, target: str, choice: Array) -> Array:
        if target == "box":
            middle, size = self._box.mean(axis=0), np.diff(self._box, axis=0)[0]
            out = 2.0 * choice - 1.0
            return np.asarray(middle + size * out / np.abs(out).max())
        if target == "basket":
            around = (2.0 * choice - 1.0) * (0.45, 0.45, 0.08)
            return np.asarray(np.array(numbers.BASKET_XYZ) + around)
        names = ("right_l0", "head", "right_l1", "right_l2")
        return np.asarray(self._data.xipos[self._model.body(names[int(choice[0] * 3.99)]).id])

    def _could_meet(self, first: int, second: int) -> bool:
        """Returns whether two moving bodies are neither one nor neighbours in the chain."""
        parents = self._model.body_weldid[self._model.body_parentid[[first, second]]]
        return bool(second and first != second and first != parents[1] and second != parents[0])

    def _to_box(self) -> float:
        centre, extent = self._shapes.extents(self._data)
        inside = np.minimum(centre - extent - self._box[0], self._box[1] - centre - extent)
        return min(float(inside.min()), FAR_M)


@final
class _Shapes:
    """How far shapes extend along the axes of the world."""

    def __init__(self, model: mujoco.MjModel, geoms: NDArray[np.intp]) -> None:
        kind, size = model.geom_type[geoms], model.geom_size[geoms]
        box, disc = (kind == int(shape) for shape in (_GEOM.mjGEOM_BOX, _GEOM.mjGEOM_CYLINDER))
        along = np.where(kind == int(_GEOM.mjGEOM_SPHERE), 0.0, size[:, 1])
        rod = np.stack([np.zeros(len(geoms)), np.zeros(len(geoms)), along], axis=1)
        self._geoms = geoms
        self._core = np.where(box[:, None], size, rod)
        self._ball = np.where(box | disc, 0.0, size[:, 0])
        self._disc = np.where(disc, size[:, 0], 0.0)

    def extents(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Returns centres and how far shapes reach from them, m, shape (geoms, 3) each."""
        turn = data.geom_xmat[self._geoms].reshape(-1, 3, 3)
        across = np.sqrt(np.maximum(1.0 - turn[:, :, 2] ** 2, 0.0))
        reach = np.einsum("gij,gj->gi", np.abs(turn), self._core)
        reach += self._ball[:, None] + self._disc[:, None] * across
        return data.geom_xpos[self._geoms], reach
