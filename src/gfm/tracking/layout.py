"""Which tags are on an object, and where.

A tag's frame: x to the right and y up as it is printed, z out of its face, origin in the middle.
Shape letters: n tags.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.sim.cell import TEE_BOXES, FreeObject
from gfm.tracking.rigid import Pose

#: AprilTag 36h11 has so many tags.
TAGS = 587
#: As OpenCV lists them: upper left, upper right, lower right, lower left.
CORNERS = np.array([[-0.5, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, -0.5, 0.0], [-0.5, -0.5, 0.0]])

#: Sides, m, of the black squares on the cell's objects: the white rim around them fits the faces.
_BRICK_TAG_M, _TEE_TAG_M = 0.04, 0.03


@dataclass(frozen=True, kw_only=True)
class Tag:
    """One tag of family 36h11.

    Attributes:
        id: Its number.
        size_m: Side of its black square.
        pose: Where it is on the object.
    """

    id: int
    size_m: float
    pose: Pose

    @property
    def corners(self) -> Array:
        """Its corners in the object's frame, m, shape (4, 3)."""
        return self.pose.of(self.size_m * CORNERS)


@dataclass(frozen=True, kw_only=True)
class TagLayout:
    """The tags on an object.

    Raises:
        ConfigError: there is none, or two have one number.
    """

    tags: tuple[Tag, ...]

    def __post_init__(self) -> None:
        ids = [tag.id for tag in self.tags]
        if not ids:
            raise ConfigError("the layout has no tag, expected at least 1")
        twice = sorted({number for number in ids if ids.count(number) > 1})
        if twice:
            raise ConfigError(f"tag {twice[0]} is there twice, expected every number once")

    @cached_property
    def corners(self) -> Mapping[int, Array]:
        """Corners in the object's frame by number, m, shape (4, 3) each."""
        return {tag.id: tag.corners for tag in self.tags}


def cell_layout(kind: FreeObject) -> TagLayout:
    """Returns the tags on an object of the cell; on all of its large faces."""
    places = _brick_places() if kind == "brick" else _tee_places()
    size_m = _BRICK_TAG_M if kind == "brick" else _TEE_TAG_M
    poses = (_facing(np.array(at), np.array(normal)) for at, normal in places)
    return TagLayout(
        tags=tuple(Tag(id=i, size_m=size_m, pose=pose) for i, pose in enumerate(poses))
    )


#: A place and the outward normal there, object frame, m.
_Place = tuple[tuple[float, float, float], tuple[float, float, float]]


def _brick_places() -> Sequence[_Place]:
    """Two on each long face, one on each end."""
    ends: list[_Place] = [((side * 0.05, 0.0, 0.0), (side, 0.0, 0.0)) for side in (1.0, -1.0)]
    flat: list[_Place] = [
        ((x, 0.0, side * 0.03), (0.0, 0.0, side)) for side in (1.0, -1.0) for x in (-0.025, 0.025)
    ]
    long: list[_Place] = [
        ((x, side * 0.03, 0.0), (0.0, side, 0.0)) for side in (1.0, -1.0) for x in (-0.025, 0.025)
    ]
    return [*flat, *long, *ends]


def _tee_places() -> Sequence[_Place]:
    """Four on the top and below, two on the bar's back, one on every end, two along the stem."""
    (bar_half, bar), (stem_half, stem) = TEE_BOXES
    spots = ((-0.03, bar[1]), (0.03, bar[1]), (0.0, -0.02), (0.0, -0.06))
    flat: list[_Place] = [
        ((x, y, side * bar_half[2]), (0.0, 0.0, side)) for side in (1.0, -1.0) for x, y in spots
    ]
    back: list[_Place] = [((x, 0.04, 0.0), (0.0, 1.0, 0.0)) for x in (-0.025, 0.025)]
    foot: list[_Place] = [((0.0, stem[1] - stem_half[1], 0.0), (0.0, -1.0, 0.0))]
    across: list[_Place] = []
    for side in (1.0, -1.0):
        across.append(((side * bar_half[0], bar[1], 0.0), (side, 0.0, 0.0)))
        across += [((side * stem_half[0], y, 0.0), (side, 0.0, 0.0)) for y in (-0.02, -0.06)]
    return [*flat, *back, *foot, *across]


def _facing(position: Array, normal: Array) -> Pose:
    """Returns the pose of a tag whose z axis is `normal` and whose y axis is up, or along y."""
    upward = (0.0, 1.0, 0.0) if abs(normal[2]) > 0.5 else (0.0, 0.0, 1.0)
    right = np.cross(upward, normal)
    rotation = np.stack([right, np.cross(normal, right), normal], axis=1)
    return Pose(rotation=rotation, position=position)
