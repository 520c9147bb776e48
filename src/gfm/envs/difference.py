"""How far a simulated state is from a recorded one.

Shape letters: N any leading shape, C channels: J joint positions, J joint velocities, then with an
object 3 of its position and 3 of its rotation.
"""

from __future__ import annotations

import numpy as np

from gfm.core.checks import Array
from gfm.sim.layout import Layout

#: Beyond this, exp(-x) would leave the normal float32 numbers.
_LARGEST_EXPONENT = 80.0


def state_difference(
    layout: Layout, qpos: Array, qvel: Array, recorded_qpos: Array, recorded_qvel: Array
) -> Array:
    """Returns Delta, shape (N, C): differences, and for a rotation the vector of q * conj(p).

    Jeong et al. 2019, below eq. 6: the orientation part is the quaternion product with the
    conjugate; its rotation vector (rad) has the three degrees of freedom that it really has. The
    object's velocity, itself differenced from its pose, is left out.

    Args:
        layout: Of the model.
        qpos: Simulated, shape (N, nq).
        qvel: Simulated, shape (N, nv).
        recorded_qpos: shape (N, nq).
        recorded_qvel: shape (N, nv).
    """
    position, velocity = qpos - recorded_qpos, qvel - recorded_qvel
    parts = [position[..., layout.qpos], velocity[..., layout.dof]]
    if layout.has_object:
        pose, recorded = qpos[..., layout.object_qpos], recorded_qpos[..., layout.object_qpos]
        parts += [
            pose[..., :3] - recorded[..., :3],
            rotation_difference(pose[..., 3:], recorded[..., 3:]),
        ]
    return np.concatenate(parts, axis=-1)


def rotation_difference(p: Array, q: Array) -> Array:
    """Returns the rotation vector of p * conj(q), rad, shape (N, 3), for w x y z of unit length."""
    w = (p * q).sum(axis=-1, keepdims=True)
    pv, qv = p[..., 1:], q[..., 1:]
    vector = q[..., :1] * pv - p[..., :1] * qv - np.cross(pv, qv)
    length = np.linalg.norm(vector, axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(length, np.abs(w))  # the short way round
    sign = np.where(w < 0.0, -1.0, 1.0)
    return np.asarray(sign * vector * angle / np.maximum(length, 1e-12))


def closeness(difference: Array, scale: Array) -> Array:
    """Returns exp(-||Delta / scale||^2), in (0, 1], shape (N,).

    Jeong et al. 2019, eq. 6, with a scale per channel, shape (C,): in rad and m the norm is so
    small that the reward would be flat.
    """
    exponent = ((difference / scale) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-np.minimum(exponent, _LARGEST_EXPONENT)))
