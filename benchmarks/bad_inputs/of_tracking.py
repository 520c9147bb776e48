"""Bad input of `gfm track`."""

from __future__ import annotations

import cv2
import numpy as np

from bad_inputs.making import Case, cases, folder, text

_CAMERA = """\
name = "front"
size_px = [640, 480]
focal_px = [600.0, 600.0]
centre_px = [319.5, 239.5]

[mounting]
position_m = [0.9, 0.1, 0.6]
quaternion = [1.0, 0.0, 0.0, 0.0]
spread_m = 0.001
spread_rad = 0.002
"""
_BOARD = 'kind = "charuco"\ncolumns = 6\nrows = 5\nsquare_m = 0.04\ntag_m = 0.03\n'
_TAG = "[[tags]]\nid = 3\nsize_m = 0.04\nplace = {position_m = [0.0, 0.0, 0.0]}\n"


def _images(name: str, *sizes: tuple[int, int]) -> str:
    """Makes a folder of grey images, each (width, height) px; returns its name."""
    folder(name)
    for number, (width, height) in enumerate(sizes):
        cv2.imwrite(f"{name}/{number}.png", np.full((height, width), 128, np.uint8))
    return name


def _run(*words: str, camera: str = _CAMERA, images: tuple[tuple[int, int], ...] = ()) -> list[str]:
    told = [text("camera.toml", camera), _images("images", *images)]
    return ["run", "--camera", *told, "--out", "new.mcap", *words]


def _calibrate(board: str = _BOARD, *sizes: tuple[int, int]) -> list[str]:
    told = ["--images", _images("images", *sizes), "--board", text("board.toml", board)]
    return ["calibrate", *told, "--name", "front", "--out", "camera.toml"]


CASES: tuple[Case, ...] = cases(
    "gfm track",
    ("a tool that does not exist", lambda: ["frobnicate"]),
    ("calibrate: a folder without images", _calibrate),
    ("calibrate: images of two sizes", lambda: _calibrate(_BOARD, (640, 480), (64, 48))),
    ("calibrate: images without the board", lambda: _calibrate(_BOARD, (640, 480))),
    ("calibrate: an unknown kind of board", lambda: _calibrate(_BOARD.replace("charuco", "chess"))),
    (
        "calibrate: tags as large as their squares",
        lambda: _calibrate(_BOARD.replace("0.03", "0.04")),
    ),
    (
        "run: a camera's file that is not there",
        lambda: ["run", "--camera", "absent.toml", folder("images")],
    ),
    ("run: a camera's file that is no TOML", lambda: _run(camera="hello")),
    (
        "run: a camera that nobody says where it stands",
        lambda: _run(camera=_CAMERA.partition("[mounting]")[0]),
    ),
    (
        "run: a focal length below 0",
        lambda: _run(camera=_CAMERA.replace("[600.0, 600.0]", "[600.0, -1.0]")),
    ),
    ("run: an object that does not exist", lambda: _run("--object", "cube")),
    ("run: tags that are not there", lambda: _run("--object", "absent.toml")),
    ("run: one tag twice", lambda: _run("--object", text("tags.toml", 2 * _TAG))),
    ("run: no images", _run),
    ("run: images of another size than the camera's", lambda: _run(images=((64, 48),))),
    ("run: looks that never come", lambda: _run("--rate-hz", "0")),
    ("run: a recording that exists", lambda: [*_run()[:-1], text("new.mcap", "")]),
    ("tags: one that the family lacks", lambda: ["tags", "587", "--out", "tags"]),
    ("draw: no looks", lambda: ["draw", "--looks", "0", "--out", "drawn"]),
)
