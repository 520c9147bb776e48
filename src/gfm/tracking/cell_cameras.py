"""The three cameras of the simulated cell: across the basket from the robot, and on either side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gfm.core.checks import Array
from gfm.sim import sawyer_numbers as numbers
from gfm.tracking.camera import CORNER_NOISE_PX, Camera
from gfm.tracking.rigid import looking, moved

SIZE_PX = (1280, 720)
_FOCAL_PX = 900.0  # 71 degrees wide: the whole floor of the basket
_PLACES = {"front": (1.1, 0.0, 0.5), "left": (0.6, 0.5, 0.5), "right": (0.6, -0.5, 0.5)}
_ABOVE_FLOOR_M = 0.03
#: How far off a camera's calibration is, as a whole: its place, and its rotation.
PLACE_OFF_M, TURN_OFF_RAD = 1e-3, np.radians(0.2)


def cell_cameras() -> tuple[Camera, ...]:
    """Returns the cameras, without distortion, as far off as they are built to be."""
    width, height = SIZE_PX
    target = np.array(numbers.BASKET_XYZ) + np.array([0.0, 0.0, _ABOVE_FLOOR_M])
    return tuple(
        Camera(
            name=name,
            size_px=SIZE_PX,
            focal_px=np.full(2, _FOCAL_PX),
            centre_px=np.array([width - 1.0, height - 1.0]) / 2.0,
            distortion=np.zeros(5),
            pose=looking(np.array(place), target),
            # Each axis has its part of an error in any direction.
            spread_m=PLACE_OFF_M / np.sqrt(3.0),
            spread_rad=float(TURN_OFF_RAD / np.sqrt(3.0)),
            corner_noise_px=CORNER_NOISE_PX,
        )
        for name, place in _PLACES.items()
    )


def displaced(camera: Camera, rng: np.random.Generator) -> Camera:
    """Returns where a camera really is whose calibration is off as far as its spread says.

    Exactly as far, in a direction of chance: the error has the same size every time.
    """
    directions = rng.standard_normal((2, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    sizes = np.sqrt(3.0) * np.array([camera.spread_m, camera.spread_rad])
    error: Array = (directions * sizes[:, None]).ravel()
    return replace(camera, pose=moved(camera.pose, error))
