"""A camera's intrinsics and its place, from images of a board.

The board's frame: origin at its upper left corner, x right, y down, z into it, as OpenCV has it.
Tags are numbered from there, row by row (Kalibr's AprilGrid begins below).

Shape letters: n corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from gfm.core import BadInputError
from gfm.core.checks import Array
from gfm.tracking.camera import camera_matrix
from gfm.tracking.detect import Image, TagDetector, family
from gfm.tracking.files import BoardFile, CameraFile, Mounting
from gfm.tracking.rigid import Pose, apart, turn_by

#: With fewer images intrinsics, and with fewer places their spread, say little.
LEAST_IMAGES, LEAST_PLACES = 5, 3
_LEAST_CORNERS = 8
#: No detector is better, however well a few images fit.
_LEAST_NOISE_PX = 0.05


@dataclass(frozen=True, kw_only=True)
class BoardView:
    """The board's corners in one image.

    Attributes:
        points: On the board, m, shape (n, 3).
        pixels: In the image, shape (n, 2).
    """

    points: Array
    pixels: Array


def make_board(told: BoardFile) -> cv2.aruco.Board:
    """Returns a board: tags in the white squares of a chessboard, or tags alone.

    `square_m` is the side of a square of the chessboard, or from one tag to the next.
    """
    size = (told.columns, told.rows)
    if told.kind == "charuco":
        return cv2.aruco.CharucoBoard(size, told.square_m, told.tag_m, family())
    return cv2.aruco.GridBoard(size, told.tag_m, told.square_m - told.tag_m, family())


def view_of(told: BoardFile, grey: Image) -> BoardView | None:
    """Returns the board in an image (H, W); None where too little of it is seen."""
    board = make_board(told)
    if isinstance(board, cv2.aruco.CharucoBoard):
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        found = ids is not None and len(ids) >= _LEAST_CORNERS
        points, pixels = board.matchImagePoints(corners, ids) if found else (None, None)
    else:
        seen = TagDetector().detect(grey)
        found = 4 * len(seen.ids) >= _LEAST_CORNERS
        tags = [corners[None].astype(np.float32) for corners in seen.corners]
        points, pixels = board.matchImagePoints(tags, np.array(seen.ids)) if found else (None, None)
    if points is None or pixels is None or len(points) < _LEAST_CORNERS:
        return None
    return BoardView(
        points=np.asarray(points, float).reshape(-1, 3),
        pixels=np.asarray(pixels, float).reshape(-1, 2),
    )


def intrinsics(name: str, size_px: tuple[int, int], views: Sequence[BoardView]) -> CameraFile:
    """Returns a camera without a place; its corners' noise is what the fit leaves.

    Raises:
        BadInputError: there are too few views.
    """
    if len(views) < LEAST_IMAGES:
        raise BadInputError(
            f"the board is seen in {len(views)} images, expected at least {LEAST_IMAGES}"
        )
    points = [view.points.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    error, matrix, distortion, _, _ = cv2.calibrateCamera(points, pixels, size_px, None, None)
    k1, k2, p1, p2, k3 = (float(value) for value in np.ravel(distortion)[:5])
    return CameraFile(
        name=name,
        size_px=size_px,
        focal_px=(float(matrix[0, 0]), float(matrix[1, 1])),
        centre_px=(float(matrix[0, 2]), float(matrix[1, 2])),
        distortion=(k1, k2, p1, p2, k3),
        corner_noise_px=max(float(error / np.sqrt(2.0)), _LEAST_NOISE_PX),
    )


def mounting(camera: CameraFile, views: Sequence[tuple[BoardView, Pose]]) -> Mounting:
    """Returns where a camera stands, from a board at known places in the base frame.

    One pose is fitted to all corners; its spread is the jackknife's, over the places, so that
    errors of the places themselves are in it.

    Raises:
        BadInputError: there are too few places.
    """
    if len(views) < LEAST_PLACES:
        raise BadInputError(
            f"the board is seen at {len(views)} places, expected at least {LEAST_PLACES}"
        )
    best = _stand(camera, views)
    count = len(views)
    left_out = [_stand(camera, [*views[:i], *views[i + 1 :]]) for i in range(count)]
    errors = np.array([apart(pose, best) for pose in left_out])
    variances = (count - 1) / count * np.sum((errors - errors.mean(axis=0)) ** 2, axis=0)
    spreads = np.sqrt([variances[:3].mean(), variances[3:].mean()])
    x, y, z = (float(value) for value in best.position)
    w, i, j, k = (float(value) for value in best.quaternion)
    return Mounting(
        position_m=(x, y, z),
        quaternion=(w, i, j, k),
        spread_m=float(max(spreads[0], 1e-6)),
        spread_rad=float(max(spreads[1], 1e-6)),
    )


def _stand(camera: CameraFile, views: Sequence[tuple[BoardView, Pose]]) -> Pose:
    """Returns the camera in the base frame that fits all corners best."""
    points = np.concatenate([place.of(view.points) for view, place in views])
    pixels = np.concatenate([view.pixels for view, _ in views])
    matrix = camera_matrix(np.array(camera.focal_px), np.array(camera.centre_px))
    distortion = np.array(camera.distortion)
    _, turn, shift = cv2.solvePnP(points, pixels, matrix, distortion, flags=cv2.SOLVEPNP_SQPNP)
    turn, shift = cv2.solvePnPRefineLM(points, pixels, matrix, distortion, turn, shift)
    return Pose(rotation=turn_by(turn.ravel()), position=shift.ravel()).inverse
