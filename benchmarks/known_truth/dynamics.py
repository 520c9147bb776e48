"""Rigid-body dynamics of many chains side by side, from Jacobians of the centres of mass.

M = sum_l m_l Jv_l' Jv_l + Jw_l' I_l Jw_l, and the bias is what the same Jacobians make of the
forces of inertia at zero joint acceleration (Kane's equations; Featherstone 2008, ch. 3).

Shape letters: B chains, J joints (and links).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from known_truth.robots import Array, Robot


@dataclass(kw_only=True, eq=False)
class Chains:
    """Chains with the same axes and turns; all else may differ between them.

    Attributes:
        turn: Rotation of each frame in the one before, at q = 0, shape (J, 3, 3).
        cross: Cross-product matrix of each axis, shape (J, 3, 3).
        axis: shape (J, 3).
        offset: m, shape (B, J, 3).
        mass: kg, shape (B, J).
        com: m, shape (B, J, 3).
        inertia: About the centres of mass, in the links' frames, kg m^2, shape (B, J, 3, 3).
    """

    turn: Array
    cross: Array
    axis: Array
    offset: Array
    mass: Array
    com: Array
    inertia: Array

    def add_point_mass(self, chain: int, mass: float, com: Array) -> None:
        """Adds a point mass to the last link of one chain."""
        old, total = self.mass[chain, -1], self.mass[chain, -1] + mass
        apart = com - self.com[chain, -1]
        self.com[chain, -1] += apart * mass / total
        self.inertia[chain, -1] += (old * mass / total) * (
            apart @ apart * np.eye(3) - np.outer(apart, apart)
        )
        self.mass[chain, -1] = total


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """Where the links are, and their Jacobians.

    Attributes:
        axis: Of the joints in the base frame, shape (B, J, 3).
        origin: Of the joints in the base frame, m, shape (B, J, 3).
        lever: From each joint to its link's centre of mass, m, shape (B, J, 3).
        inertia: In the base frame, kg m^2, shape (B, J, 3, 3).
        linear: Velocity of centre l by joint j: [b, 3 l + axis, j], shape (B, 3 J, J).
        angular: The same of rotations, shape (B, 3 J, J).
    """

    axis: Array
    origin: Array
    lever: Array
    inertia: Array
    linear: Array
    angular: Array


def chains(robots: Sequence[Robot]) -> Chains:
    """Returns the chains of robots of one build."""
    first = robots[0]
    return Chains(
        turn=np.stack([rotation(turn) for turn in first.turn]),
        cross=np.stack([cross_matrix(axis) for axis in first.axis]),
        axis=first.axis,
        offset=np.stack([robot.offset for robot in robots]),
        mass=np.stack([robot.mass for robot in robots]),
        com=np.stack([robot.com for robot in robots]),
        inertia=np.stack([[np.diag(moments) for moments in robot.inertia] for robot in robots]),
    )


def pose(these: Chains, q: Array) -> Pose:
    """Returns where the chains are at joint angles q, shape (B, J)."""
    rotations, origin = _frames(these, q)
    lever = _turned(rotations, these.com)
    centre = origin + lever
    axis = _turned(rotations, np.broadcast_to(these.axis, origin.shape))
    batch, joints = q.shape
    behind = np.tri(joints)[:, None, :]  # [l, ., j]: joint j moves link l
    angular = axis.transpose(0, 2, 1)[:, None] * behind
    linear = np.empty_like(angular)
    reach = (centre[:, :, :, None] - origin.transpose(0, 2, 1)[:, None]) * behind
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        linear[:, :, x] = angular[:, :, y] * reach[:, :, z] - angular[:, :, z] * reach[:, :, y]
    return Pose(
        axis=axis,
        origin=origin,
        lever=lever,
        inertia=rotations @ these.inertia @ rotations.transpose(0, 1, 3, 2),
        linear=linear.reshape(batch, 3 * joints, joints),
        angular=angular.reshape(batch, 3 * joints, joints),
    )


def _frames(these: Chains, q: Array) -> tuple[Array, Array]:
    """Returns the links' rotations (B, J, 3, 3) and joints' places (B, J, 3)."""
    sine, cosine = np.sin(q)[..., None, None], np.cos(q)[..., None, None]
    turned = np.eye(3) + sine * these.cross + (1.0 - cosine) * (these.cross @ these.cross)
    local = these.turn @ turned
    rotations, origin = np.empty_like(local), np.empty_like(these.offset)
    rotations[:, 0], origin[:, 0] = local[:, 0], these.offset[:, 0]
    for j in range(1, q.shape[1]):
        before = rotations[:, j - 1]
        rotations[:, j] = before @ local[:, j]
        origin[:, j] = origin[:, j - 1] + (before @ these.offset[:, j, :, None])[..., 0]
    return rotations, origin


def mass_matrix(these: Chains, here: Pose) -> Array:
    """Returns the inertia seen at the joints, without armature, kg m^2, shape (B, J, J)."""
    weighted = np.repeat(these.mass, 3, axis=1)[..., None] * here.linear
    batch, rows, joints = here.angular.shape
    spin = here.inertia @ here.angular.reshape(batch, joints, 3, joints)
    return np.asarray(
        here.linear.transpose(0, 2, 1) @ weighted
        + here.angular.transpose(0, 2, 1) @ spin.reshape(batch, rows, joints)
    )


def bias(these: Chains, here: Pose, v: Array, gravity: Array) -> Array:
    """Returns the torques that keep joint velocities v constant, N m, shape (B, J).

    Args:
        these: The chains.
        here: Where they are.
        v: rad/s, shape (B, J).
        gravity: m/s^2, shape (B, 3).
    """
    rate = here.axis * v[..., None]
    omega = np.cumsum(rate, axis=1)
    before = _shifted(omega)
    alpha = np.cumsum(_cross(before, rate), axis=1)
    step = here.origin - _shifted(here.origin)
    joint = np.cumsum(_swung(before, _shifted(alpha), step), axis=1)
    centre = joint + _swung(omega, alpha, here.lever) - gravity[:, None]
    force = these.mass[..., None] * centre
    moment = _turned(here.inertia, alpha) + _cross(omega, _turned(here.inertia, omega))
    return _torques(here.linear, force) + _torques(here.angular, moment)


def weight(these: Chains, here: Pose, gravity: Array) -> Array:
    """Returns the torques that hold the chains at rest, N m, shape (B, J)."""
    return _torques(here.linear, -these.mass[..., None] * gravity[:, None])


def _torques(jacobian: Array, force: Array) -> Array:
    flat = force.reshape(len(force), 1, -1)
    return np.asarray((flat @ jacobian)[:, 0])


def _swung(omega: Array, alpha: Array, lever: Array) -> Array:
    return _cross(alpha, lever) + _cross(omega, _cross(omega, lever))


def _shifted(values: Array) -> Array:
    """Returns each link's predecessor's values; nought before the first."""
    before = np.zeros_like(values)
    before[:, 1:] = values[:, :-1]
    return before


def _turned(matrix: Array, vector: Array) -> Array:
    return np.asarray((matrix @ vector[..., None])[..., 0])


def _cross(a: Array, b: Array) -> Array:
    """Returns the cross product along the last axis; NumPy's own is several times slower."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., x] = a[..., y] * b[..., z] - a[..., z] * b[..., y]
    return out


def cross_matrix(axis: Array) -> Array:
    """Returns the matrix of the product axis x ., shape (3, 3)."""
    x, y, z = axis
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation(turn: Array) -> Array:
    """Returns the matrix of a rotation vector (Rodrigues), shape (3, 3)."""
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return np.eye(3)
    across = cross_matrix(turn / angle)
    return np.asarray(np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across)
