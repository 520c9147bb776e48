"""Images of a camera, one after the other: from a folder, a video, or the camera itself."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import final

import cv2
import numpy as np
from typing_extensions import override

from gfm.core import BadInputError
from gfm.tracking.detect import Image

_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff"}


class Frames(ABC):
    """One camera's images.

    Attributes:
        is_live: Whether their times are the clock's.
    """

    is_live = False

    @abstractmethod
    def newest(self) -> tuple[float, Image] | None:
        """Returns the time, s, and the grey image (H, W) to look at next; None after the last.

        Raises:
            BadInputError: an image cannot be read.
        """

    def close(self) -> None:  # noqa: B027  a folder need not be let go of
        """Lets go of the camera."""


def image_paths(folder: Path) -> list[Path]:
    """Returns the images in a folder by name.

    Raises:
        BadInputError: there is none.
    """
    paths = sorted(path for path in folder.glob("*") if path.suffix.lower() in _SUFFIXES)
    if not paths:
        raise BadInputError(f"{folder}: no image; expected a folder of png, jpg, bmp or tif files")
    return paths


def read_image(path: Path) -> Image:
    """Returns a grey image, shape (H, W).

    Raises:
        BadInputError: it is none.
    """
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise BadInputError(f"{path}: cannot be read as an image; expected png, jpg, bmp or tif")
    return np.asarray(image, np.uint8)


def write_image(path: Path, image: Image) -> None:
    """Writes an image in the format of its name.

    Raises:
        BadInputError: the disk does not take it.
    """
    if not cv2.imwrite(str(path), image):
        raise BadInputError(f"{path}: cannot be written; expected a folder that can")


@final
class FolderFrames(Frames):
    """Images of a folder in the order of their names, at an even rate from time 0."""

    def __init__(self, folder: Path, rate_hz: float) -> None:
        self._paths, self._rate_hz, self._next = image_paths(folder), rate_hz, 0

    @override
    def newest(self) -> tuple[float, Image] | None:
        if self._next >= len(self._paths):
            return None
        number, self._next = self._next, self._next + 1
        return number / self._rate_hz, read_image(self._paths[number])


@final
class VideoFrames(Frames):
    """Images of a video file, at the file's own times."""

    def __init__(self, path: Path) -> None:
        self._capture = _opened(str(path))

    @override
    def newest(self) -> tuple[float, Image] | None:
        there, image = self._capture.read()
        time_s = 1e-3 * self._capture.get(cv2.CAP_PROP_POS_MSEC)  # of the image just read
        return (time_s, _grey(image)) if there else None

    @override
    def close(self) -> None:
        self._capture.release()


@final
class LiveFrames(Frames):
    """The newest image of a USB or network camera, read by a thread of its own.

    A camera that hangs, or is gone, holds nobody up: its last image is given again, as old as it
    is.

    Args:
        source: A device's number, or an address or pipeline that OpenCV opens.
        now_s: The clock. An image is stamped when it has arrived; what the camera took before is
            not known.
        wait_s: For how long to wait for a new image; the first is waited for without end.
    """

    is_live = True

    def __init__(self, source: str, now_s: Callable[[], float], wait_s: float) -> None:
        self._capture = _opened(source)
        self._now_s, self._wait_s = now_s, wait_s
        self._changed = threading.Condition()
        self._newest: tuple[float, Image] | None = None
        self._told_s = -np.inf
        self._ended = False
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @override
    def newest(self) -> tuple[float, Image] | None:
        with self._changed:
            wait_s = self._wait_s if self._newest is not None else None
            self._changed.wait_for(self._is_there, wait_s)
            if self._newest is not None:
                self._told_s = self._newest[0]
            return self._newest

    @override
    def close(self) -> None:
        self._ended = True
        self._thread.join(timeout=1.0)
        if not self._thread.is_alive():
            self._capture.release()

    def _is_there(self) -> bool:
        return self._ended or (self._newest is not None and self._newest[0] > self._told_s)

    def _read(self) -> None:
        while not self._ended:
            there, image = self._capture.read()
            with self._changed:
                if there:
                    self._newest = (self._now_s(), _grey(image))
                self._ended = self._ended or not there
                self._changed.notify_all()


def frames_of(source: str, rate_hz: float, now_s: Callable[[], float]) -> Frames:
    """Returns the images that a word stands for: a folder, a video file, or a camera.

    Raises:
        BadInputError: it cannot be opened.
    """
    path = Path(source)
    if path.is_dir():
        return FolderFrames(path, rate_hz)
    if path.is_file():
        return VideoFrames(path)
    return LiveFrames(source, now_s, 1.0 / rate_hz)


def _opened(source: str) -> cv2.VideoCapture:
    is_number = source.isdecimal()
    capture = cv2.VideoCapture(int(source)) if is_number else cv2.VideoCapture(source)
    if not capture.isOpened():
        raise BadInputError(
            f"{source}: cannot be opened; expected a folder of images, a video, a device's number "
            "or a camera's address"
        )
    return capture


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
