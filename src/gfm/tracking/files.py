"""Files of cameras, tags and boards: TOML, read strictly, one line where one is wrong."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from gfm.core import BadInputError, ConfigError
from gfm.tracking.camera import CORNER_NOISE_PX, Camera
from gfm.tracking.layout import TAGS, Tag, TagLayout
from gfm.tracking.rigid import Pose, pose_of

Positive = Annotated[float, Meta(gt=0.0)]
Side = Annotated[int, Meta(ge=1)]
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
#: A quaternion whose length is further from 1 was not meant as one.
_UNIT = 1e-3


class _Table(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What every table of these files refuses: keys that it does not know."""


class Place(_Table, frozen=True, kw_only=True):
    """A pose: m, and w x y z of unit length."""

    position_m: Vector
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.quaternion))
        if not abs(length - 1.0) < _UNIT or not np.isfinite(self.position_m).all():
            raise ValueError(
                f"position_m {list(self.position_m)} and quaternion {list(self.quaternion)} of "
                f"length {length:g}, expected finite numbers and length 1"
            )

    @property
    def pose(self) -> Pose:
        """The same as a pose."""
        return pose_of(np.array([*self.position_m, *self.quaternion]))


class Mounting(Place, frozen=True, kw_only=True):
    """Where a camera stands in the base frame (x right, y down, z forward), and how surely."""

    spread_m: Positive
    spread_rad: Positive


class CameraFile(_Table, frozen=True, kw_only=True):
    """A calibration: intrinsics, and where the camera stands once that is known."""

    name: Annotated[str, Meta(min_length=1, pattern=r"^[A-Za-z0-9_-]+$")]
    size_px: tuple[Side, Side]
    focal_px: tuple[Positive, Positive]
    centre_px: tuple[float, float]
    distortion: tuple[float, float, float, float, float] = (0.0,) * 5
    corner_noise_px: Positive = CORNER_NOISE_PX
    mounting: Mounting | None = None


class TagFile(_Table, frozen=True, kw_only=True):
    """One tag of a layout."""

    id: Annotated[int, Meta(ge=0, lt=TAGS)]
    size_m: Positive
    place: Place


class LayoutFile(_Table, frozen=True, kw_only=True):
    """The tags on an object."""

    tags: Annotated[tuple[TagFile, ...], Meta(min_length=1)]


class BoardFile(_Table, frozen=True, kw_only=True):
    """A calibration board, see `boards`."""

    kind: Literal["charuco", "tags"]
    columns: Annotated[int, Meta(ge=2)]
    rows: Annotated[int, Meta(ge=2)]
    square_m: Positive
    tag_m: Positive

    def __post_init__(self) -> None:
        if not self.tag_m < self.square_m:
            raise ValueError(f"tag_m {self.tag_m} is not less than square_m {self.square_m}")


class PlacesFile(_Table, frozen=True, kw_only=True):
    """Where the board was in the base frame, by the name of the image."""

    places: dict[str, Place]


Content = TypeVar("Content", bound=_Table)


def read(kind: type[Content], path: Path) -> Content:
    """Returns what a file says.

    Raises:
        BadInputError: it cannot be read.
        ConfigError: it is not TOML, lacks a key, has one too many, or a value that cannot be.
    """
    try:
        return msgspec.convert(tomllib.loads(path.read_text(encoding="utf-8")), kind)
    except OSError as exc:
        raise BadInputError(f"{path}: cannot be read: {exc.strerror}") from exc
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as exc:
        raise ConfigError(f"{path}: not TOML: {exc}") from exc
    except msgspec.ValidationError as exc:
        raise ConfigError(f"{path}: {exc}") from exc


def read_camera(path: Path) -> Camera:
    """Returns a camera that is calibrated wholly.

    Raises:
        BadInputError: as `read` does, or nothing is said about where it stands.
    """
    told = read(CameraFile, path)
    if told.mounting is None:
        raise ConfigError(f"{path}: no table mounting; expected one (gfm track calibrate --places)")
    return Camera(
        name=told.name,
        size_px=told.size_px,
        focal_px=np.array(told.focal_px),
        centre_px=np.array(told.centre_px),
        distortion=np.array(told.distortion),
        pose=told.mounting.pose,
        spread_m=told.mounting.spread_m,
        spread_rad=told.mounting.spread_rad,
        corner_noise_px=told.corner_noise_px,
    )


def read_layout(path: Path) -> TagLayout:
    """Returns the tags on an object.

    Raises:
        BadInputError: as `read` does, or two tags have one number.
    """
    tags = read(LayoutFile, path).tags
    try:
        return TagLayout(
            tags=tuple(Tag(id=one.id, size_m=one.size_m, pose=one.place.pose) for one in tags)
        )
    except ConfigError as exc:
        raise ConfigError(f"{path}: {exc}") from exc


def camera_text(told: CameraFile) -> str:
    """Returns a calibration as TOML."""
    lines = [
        f'name = "{told.name}"',
        f"size_px = {list(told.size_px)}",
        f"focal_px = {list(told.focal_px)}",
        f"centre_px = {list(told.centre_px)}",
        f"distortion = {list(told.distortion)}  # k1 k2 p1 p2 k3, as OpenCV has them",
        f"corner_noise_px = {told.corner_noise_px}",
    ]
    if (at := told.mounting) is not None:
        lines += [
            "",
            "[mounting]  # in the base frame: x right, y down, z forward",
            f"position_m = {list(at.position_m)}",
            f"quaternion = {list(at.quaternion)}  # w x y z",
            f"spread_m = {at.spread_m}  # standard deviation, each axis",
            f"spread_rad = {at.spread_rad}",
        ]
    return "\n".join(lines) + "\n"
