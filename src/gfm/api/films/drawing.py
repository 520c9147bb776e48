"""Draws one robot three times in one picture.

`python -m gfm.api.films.drawing MODEL.mjb PICTURES.npz FILM.mp4`

Shape letters: F pictures.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np

from gfm.api.films.renderer import Picture, make_quick, write_mp4
from gfm.core.checks import Array

#: Of a film: pictures per second, size, and bytes at most (a page has 2 MB in all).
RATE_HZ, WIDTH, HEIGHT, MOST_BYTES = 15, 480, 360, 30_000
#: After which a film ends with the pictures that there are, s.
DRAWING_S = 8.0
#: Quality that is tried until a film is small enough, best first (x264's constant rate factor).
_QUALITIES = (24, 28, 32, 36, 40, 44, 48)
#: The colours of before and after in every report; seen through, the measured robot stays visible.
_MODELS_RGBA = (0.84, 0.37, 0.0, 0.5), (0.0, 0.45, 0.70, 0.5)
#: Models have colours of their own, also those.
_MEASURED_RGBA = (0.62, 0.64, 0.67, 1.0)


def _draw(mjb: Path, pictures: Path, film: Path) -> None:
    """Draws, and encodes as well as fits into `MOST_BYTES`."""
    with np.load(pictures) as file:
        qpos, camera = file["qpos"], file["camera"]
    drawn = list(_pictures(mujoco.MjModel.from_binary_path(str(mjb)), qpos, camera))
    for quality in _QUALITIES:
        write_mp4(str(film), drawn, (HEIGHT, WIDTH), RATE_HZ, crf=str(quality), preset="slow")
        if film.stat().st_size <= MOST_BYTES:
            return


def _pictures(model: mujoco.MjModel, qpos: Array, camera: Array) -> Iterator[Picture]:
    """Yields pictures of shape (HEIGHT, WIDTH, 3) until there is no time left.

    Args:
        model: Drawn three times.
        qpos: As measured, by the nominal model and by a corrected one, shape (F, 2 or 3, nq).
        camera: Point looked at (x, y, z), distance, azimuth, elevation.
    """
    end_s = time.monotonic() + DRAWING_S
    model.vis.quality.offsamples = 2
    data, seen = mujoco.MjData(model), mujoco.MjvCamera()
    seen.lookat[:], (seen.distance, seen.azimuth, seen.elevation) = camera[:3], camera[3:]
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        make_quick(renderer.scene)
        renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SKYBOX] = True
        for measured, *models in qpos:
            _pose(model, data, measured)
            renderer.update_scene(data, seen)
            _paint(renderer.scene, 0, _MEASURED_RGBA)
            for pose, rgba in zip(models, _MODELS_RGBA, strict=False):
                _pose(model, data, pose)
                _add(renderer.scene, model, data, rgba)
            yield renderer.render()
            if time.monotonic() > end_s:
                return


def _pose(model: mujoco.MjModel, data: mujoco.MjData, qpos: Array) -> None:
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def _add(
    scene: mujoco.MjvScene, model: mujoco.MjModel, data: mujoco.MjData, rgba: Sequence[float]
) -> None:
    """Adds what moves of the robot, in one colour."""
    first, options, pull = scene.ngeom, mujoco.MjvOption(), mujoco.MjvPerturb()
    mujoco.mjv_addGeoms(model, data, options, pull, mujoco.mjtCatBit.mjCAT_DYNAMIC, scene)
    _paint(scene, first, rgba)


def _paint(scene: mujoco.MjvScene, first: int, rgba: Sequence[float]) -> None:
    """Gives what moves one colour, from some shape of the scene on."""
    for geom in scene.geoms[first : scene.ngeom]:
        if geom.category == mujoco.mjtCatBit.mjCAT_DYNAMIC:
            geom.rgba[:], geom.matid, geom.transparent = rgba, -1, int(rgba[3] < 1.0)


if __name__ == "__main__":
    _draw(*map(Path, sys.argv[1:]))
