"""Whether a path is safe: what it would touch, and which torques it would take, by the model.

Shape letters: N points of a path, J joints.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import combinations
from typing import final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.excitation.limits import RobotLimits

#: A path is checked at least so often, s.
CHECK_S = 0.005
#: Steps in which a way is looked at, rad.
WAY_STEP = 0.01
_DISABLE_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
#: Joints that have less than this share in a fault than the one that has most are not to blame.
_BLAME_SHARE = 0.3

Mask = NDArray[np.bool_]


class FaultKind(Enum):
    """Why a path cannot be taken."""

    CONTACT = "contact"
    LOAD = "load"
    DYNAMICS = "dynamics"


@dataclass(frozen=True, kw_only=True)
class Fault:
    """The first point of a path that is not safe.

    Attributes:
        kind: A contact, a torque at rest, or a torque of the motion.
        words: What would happen, in words.
        position: Where, rad, shape (J,).
        joints: Which joints are to blame, shape (J,).
    """

    kind: FaultKind
    words: str
    position: Array
    joints: Mask


@dataclass(frozen=True, kw_only=True)
class _Touch:
    """Two bodies that are too close: which, how far apart, where, and along which way."""

    bodies: tuple[int, int]
    distance_m: float
    place: Array
    normal: Array


@final
class SafetyCheck:
    """Knows what of a robot may touch what, and which torques its drives have.

    Args:
        model: Of the robot and whatever stands around it.
        limits: Of the robot; the pose in which motions begin must be free.
        clearance_m: Distance to keep. Bodies that are closer in that pose must only not touch.

    Raises:
        ConfigError: something touches where motions begin.
    """

    def __init__(
        self, model: mujoco.MjModel, limits: RobotLimits, *, clearance_m: float = 0.01
    ) -> None:
        self._limits = limits
        self._clearance_m = clearance_m
        self._model = copy.copy(model)
        self._model.opt.disableflags &= ~_DISABLE_CONTACT
        self._model.geom_margin[:] = clearance_m
        self._model.geom_gap[:] = 0.0
        self._dynamics = copy.copy(model)
        self._dynamics.opt.disableflags |= _DISABLE_CONTACT
        self._dynamics.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
        self._dynamics.opt.integrator = int(mujoco.mjtIntegrator.mjINT_EULER)
        self._data = mujoco.MjData(self._model)
        self._inverse = mujoco.MjData(self._dynamics)
        joints = [model.joint(name) for name in limits.joint_names]
        self._qpos = np.array([joint.qposadr[0] for joint in joints])
        self._dof = np.array([joint.dofadr[0] for joint in joints])
        self._compensated = np.array([bool(model.jnt_actgravcomp[joint.id]) for joint in joints])
        self._moved = _moved_bodies(model, {joint.id for joint in joints})
        self._boxes = _pairs_of_boxes(model, self._moved)
        self._near = self._pairs_at_start()

    @property
    def sees_geometry(self) -> bool:
        """Whether anything on the moving links can collide at all."""
        model = self._model
        solid = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        return bool((solid & self._moved[model.geom_bodyid]).any())

    def contact(self, positions: Array) -> Fault | None:
        """Returns the first contact at any of the given points, shape (N, J); None without one."""
        for position in positions:
            touching = self._touching(position, self._near)
            if touching is not None:
                return self._contact_fault(touching, position)
        return None

    def way(self, here: Array, there: Array) -> Fault | None:
        """Returns the first contact on the straight way between two postures, shape (J,).

        What is closer than the clearance at its beginning must only not touch.
        """
        count = max(int(np.abs(there - here).max() / WAY_STEP), 1) + 1
        near = self._near | self._pairs(here)
        for position in here + np.linspace(0.0, 1.0, count)[:, np.newaxis] * (there - here):
            touching = self._touching(position, near)
            if touching is not None:
                return self._contact_fault(touching, position)
        return None

    def fault(self, positions: Array, period_s: float) -> Fault | None:
        """Returns why a path cannot be taken; None where it can.

        Args:
            positions: Evenly spaced in time, rad, shape (N, J).
            period_s: Between two of them.
        """
        return self._overload(positions, period_s) or self.contact(refined(positions, period_s))

    def at_rest(self, position: Array) -> Fault | None:
        """Returns why the robot cannot rest in a posture, shape (J,); None where it can."""
        return self._overload(np.tile(position, (2, 1)), 1.0) or self.contact(position[np.newaxis])

    def torque(self, positions: Array, period_s: float) -> Array:
        """Returns the drive torques that a path takes, without gravity compensation, (N, J)."""
        velocity = np.gradient(positions, period_s, axis=0)
        return self._needed(positions, velocity, np.gradient(velocity, period_s, axis=0))

    def inertia(self, position: Array) -> Array:
        """Returns the inertia of each joint with all that it moves, kg m^2, shape (J,)."""
        return np.asarray(np.diag(self._inertia_matrix(position)))

    def _inertia_matrix(self, position: Array) -> Array:
        data, model = self._inverse, self._dynamics
        data.qpos[self._qpos] = position
        mujoco.mj_fwdPosition(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, full)
        return np.asarray(full[np.ix_(self._dof, self._dof)])

    def _overload(self, positions: Array, period_s: float) -> Fault | None:
        needed = np.abs(self.torque(positions, period_s))
        over = needed > self._limits.effort
        if not over.any():
            return None
        point, joint = (int(i[0]) for i in np.nonzero(over))
        still, limit = np.zeros((1, len(self._dof))), self._limits.effort[joint]
        at_rest = np.abs(self._needed(positions[point : point + 1], still, still))[0, joint]
        heavy = at_rest > limit
        return Fault(
            kind=FaultKind.LOAD if heavy else FaultKind.DYNAMICS,
            words=f"{self._limits.joint_names[joint]} would need {needed[point, joint]:.3g} N m of "
            f"the {limit:.3g} that motions may use",
            position=positions[point],
            joints=np.ones(len(self._dof), bool)
            if heavy
            else self._pushing(positions, period_s, point, joint),
        )

    def _pushing(self, positions: Array, period_s: float, point: int, joint: int) -> Mask:
        """Returns the joints whose acceleration takes most of one joint's torque, shape (J,)."""
        velocity = np.gradient(positions, period_s, axis=0)
        acceleration = np.gradient(velocity, period_s, axis=0)[point]
        row = self._inertia_matrix(positions[point])[joint]
        torque = row * acceleration * np.sign(row @ acceleration)
        return np.asarray(torque >= _BLAME_SHARE * torque.max())

    def _needed(self, positions: Array, velocity: Array, acceleration: Array) -> Array:
        data, torque = self._inverse, np.empty_like(positions)
        for i, (q, v, a) in enumerate(zip(positions, velocity, acceleration, strict=True)):
            data.qpos[self._qpos], data.qvel[self._dof], data.qacc[self._dof] = q, v, a
            mujoco.mj_inverse(self._dynamics, data)
            torque[i] = data.qfrc_inverse[self._dof]
            torque[i] -= np.where(self._compensated, data.qfrc_gravcomp[self._dof], 0.0)
        return torque

    def _pairs_at_start(self) -> dict[tuple[int, int], float]:
        """Returns the pairs of bodies that are closer than the clearance where motions begin."""
        near = self._pairs(self._limits.start)
        touching = self._touching(self._limits.start, near)
        if touching is not None:
            raise ConfigError(
                f"where motions begin, {self._named(touching.bodies)} touch; name another keyframe "
                "with --pose, or exclude the pair from contact in the model"
            )
        return near

    def _pairs(self, position: Array) -> dict[tuple[int, int], float]:
        """Returns the pairs that are closer than the clearance, and the distance to keep: none."""
        return {touch.bodies: 0.0 for touch in self._nearby(position)}

    def _touching(self, position: Array, near: Mapping[tuple[int, int], float]) -> _Touch | None:
        """Returns the closest contact of a moved body that is too close."""
        close = [
            touch
            for touch in self._nearby(position)
            if self._moved[list(touch.bodies)].any()
            and touch.distance_m < near.get(touch.bodies, self._clearance_m)
        ]
        return min(close, key=lambda touch: touch.distance_m, default=None)

    def _nearby(self, position: Array) -> Iterator[_Touch]:
        """Yields what is closer than the clearance, or touches.

        Between two boxes MuJoCo's collision detection misses what is near an edge or a corner and
        does not touch; so their distance is measured by itself.
        """
        model, data = self._model, self._data
        data.qpos[self._qpos] = position
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        for i in range(data.ncon):
            contact = data.contact
            yield _Touch(
                bodies=self._bodies(contact.geom[i]),
                distance_m=float(contact.dist[i]),
                place=contact.pos[i].copy(),
                normal=contact.frame[i, :3].copy(),
            )
        for pair in self._boxes:
            ends = np.zeros(6)
            distance_m = mujoco.mj_geomDistance(model, data, *pair, self._clearance_m, ends)
            if 0.0 < distance_m < self._clearance_m:
                yield _Touch(
                    bodies=self._bodies(pair),
                    distance_m=distance_m,
                    place=(ends[:3] + ends[3:]) / 2.0,
                    normal=(ends[3:] - ends[:3]) / distance_m,
                )

    def _bodies(self, geoms: NDArray[np.integer]) -> tuple[int, int]:
        first, second = self._model.geom_bodyid[geoms]
        return int(first), int(second)

    def _named(self, bodies: tuple[int, int]) -> str:
        return " and ".join(self._model.body(body).name or f"body {body}" for body in bodies)

    def _contact_fault(self, touch: _Touch, position: Array) -> Fault:
        return Fault(
            kind=FaultKind.CONTACT,
            words=f"{self._named(touch.bodies)} would come within "
            f"{1e3 * self._clearance_m:g} mm of each other",
            position=position,
            joints=self._parting(touch, position),
        )

    def _parting(self, touch: _Touch, position: Array) -> Mask:
        """Returns the joints whose way back to the start parts the two bodies most, shape (J,)."""
        mujoco.mj_comPos(self._model, self._data)
        speeds = []
        for body in touch.bodies:
            jacobian = np.zeros((3, self._model.nv))
            mujoco.mj_jac(self._model, self._data, jacobian, None, touch.place, body)
            speeds.append(touch.normal @ jacobian[:, self._dof])
        parting = (speeds[1] - speeds[0]) * (self._limits.start - position)
        if parting.max() <= 0.0:
            return np.ones(len(parting), bool)
        return np.asarray(parting > _BLAME_SHARE * parting.max())


