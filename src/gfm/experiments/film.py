"""Films of simulations, rendered by a process of its own: no renderer, no film, no harm.

`python -m gfm.experiments.film ATTEMPT.npz MODEL.mjb FILM.mp4` renders one. The process that asks
for it may run where there is no display and no graphics library; which backend works is found out
by trying, and that must be decided before MuJoCo is imported.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from gfm.core import GfmError
from gfm.core.checks import Array

_BACKENDS = ("egl", "osmesa")
_LONGEST_S = 300.0
_WIDTH, _HEIGHT, _RATE = 480, 360, 20
_LOOK_AT, _DISTANCE_M, _AZIMUTH, _ELEVATION = (0.6, 0.0, 0.1), 1.0, 150.0, -35.0
#: On a processor without a graphics card they take ten times as long as all the rest.
_LEFT_OUT = ("mjRND_SHADOW", "mjRND_REFLECTION", "mjRND_HAZE", "mjRND_SKYBOX")
_GOAL_RGBA = (0.1, 0.7, 0.3, 0.5)


class NoFilmError(GfmError):
    """No film could be made here."""


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
        problems = []
        for backend in _backends():
            problem = _rendered(backend, [str(attempt), str(mjb), str(path)])
            if not problem:
                return
            problems.append(f"{backend}: {problem}")
    raise NoFilmError(f"no film here: {'; '.join(problems)}")


def _backends() -> tuple[str, ...]:
    chosen = os.environ.get("MUJOCO_GL")
    return (chosen,) if chosen else _BACKENDS


def _rendered(backend: str, words: list[str]) -> str:
    """Renders in a child process; returns what went wrong in one line, nothing if all went well."""
    command = [sys.executable, "-m", "gfm.experiments.film", *words]
    environment = {**os.environ, "MUJOCO_GL": backend}
    try:
        done = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            text=True,
            timeout=_LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"not rendered within {_LONGEST_S:.0f} s"
    if done.returncode == 0:
        return ""
    last = done.stderr.strip().splitlines()
    return last[-1] if last else f"ended with status {done.returncode}"


def _render(attempt: Path, mjb: Path, film: Path) -> None:
    import av
    import mujoco

    with np.load(attempt) as file:
        qpos, goal, radius_m = file["qpos"], file["goal"], float(file["radius_m"])
    model = mujoco.MjModel.from_binary_path(str(mjb))
    model.vis.quality.offsamples = 0
    data = mujoco.MjData(model)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = _LOOK_AT, _DISTANCE_M
    camera.azimuth, camera.elevation = _AZIMUTH, _ELEVATION
    with mujoco.Renderer(model, _HEIGHT, _WIDTH) as renderer, av.open(str(film), "w") as container:
        for flag in _LEFT_OUT:
            renderer.scene.flags[getattr(mujoco.mjtRndFlag, flag)] = False
        stream = container.add_stream("libx264", rate=_RATE)
        stream.width, stream.height, stream.pix_fmt = _WIDTH, _HEIGHT, "yuv420p"
        for row in qpos:
            data.qpos[:] = row
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera)
            _mark(renderer.scene, goal, radius_m)
            frame = av.VideoFrame.from_ndarray(renderer.render(), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


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
