"""A folder of images of the simulated cell, to try tracking without a camera."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from gfm.core import BadInputError
from gfm.sim.cell import FreeObject, object_rest_position
from gfm.tracking.camera import Camera
from gfm.tracking.cell_cameras import cell_cameras
from gfm.tracking.files import CameraFile, Mounting, camera_text
from gfm.tracking.frames import write_image
from gfm.tracking.layout import cell_layout
from gfm.tracking.rendering import CellRenderer, with_pixel_noise
from gfm.tracking.rigid import Pose, turn_by

_RADIUS_M, _TURN_S = 0.04, 4.0
_PIXEL_NOISE = 2.0  # grey levels


def circling(kind: FreeObject, time_s: float) -> Pose:
    """Returns an object that slides round the basket's middle in 4 s, and turns as it goes."""
    angle = 2.0 * np.pi * time_s / _TURN_S
    round_ = _RADIUS_M * np.array([np.cos(angle), np.sin(angle), 0.0])
    place = np.array(object_rest_position(kind)) + round_
    return Pose(rotation=turn_by(np.array([0.0, 0.0, angle])), position=place)


def write_cell(folder: Path, kind: FreeObject, looks: int, rate_hz: float, seed: int) -> None:
    """Writes images of three cameras, their calibrations, and where the object really was.

    Raises:
        BadInputError: the folder exists.
        NoRendererError: nothing can be drawn here.
    """
    if folder.exists():
        raise BadInputError(f"{folder}: exists; expected a new folder")
    cameras, rng = cell_cameras(), np.random.default_rng(seed)
    with CellRenderer(kind, cell_layout(kind), cameras) as renderer:
        for camera in cameras:
            (folder / camera.name).mkdir(parents=True)
            text = camera_text(_file(camera))
            (folder / f"{camera.name}.toml").write_text(text, encoding="utf-8")
        with (folder / "truth.jsonl").open("w", encoding="utf-8") as truth:
            for number in range(looks):
                pose = circling(kind, number / rate_hz)
                for camera in cameras:
                    image = with_pixel_noise(renderer.draw(camera.name, pose), _PIXEL_NOISE, rng)
                    write_image(folder / camera.name / f"{number:06d}.png", image)
                told = {
                    "time_s": number / rate_hz,
                    "position": pose.position.tolist(),
                    "quaternion": pose.quaternion.tolist(),
                }
                truth.write(json.dumps(told) + "\n")


def _file(camera: Camera) -> CameraFile:
    x, y, z = camera.pose.position.tolist()
    w, i, j, k = camera.pose.quaternion.tolist()
    place = Mounting(
        position_m=(x, y, z),
        quaternion=(w, i, j, k),
        spread_m=camera.spread_m,
        spread_rad=camera.spread_rad,
    )
    return CameraFile(
        name=camera.name,
        size_px=camera.size_px,
        focal_px=(float(camera.focal_px[0]), float(camera.focal_px[1])),
        centre_px=(float(camera.centre_px[0]), float(camera.centre_px[1])),
        corner_noise_px=camera.corner_noise_px,
        mounting=place,
    )
