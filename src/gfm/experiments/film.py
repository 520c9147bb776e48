"""Films of attempts: `python -m gfm.experiments.film ATTEMPT.npz MODEL.mjb FILM.mp4` draws one."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gfm.api.films.renderer import Picture, draw, make_quick, write_mp4
from gfm.core.checks import Array

_LONGEST_S = 300.0
_WIDTH, _HEIGHT, _RATE = 480, 360, 20
_LOOK_AT, _DISTANCE_M, _AZIMUTH, _ELEVATION = (0.6, 0.0, 0.1), 1.0, 150.0, -35.0
_GOAL_RGBA = (0.1, 0.7, 0.3, 0.5)


def write_film(path: Path, model: object, qpos: Array, goal: Array, radius_m: float) -> None:
    """Writes an mp4 of positions at 20 Hz.

    Args:
        path: Where to.
        model: The mujoco.MjModel.
        qpos: shape (S, nq).
        goal: x, y, yaw in the base frame, shape (3,).
        radius_m: Of the disc that marks it.

    Raises:
        NoFilmError: there is no renderer or no encoder here; the text says which.
    """
    import mujoco

    with tempfile.TemporaryDirectory() as folder:
        attempt, mjb = Path(folder) / "attempt.npz", Path(folder) / "model.mjb"
        np.savez(attempt, qpos=qpos, goal=goal, radius_m=radius_m)
        mujoco.mj_saveModel(model, str(mjb), None)
        path.parent.mkdir(parents=True, exist_ok=True)
        draw("gfm.experiments.film", [attempt, mjb, path], _LONGEST_S)


def _render(attempt: Path, mjb: Path, film: Path) -> None:
    with np.load(attempt) as file:
        qpos, goal, radius_m = file["qpos"], file["goal"], float(file["radius_m"])
    write_mp4(str(film), _pictures(mjb, qpos, goal, radius_m), (_HEIGHT, _WIDTH), _RATE)


def _pictures(mjb: Path, qpos: Array, goal: Array, radius_m: float) -> Iterator[Picture]:
    import mujoco

    model = mujoco.MjModel.from_binary_path(str(mjb))
    model.vis.quality.offsamples = 0
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = _LOOK_AT, _DISTANCE_M
    camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
    with mujoco.Renderer(model, _HEIGHT, _WIDTH) as renderer:
        make_quick(renderer.scene)
        for row in qpos:
            data.qpos[:] = row
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            _mark(renderer.scene, goal, radius_m)
            yield renderer.render()


def _mark(scene: object, goal: Array, radius_m: float) -> None:
    """Adds a disc on the floor where the object should go, and a bar that shows its yaw."""
    import mujoco

    from gfm.sim import sawyer_numbers as numbers

    yaw = float(goal[2])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    place = np.array([goal[0], goal[1], numbers.BASKET_XYZ[2] + 0.001])
    shapes = (
        (mujoco.mjtGeom.mjGEOM_CYLINDER, [radius_m, 0.001, 0.0]),
        (mujoco.mjtGeom.mjGEOM_BOX, [radius_m, 0.002, 0.002]),
    )
    for shape, size in shapes:
        geom = scene.geoms[scene.ngeom]  # type: ignore[attr-defined]
        mujoco.mjv_initGeom(geom, shape, size, place, turn.ravel(), np.array(_GOAL_RGBA))
        scene.ngeom += 1  # type: ignore[attr-defined]


if __name__ == "__main__":
    _render(*map(Path, sys.argv[1:]))
