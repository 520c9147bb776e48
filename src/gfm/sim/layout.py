"""Where a robot's joints, their motor sides, their drives and a free object are in a model.

Shape letters: J joints, N any leading shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import ConfigError, UnknownNameError
from gfm.core.checks import Array

Indices = NDArray[np.intp]
#: Joints of one coordinate.
SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Addresses in qpos, qvel and ctrl.

    A motor side is a hinge or slide that is neither measured nor commanded by its own name, which
    begins with that of one that is measured, and an underscore: it starts where its joint starts.

    Attributes:
        joint_names: The measured joints, in the order of every array of joints.
        qpos: Of the joints in qpos, shape (J,).
        dof: Of the joints in qvel, shape (J,).
        actuator: Of the joints in ctrl, -1 where a joint has no drive, shape (J,).
        motor_qpos: Of the motor sides in qpos, shape (M,).
        motor_dof: Of the motor sides in qvel, shape (M,).
        motor_owner: Index of each motor side's joint, shape (M,).
        object_qpos: The free object's position and quaternion in qpos; empty without one.
        object_dof: Its velocity in qvel: linear in the world, angular in its own frame.
        qpos0: The model's default positions.
    """

    joint_names: tuple[str, ...]
    qpos: Indices
    dof: Indices
    actuator: Indices
    motor_qpos: Indices
    motor_dof: Indices
    motor_owner: Indices
    object_qpos: slice
    object_dof: slice
    qpos0: Array

    @property
    def has_object(self) -> bool:
        """Whether there is a free object."""
        return self.object_qpos != slice(0, 0)

    @property
    def driven(self) -> NDArray[np.bool_]:
        """Which joints have a drive, shape (J,)."""
        return self.actuator >= 0

    def as_qpos(self, joints: Array, free_object: Array | None = None) -> Array:
        """Returns full positions, what is neither joint nor motor side nor object at its default.

        Args:
            joints: rad, shape (..., J).
            free_object: Position m and quaternion w x y z, shape (..., 7).
        """
        qpos = np.tile(self.qpos0, (*joints.shape[:-1], 1))
        qpos[..., self.qpos] = joints
        qpos[..., self.motor_qpos] = joints[..., self.motor_owner]
        if free_object is not None:
            qpos[..., self.object_qpos] = free_object
        return qpos

    def as_qvel(self, nv: int, joints: Array, free_object: Array | None = None) -> Array:
        """Returns full velocities; joints rad/s (..., J); the object's m/s and rad/s (..., 6)."""
        qvel = np.zeros((*joints.shape[:-1], nv))
        qvel[..., self.dof] = joints
        qvel[..., self.motor_dof] = joints[..., self.motor_owner]
        if free_object is not None:
            qvel[..., self.object_dof] = free_object
        return qvel


def make_layout(model: mujoco.MjModel, joint_names: tuple[str, ...] = ()) -> Layout:
    """Returns the addresses of `joint_names`, by default of every joint that is no motor side.

    Raises:
        UnknownNameError: the model lacks one of the joints.
        ConfigError: it has more than one free body, or drives none of the joints.
    """
    there = {model.joint(i).name: i for i in range(model.njnt) if model.jnt_type[i] in SCALAR}
    driven = {model.actuator(i).name for i in range(model.nactuator)}
    names = joint_names or tuple(n for n in there if n in driven or _owner(n, there) is None)
    for name in names:
        if name not in there:
            raise UnknownNameError("joint", name, there)
    ids = np.array([there[name] for name in names], np.intp)
    others = [name for name in there if name not in (*names, *driven)]
    owners = {there[name]: owner for name in others if (owner := _owner(name, names))}
    motors = np.array(list(owners), np.intp)
    actuator_type = mujoco.mjtObj.mjOBJ_ACTUATOR
    actuator = np.array([mujoco.mj_name2id(model, actuator_type, name) for name in names], np.intp)
    if not (actuator >= 0).any():
        raise ConfigError(f"no actuator is named as one of the joints {', '.join(names)}")
    object_qpos, object_dof = _object_slices(model)
    return Layout(
        joint_names=names,
        qpos=model.jnt_qposadr[ids].astype(np.intp),
        dof=model.jnt_dofadr[ids].astype(np.intp),
        actuator=actuator,
        motor_qpos=model.jnt_qposadr[motors].astype(np.intp),
        motor_dof=model.jnt_dofadr[motors].astype(np.intp),
        motor_owner=np.array([names.index(owners[int(i)]) for i in motors], np.intp),
        object_qpos=object_qpos,
        object_dof=object_dof,
        qpos0=model.qpos0.copy(),
    )


def _owner(name: str, joints: tuple[str, ...] | dict[str, int]) -> str | None:
    """Returns the joint of which `name` is the motor side: the longest that it begins with."""
    owners = [joint for joint in joints if name.startswith(f"{joint}_")]
    return max(owners, key=len, default=None)


def _object_slices(model: mujoco.MjModel) -> tuple[slice, slice]:
    free = np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
    if len(free) > 1:
        raise ConfigError(f"the model has {len(free)} free bodies, expected at most one")
    if not len(free):
        return slice(0, 0), slice(0, 0)
    qpos, dof = int(model.jnt_qposadr[free[0]]), int(model.jnt_dofadr[free[0]])
    return slice(qpos, qpos + 7), slice(dof, dof + 6)
