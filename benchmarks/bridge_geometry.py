"""How near the arm came to what it must not touch, and commands that aim at it.

Distances are MuJoCo's between two shapes, in the published model of arm, tool and basket, for every
pair that could meet. Nothing here is the bridge's.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Mapping
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

    Attributes:
        approach: How far the shapes of each pair come nearer at most where a joint moves by 1 rad,
            m, shape (pairs, J).
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
        self._every = [pair for of_target in self._pairs.values() for pair in of_target]
        apart = [self._moved_by(i) ^ self._moved_by(j) for i, j in self._every]
        self.approach = np.array(apart) * _REACH_M

    @property
    def of_target(self) -> dict[str, slice]:
        """Which pairs of shapes belong to basket and ground, and which to the arm itself."""
        first, count = len(self._pairs["basket"]), len(self.approach)
        return {"basket": slice(0, first), "itself": slice(first, count)}

    def to_box(self, position: Array) -> float:
        """Returns how near the arm is to a side of the box, m, at most FAR_M; joints rad, (J,)."""
        self._put(position)
        return self._to_box()

    def between(self, position: Array, pairs: NDArray[np.intp]) -> Array:
        """Returns the distances of some pairs of shapes, m, at most FAR_M; joints rad, (J,)."""
        self._put(position)
        model, data, every = self._model, self._data, self._every
        return np.array(
            [mujoco.mj_geomDistance(model, data, *every[pair], FAR_M, None) for pair in pairs]
        )

    def distances(self, position: Array) -> dict[str, float]:
        """Returns how near the arm is to each of TARGETS, m, at most FAR_M; joints rad, (J,)."""
        distances = self.between(position, np.arange(len(self.approach)))
        found = {name: float(distances[pairs].min()) for name, pairs in self.of_target.items()}
        return {"box": self.to_box(position)} | found

    def _put(self, position: Array) -> None:
        self._data.qpos[:] = position
        mujoco.mj_kinematics(self._model, self._data)

    def _moved_by(self, geom: int) -> NDArray[np.bool_]:
        """Returns which joints move a shape, shape (J,)."""
        moves, body = np.zeros(len(_REACH_M), dtype=bool), int(self._model.geom_bodyid[geom])
        while body:
            first, count = self._model.body_dofadr[body], self._model.body_dofnum[body]
            moves[first : first + count] |= count > 0
            body = int(self._model.body_parentid[body])
        return moves

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
class Nearest:
    """How near an arm comes while it moves, of which only what can be the least is measured.

    A distance changes by no more than joints between its two shapes move times how far these
    reach: one that was larger by more than that when it was measured last is larger still.
    """

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        count, joints = geometry.approach.shape
        self._distance, self._at = np.zeros(count), np.zeros((count, joints))
        self._box, self._box_at = 0.0, np.zeros(joints)

    def below(self, position: Array, least: Mapping[str, float]) -> dict[str, float]:
        """Returns the distances that are below those that were the least, m, by target.

        Args:
            position: rad, shape (J,).
            least: By target, m.
        """
        geometry, found = self._geometry, {}
        if self._box - _REACH_M @ np.abs(position - self._box_at) < least["box"]:
            self._box, self._box_at = geometry.to_box(position), position
            found["box"] = self._box
        gone = (geometry.approach * np.abs(position - self._at)).sum(axis=1)
        for target, pairs in geometry.of_target.items():
            near = np.flatnonzero(self._distance[pairs] - gone[pairs] < least[target])
            if not len(near):
                continue
            near += pairs.start
            self._distance[near] = geometry.between(position, near)
            self._at[near] = position
            found[target] = float(self._distance[near].min())
        return {target: value for target, value in found.items() if value < least[target]}


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
