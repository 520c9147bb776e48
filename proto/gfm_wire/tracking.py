"""What a tracker says of the object, to the bridge of a robot that does not see it itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from gfm.core.checks import Array, check_shapes


@dataclass(frozen=True, kw_only=True)
class ObjectPose:
    """Where the object is, and how well that is known.

    Attributes:
        position: In the robot's base frame, m, shape (3,).
        quaternion: w x y z, shape (4,).
        covariance: Of the error: x, y, z and the turns about them, m and rad, shape (6, 6).
    """

    position: Array
    quaternion: Array
    covariance: Array

    def __post_init__(self) -> None:
        check_shapes(vars(self), {"position": (3,), "quaternion": (4,), "covariance": (6, 6)})


@dataclass(frozen=True, kw_only=True)
class TrackedObject:
    """Where the object is by all cameras, or that nobody knows.

    Attributes:
        stamp_ns: UTC, when the object was there; without a pose: when that was found out.
        pose: Of all cameras together; None where there is none that may be used.
        views: What each camera says alone, by its name, those included that were not believed.
    """

    stamp_ns: int
    pose: ObjectPose | None = None
    views: Mapping[str, ObjectPose] = field(default_factory=dict)
