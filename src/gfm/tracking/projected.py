"""What detectors would find, without an image: corners projected, with noise and faults.

Shape letters: n tags, b boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.sim.cell import Box
from gfm.tracking.camera import Camera
from gfm.tracking.detect import Detection, rim_scale
from gfm.tracking.layout import TagLayout
from gfm.tracking.rigid import Pose

#: What the detector needs of a tag: its face turned towards the camera (the cosine), the distance
#: between its opposite sides in the image. How well that holds: docs/results/tracking.md.
LEAST_FACING, LEAST_WIDTH_PX = 0.3, 14.0
#: Corners lie on the faces of boxes; what is hidden must be so for more than rounding.
_OFF_FACE_M = 5e-4
#: How far corners of a bad tag may be off.
_BAD_PX = (5.0, 40.0)


@dataclass(frozen=True, kw_only=True)
class Faults:
    """What goes wrong.

    Attributes:
        noise_px: Standard deviation of each coordinate of a corner.
        bad_tags: Share of the tags that are wrong: another number, corners in another order, the
            whole tag or each of its corners somewhere else.
        lost: Share of a camera's images that never arrive.
    """

    noise_px: float = 0.0
    bad_tags: float = 0.0
    lost: float = 0.0

    def __post_init__(self) -> None:
        if not self.noise_px >= 0.0:
            raise ConfigError(f"noise_px is {self.noise_px}, expected at least 0")
        for name in ("bad_tags", "lost"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected 0 to 1")


def visible(
    camera: Camera, layout: TagLayout, boxes: Sequence[Box], pose: Pose
) -> NDArray[np.bool_]:
    """Returns which tags a detector finds, if nothing but the object hides them, shape (n,).

    Args:
        camera: Who looks.
        layout: The tags.
        boxes: What the object is made of.
        pose: The object in the base frame.
    """
    eye = pose.inverse.of(camera.pose.position)
    corners = np.stack([tag.corners for tag in layout.tags])
    normals = np.stack([tag.pose.rotation[:, 2] for tag in layout.tags])
    middles = corners.mean(axis=1)
    sights = eye - middles
    facing = np.sum(sights * normals, axis=1) / np.linalg.norm(sights, axis=1)
    rims = middles[:, None] + rim_scale() * (corners - middles[:, None])
    pixels = camera.project(pose.of(rims).reshape(-1, 3)).reshape(-1, 4, 2)
    inside = ((pixels >= 0.0) & (pixels <= np.array(camera.size_px) - 1.0)).all(axis=(1, 2))
    wide = _widths(pixels) / rim_scale() >= LEAST_WIDTH_PX
    lifted = corners + _OFF_FACE_M * normals[:, None]
    hidden = _hidden(lifted.reshape(-1, 3), eye, boxes).reshape(-1, 4).any(axis=1)
    return np.asarray((facing >= LEAST_FACING) & inside & wide & ~hidden)


def _widths(pixels: Array) -> Array:
    """Returns the smaller distance between opposite sides of quadrilaterals, px, shape (n,)."""
    sides = np.roll(pixels, -1, axis=1) - pixels
    diagonals = pixels[:, 2:] - pixels[:, :2]
    first, second = diagonals[:, 0], diagonals[:, 1]
    area = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    return np.asarray(area / np.linalg.norm(sides, axis=2).max(axis=1))


def _hidden(points: Array, eye: Array, boxes: Sequence[Box]) -> NDArray[np.bool_]:
    """Returns from which points (N, 3) a box is in the way to the eye (3,), object frame."""
    ways = eye - points
    ways = np.where(np.abs(ways) < 1e-12, 1e-12, ways)
    hidden = np.zeros(len(points), bool)
    for half, centre in boxes:
        ends = np.stack([(sign * np.array(half) + centre - points) / ways for sign in (-1.0, 1.0)])
        enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
        hidden |= (enter < leave) & (leave > 0.0) & (enter < 1.0)
    return hidden


def detection(
    camera: Camera,
    layout: TagLayout,
    boxes: Sequence[Box],
    pose: Pose,
    faults: Faults,
    rng: np.random.Generator,
) -> Detection | None:
    """Returns what is found in an image; None where it does not arrive.

    Arguments as in `visible`; `camera` is where it really stands.
    """
    if rng.random() < faults.lost:
        return None
    shown = np.flatnonzero(visible(camera, layout, boxes, pose))
    ids, corners = [], np.empty((len(shown), 4, 2))
    for row, i in enumerate(shown):
        tag = layout.tags[i]
        clean = camera.project(pose.of(tag.corners))
        number, corners[row] = tag.id, clean + faults.noise_px * rng.standard_normal((4, 2))
        if rng.random() < faults.bad_tags:
            number, corners[row] = _spoilt(number, corners[row], layout, rng)
        ids.append(number)
    return Detection(ids=tuple(ids), corners=corners)


def _spoilt(
    number: int, corners: Array, layout: TagLayout, rng: np.random.Generator
) -> tuple[int, Array]:
    """Returns a bad tag: one of four kinds."""
    kind = rng.integers(4)
    if kind == 0:
        return layout.tags[rng.integers(len(layout.tags))].id, corners
    if kind == 1:
        return number, np.roll(corners, rng.integers(1, 4), axis=0)
    directions = rng.standard_normal((1 if kind == 2 else 4, 2))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return number, corners + rng.uniform(*_BAD_PX, (len(directions), 1)) * directions
