"""Values as the fields of ROS 2 messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from gfm.core import CommandKind
from gfm.core.checks import Array

#: Of the robot; poses of objects are given in it.
BASE_FRAME = "base"
_SECOND_NS = 1_000_000_000
Message = dict[str, object]


class Frame(NamedTuple):
    """Where one frame is in another.

    Attributes:
        parent: Name of the frame in which it is given.
        child: Its own name.
        position: m, shape (3,).
        quaternion: w x y z, shape (4,).
    """

    parent: str
    child: str
    position: Array
    quaternion: Array


def header(stamp_ns: int, frame_id: str = "") -> Message:
    """Returns a std_msgs/Header."""
    seconds, nanoseconds = divmod(stamp_ns, _SECOND_NS)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


def joint_state(
    stamp_ns: int, joint_names: Sequence[str], fields: Mapping[str, Array | None]
) -> Message:
    """Returns a sensor_msgs/JointState of the fields that there are, each of shape (J,)."""
    message: Message = {"header": header(stamp_ns), "name": list(joint_names)}
    for kind in CommandKind:
        values = fields.get(kind)
        message[kind] = [] if values is None else values.tolist()
    return message


def pose(position: Array, quaternion: Array) -> Message:
    """Returns a geometry_msgs/Pose: m, shape (3,); w x y z, shape (4,)."""
    return {"position": _vector(position), "orientation": _rotation(quaternion)}


def transforms(stamp_ns: int, frames: Sequence[Frame]) -> Message:
    """Returns a tf2_msgs/TFMessage."""
    return {
        "transforms": [
            {
                "header": header(stamp_ns, frame.parent),
                "child_frame_id": frame.child,
                "transform": {
                    "translation": _vector(frame.position),
                    "rotation": _rotation(frame.quaternion),
                },
            }
            for frame in frames
        ]
    }


def _vector(values: Array) -> Message:
    return dict(zip("xyz", values.tolist(), strict=True))


def _rotation(quaternion: Array) -> Message:
    return dict(zip("wxyz", quaternion.tolist(), strict=True))
