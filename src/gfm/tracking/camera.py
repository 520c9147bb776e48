"""A calibrated camera: how it projects, where it stands, and how well that is known."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gfm.core.checks import Array, check_shapes
from gfm.tracking.rigid import Pose, cross_matrix

#: Standard deviation of a detected corner's coordinates, unless its camera's file says otherwise.
CORNER_NOISE_PX = 0.3


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A pinhole camera with distortion.

    Attributes:
        name: Unique among the cameras.
        size_px: Width and height.
        focal_px: Focal lengths, shape (2,).
        centre_px: The principal point, shape (2,).
        distortion: OpenCV's k1 k2 p1 p2 k3, shape (5,).
        pose: The camera in the base frame.
        spread_m: Standard deviation of each coordinate of its place.
        spread_rad: Of its rotation about each axis.
        corner_noise_px: Of each coordinate of a detected corner.
    """

    name: str
    size_px: tuple[int, int]
    focal_px: Array
    centre_px: Array
    distortion: Array
    pose: Pose
    spread_m: float
    spread_rad: float
    corner_noise_px: float = CORNER_NOISE_PX

    def __post_init__(self) -> None:
        given = {n: getattr(self, n) for n in ("focal_px", "centre_px", "distortion")}
        check_shapes(given, {"focal_px": (2,), "centre_px": (2,), "distortion": (5,)})

    @property
    def matrix(self) -> Array:
        """OpenCV's camera matrix, shape (3, 3)."""
        return camera_matrix(self.focal_px, self.centre_px)

    def project(self, points: Array) -> Array:
        """Returns where points (N, 3) of the base frame, m, appear, px, shape (N, 2)."""
        seen = self.pose.inverse.of(points)
        none = np.zeros(3)
        pixels, _ = cv2.projectPoints(seen, none, none, self.matrix, self.distortion)
        return np.asarray(pixels, float).reshape(-1, 2)

    def straightened(self, pixels: Array) -> Array:
        """Returns where pixels (..., 2) would lie without distortion, px, same shape."""
        if not self.distortion.any():
            return pixels
        flat = np.ascontiguousarray(pixels.reshape(-1, 1, 2), dtype=float)
        ideal = cv2.undistortPoints(flat, self.matrix, self.distortion, P=self.matrix)
        return np.asarray(ideal, float).reshape(pixels.shape)

    def spread_at(self, position: Array) -> Array:
        """Returns what the camera's own spread makes of a pose there, m and rad, shape (6, 6)."""
        variances = np.repeat([self.spread_m**2, self.spread_rad**2], 3)
        lever = np.eye(6)
        lever[:3, 3:] = -cross_matrix(position - self.pose.position)
        return np.asarray((lever * variances) @ lever.T)


def camera_matrix(focal_px: Array, centre_px: Array) -> Array:
    """Returns OpenCV's camera matrix, shape (3, 3)."""
    matrix = np.diag([*focal_px, 1.0])
    matrix[:2, 2] = centre_px
    return matrix