def refined(positions: Array, period_s: float) -> Array:
    """Returns the path, straight between its points, with a point at least every `CHECK_S`."""
    pieces = max(int(np.ceil(period_s / CHECK_S)), 1)
    fine = np.linspace(0.0, len(positions) - 1.0, pieces * (len(positions) - 1) + 1)
    coarse = np.arange(len(positions))
    return np.stack([np.interp(fine, coarse, column) for column in positions.T], axis=1)


def _pairs_of_boxes(model: mujoco.MjModel, moved: Mask) -> list[NDArray[np.intp]]:
    """Returns the pairs of boxes that may touch one another and of which one is moved."""
    boxes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    own, does, feels = model.geom_bodyid, model.geom_contype, model.geom_conaffinity
    weld, excluded = model.body_weldid, set(model.exclude_signature.tolist())
    pairs = []
    for a, b in combinations(boxes, 2):
        low, high = sorted((int(own[a]), int(own[b])))
        ends, welded = (low, high), {int(weld[low]), int(weld[high])}
        parents = {int(weld[model.body_parentid[one]]) for one in welded if one}
        if len(welded) == 1 or (0 not in welded and parents & welded):
            continue  # one body, or neighbours in a chain
        solid = does[a] & feels[b] or does[b] & feels[a]
        if solid and moved[list(ends)].any() and (low << 16) + high not in excluded:
            pairs.append(np.array([a, b]))
    return pairs


def _moved_bodies(model: mujoco.MjModel, joints: set[int]) -> Mask:
    """Returns which bodies the joints move, shape (nbody,)."""
    moved = np.zeros(model.nbody, bool)
    for body in range(1, model.nbody):
        first = int(model.body_jntadr[body])
        own = range(first, first + int(model.body_jntnum[body]))
        moved[body] = moved[model.body_parentid[body]] or bool(joints.intersection(own))
    return moved
