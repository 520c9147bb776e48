"""Tags in an image. Shape letters: n tags seen, H x W pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array, check_shapes

Image = NDArray[np.uint8]
#: Modules of a tag of this family: six of data and a black border of one.
_MODULES = 8


@dataclass(frozen=True, kw_only=True)
class Detection:
    """The tags that one image shows.

    Attributes:
        ids: Their numbers.
        corners: px, in the order of `layout.CORNERS`, shape (n, 4, 2).
    """

    ids: tuple[int, ...]
    corners: Array

    def __post_init__(self) -> None:
        check_shapes({"corners": self.corners}, {"corners": (len(self.ids), 4, 2)})


def family() -> cv2.aruco.Dictionary:
    """Returns the tags: AprilTag 36h11."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)


@final
class TagDetector:
    """Finds tags, their corners to a part of a pixel."""

    def __init__(self) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        # Larger windows reach into a small tag's own pattern, whose edges pull at the corner.
        parameters.relativeCornerRefinmentWinSize = 0.5
        self._detector = cv2.aruco.ArucoDetector(family(), parameters)

    def detect(self, grey: Image) -> Detection:
        """Returns the tags in an image, shape (H, W)."""
        corners, ids, _ = self._detector.detectMarkers(grey)
        if ids is None:
            return Detection(ids=(), corners=np.empty((0, 4, 2)))
        numbers = tuple(int(i) for i in ids.ravel())
        return Detection(ids=numbers, corners=np.asarray(corners, float).reshape(-1, 4, 2))


def tag_image(number: int, module_px: int) -> Image:
    """Returns a tag with a white rim of one module, shape (10 module_px, 10 module_px)."""
    black = cv2.aruco.generateImageMarker(family(), number, _MODULES * module_px)
    return np.pad(np.asarray(black, np.uint8), module_px, constant_values=255)


def rim_scale() -> float:
    """Returns the side of a tag with its white rim, in sides of its black square."""
    return (_MODULES + 2) / _MODULES
