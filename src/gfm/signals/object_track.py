"""What was recorded of the object, as places in the plane: where it is, and how it is turned.

Shape letters: P poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std

#: Contacts are idealised, and cameras calibrated, to this much: less noise counts as this, m, rad.
LEAST_NOISE = np.array([3e-4, 3e-4, 3e-3])
#: Poses of which noise is measured at least.
LEAST_POSES = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """One recording's object.

    Attributes:
        time_s: Since the recording's first joint state, shape (P,).
        pose: Position m and quaternion w x y z, shape (P, 7).
        plane: x and y in m, and the yaw since the first pose in rad, shape (P, 3).
    """

    time_s: Array
    pose: Array
    plane: Array


def track_of(recording: Trajectory) -> Track | None:
    """Returns what a recording has of the object; None where that is too little to see it move."""
    track = recording.object_track
    if track is None or len(track.stamp_ns) < LEAST_POSES:
        return None
    pose = np.hstack([track.position, track.quaternion])
    return Track(
        time_s=np.asarray((track.stamp_ns - recording.stamp_ns[0]) * 1e-9),
        pose=pose,
        plane=in_plane(pose, pose[0]),
    )


def in_plane(pose: Array, first: Array) -> Array:
    """Returns x, y and the yaw since `first`, shape (..., 3), for poses (..., 7).

    Of several poses in a row the yaw has no jumps.
    """
    inverse = first[3:] * [1.0, -1.0, -1.0, -1.0]
    w1, x1, y1, z1 = np.moveaxis(pose[..., 3:], -1, 0)
    w2, x2, y2, z2 = inverse
    w = w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2
    z = w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2
    yaw = 2.0 * np.arctan2(z, w)
    yaw = np.unwrap(yaw) if yaw.ndim else yaw
    return np.concatenate([pose[..., :2], yaw[..., None]], axis=-1)


def turned(pose: Array, plane: Array, before: Array) -> Array:
    """Returns `pose`, which is at `before` in the plane, moved to `plane`, shape (7,)."""
    half = 0.5 * (plane[2] - before[2])
    turn, quaternion = np.array([np.cos(half), 0.0, 0.0, np.sin(half)]), np.empty(4)
    mujoco.mju_mulQuat(quaternion, turn, pose[3:])
    return np.concatenate([plane[:2], pose[2:3], quaternion])


def plane_noise(tracks: list[Track]) -> Array:
    """Returns the standard deviations of x, y (m) and yaw (rad), shape (3,)."""
    found = np.stack([noise_std(t.time_s, t.plane) for t in tracks])
    return np.asarray(np.maximum(np.median(found, axis=0), LEAST_NOISE))
