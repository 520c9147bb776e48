"""Drawing by a process of its own: no renderer, no film, no harm.

The process that asks for a film may run where there is no display and no graphics library; which
backend works is found out by trying, and that must be decided before MuJoCo is imported.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Sequence
from importlib.util import find_spec
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from gfm.core import GfmError

#: Of shape (height, width, 3).
Picture: TypeAlias = NDArray[np.uint8]

_BACKENDS = ("egl", "osmesa")
#: On a processor without a graphics card they take ten times as long as all the rest.
_LEFT_OUT = ("mjRND_SHADOW", "mjRND_REFLECTION", "mjRND_HAZE", "mjRND_SKYBOX")


class NoFilmError(GfmError):
    """No film could be made here."""


def draw(module: str, words: Sequence[object], longest_s: float) -> None:
    """Runs `python -m module words` with the first graphics backend with which it succeeds.

    Args:
        module: Draws into a file that is one of the words.
        words: Its arguments.
        longest_s: After which an attempt is given up.

    Raises:
        NoFilmError: there is no renderer or no encoder here; the text says which.
    """
    if find_spec("av") is None:
        raise NoFilmError("no film: it needs the extra video (pip install 'gfm-sim2real[video]')")
    problems = []
    for backend in _backends():
        problem = _attempt(backend, [module, *map(str, words)], longest_s)
        if not problem:
            return
        problems.append(f"{backend}: {problem}")
    raise NoFilmError(f"no film: nothing renders here ({'; '.join(problems)})")


def _backends() -> tuple[str, ...]:
    chosen = os.environ.get("MUJOCO_GL")
    return (chosen,) if chosen else _BACKENDS


def _attempt(backend: str, words: list[str], longest_s: float) -> str:
    """Draws in a child process; returns what went wrong in one line, nothing if all went well."""
    try:
        done = subprocess.run(
            [sys.executable, "-m", *words],
            env={**os.environ, "MUJOCO_GL": backend},
            capture_output=True,
            text=True,
            timeout=longest_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"not drawn within {longest_s:.0f} s"
    if done.returncode == 0:
        return ""
    last = done.stderr.strip().splitlines()
    return last[-1] if last else f"ended with status {done.returncode}"


def make_quick(scene: object) -> None:
    """Leaves out of a MuJoCo scene what takes long to draw without a graphics card."""
    import mujoco

    for flag in _LEFT_OUT:
        scene.flags[getattr(mujoco.mjtRndFlag, flag)] = False  # type: ignore[attr-defined]


def write_mp4(
    path: str, pictures: Iterable[Picture], size: tuple[int, int], rate_hz: int, **options: str
) -> None:
    """Writes a film that browsers play.

    Args:
        path: Where to.
        pictures: RGB.
        size: Height and width, both even.
        rate_hz: Pictures per second.
        options: Of the encoder libx264.
    """
    import av

    with av.open(path, "w", options={"movflags": "+faststart"}) as container:
        stream = container.add_stream("libx264", rate=rate_hz, options=options)
        (stream.height, stream.width), stream.pix_fmt = size, "yuv420p"
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
