"""From where a film of three robots is seen, and how large their differences are drawn.

Shape letters: F pictures, P points on the robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gfm.core.checks import Array

#: Seen from a little above, degrees.
ELEVATION = -18.0
#: Directions that are tried, degrees; the first is taken where one is as good as another.
AZIMUTHS = tuple((135.0 + step) % 360.0 for step in range(0, 180, 15))
#: Share of the robot's size by which the nominal robot stands off at least, if enlarging does it.
SEEN = 0.05
ENLARGED = (1, 2, 5, 10, 20, 50, 100)
#: The camera: its angle from bottom to top, degrees, the tangent of half of it, the ratio of the
#: picture's width to its height; and the room that is left around the robot.
FOVY = 45.0
OPENING, RATIO, MARGIN = float(np.tan(np.radians(0.5 * FOVY))), 4.0 / 3.0, 1.15


@dataclass(frozen=True, kw_only=True)
class View:
    """A camera.

    Attributes:
        lookat: Point in the middle of the picture, m.
        distance_m: From there.
        azimuth: Degrees.
        elevation: Degrees.
        enlarged: How many times as large as they are differences should be drawn.
    """

    lookat: tuple[float, float, float]
    distance_m: float
    azimuth: float
    elevation: float
    enlarged: int


def make_view(model: mujoco.MjModel, measured: Array, nominal: Array) -> View:
    """Returns a view that the measured robot fills, from where the difference is seen best.

    Args:
        model: Of the robot.
        measured: Positions, shape (F, nq).
        nominal: Likewise.
    """
    points, radii = moving_points(model, measured)
    apart = moving_points(model, nominal)[0] - points
    azimuth = max(AZIMUTHS, key=lambda one: _seen(apart, one))
    axes = camera_axes(azimuth)
    seen = points @ axes.T  # how far right, up and along the line of sight, (F, P, 3)
    middle = 0.5 * (np.min(seen, axis=(0, 1)) + np.max(seen, axis=(0, 1)))
    across = (np.abs(seen - middle)[..., :2] + radii[:, None]) / (RATIO * OPENING, OPENING)
    distance = float(np.max(across.max(axis=2) - (seen - middle)[..., 2]))
    x, y, z = (float(one) for one in middle @ axes)
    return View(
        lookat=(x, y, z),
        distance_m=MARGIN * distance,
        azimuth=azimuth,
        elevation=ELEVATION,
        enlarged=_enlarged(apart, OPENING * distance),
    )


def camera_axes(azimuth: float) -> Array:
    """Returns where right, up and the line of sight of the camera point, rows of (3, 3)."""
    turn, rise = np.radians(azimuth), np.radians(ELEVATION)
    right = np.array([np.sin(turn), -np.cos(turn), 0.0])
    sight = np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    return np.stack([right, np.cross(right, sight), sight])


def moving_points(model: mujoco.MjModel, qpos: Array) -> tuple[Array, Array]:
    """Returns centres of all shapes that can move, m, (F, P, 3), and their radii, m, (P,)."""
    data, shapes = mujoco.MjData(model), np.flatnonzero(model.body_weldid[model.geom_bodyid])
    rows = []
    for row in qpos:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        rows.append(data.geom_xpos[shapes])
    return np.array(rows), np.asarray(model.geom_rbound[shapes])


def _seen(apart: Array, azimuth: float) -> float:
    """Returns how much of differences lies across the line of sight, m^2."""
    return round(float(np.sum((apart @ camera_axes(azimuth)[:2].T) ** 2)), 9)


def _enlarged(apart: Array, radius: float) -> int:
    usual = float(np.percentile(np.linalg.norm(apart, axis=2).max(axis=1), 95))
    enough = [times for times in ENLARGED if times * usual >= SEEN * radius]
    return enough[0] if enough else ENLARGED[-1]
