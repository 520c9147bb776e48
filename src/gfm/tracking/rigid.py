"""Rigid motions, and how far two of them are apart."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gfm.core.checks import Array, check_shapes


@dataclass(frozen=True, kw_only=True)
class Pose:
    """A frame in its parent: x_parent = rotation x + position.

    Attributes:
        rotation: shape (3, 3).
        position: m, shape (3,).
    """

    rotation: Array
    position: Array

    def __post_init__(self) -> None:
        given = {"rotation": self.rotation, "position": self.position}
        check_shapes(given, {"rotation": (3, 3), "position": (3,)})

    def __matmul__(self, inner: Pose) -> Pose:
        return Pose(
            rotation=self.rotation @ inner.rotation,
            position=self.rotation @ inner.position + self.position,
        )

    @property
    def inverse(self) -> Pose:
        """The parent, seen from the frame."""
        return Pose(rotation=self.rotation.T, position=-self.rotation.T @ self.position)

    @property
    def quaternion(self) -> Array:
        """The rotation as w x y z, w not negative, shape (4,)."""
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, self.rotation.ravel())
        return -quaternion if quaternion[0] < 0.0 else quaternion

    @property
    def vector(self) -> Array:
        """Position and quaternion w x y z, shape (7,)."""
        return np.concatenate([self.position, self.quaternion])

    def of(self, points: Array) -> Array:
        """Returns points of the frame in its parent, m, shape (..., 3)."""
        return np.asarray(points @ self.rotation.T + self.position)


def pose_of(vector: Array) -> Pose:
    """Returns the pose of a position, m, and a quaternion w x y z of any length, shape (7,)."""
    rotation, quaternion = np.empty(9), np.array(vector[3:], float)
    mujoco.mju_normalize4(quaternion)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return Pose(rotation=rotation.reshape(3, 3), position=np.array(vector[:3], float))


def turn_by(vector: Array) -> Array:
    """Returns the rotation about a vector by its length, rad, shape (3, 3)."""
    quaternion, rotation = np.array([1.0, 0.0, 0.0, 0.0]), np.empty(9)
    mujoco.mju_quatIntegrate(quaternion, np.asarray(vector, float), 1.0)
    mujoco.mju_quat2Mat(rotation, quaternion)
    return rotation.reshape(3, 3)


def turn_of(rotation: Array) -> Array:
    """Returns the vector that a rotation (3, 3) turns about, its length the angle, rad, (3,)."""
    quaternion, vector = np.empty(4), np.empty(3)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector


def apart(one: Pose, other: Pose) -> Array:
    """Returns the error that leads from `other` to `one`, m and rad, shape (6,)."""
    turn = turn_of(one.rotation @ other.rotation.T)
    return np.concatenate([one.position - other.position, turn])


def moved(pose: Pose, error: Array) -> Pose:
    """Returns a pose changed by an error (6,): `apart(moved(p, e), p)` is e."""
    return Pose(rotation=turn_by(error[3:]) @ pose.rotation, position=pose.position + error[:3])


def cross_matrix(vector: Array) -> Array:
    """Returns the matrix of `vector x`, shape (3, 3)."""
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def looking(position: Array, target: Array) -> Pose:
    """Returns a camera at a place that looks at a target, its x axis level.

    The two must not lie on one vertical line.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward], axis=1)
    return Pose(rotation=rotation, position=np.asarray(position, float))
