"""ROS messages that carry joints, as rows of a table: one number for each column.

Columns are named FIELD.JOINT, or FIELD.PLACE where a message does not name its joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

Row = dict[str, float]
#: As rosbags decodes one: an object with the fields of its type.
Message = Any


def _named(field: str, names: Sequence[object], values: Iterable[float]) -> Row:
    """Returns the values of one field; none where it is empty, as ROS allows."""
    numbers = [float(value) for value in values]
    if len(numbers) not in (0, len(names)):
        raise ValueError(f"has {len(numbers)} values of {field} for {len(names)} joints")
    return {f"{field}.{name}": x for name, x in zip(names, numbers, strict=False)}


def _point(prefix: str, names: Sequence[str], point: Message) -> Row:
    """Returns a trajectory_msgs/JointTrajectoryPoint."""
    row: Row = {}
    for field in ("positions", "velocities", "accelerations", "effort"):
        row |= _named(f"{prefix}{field}", names, getattr(point, field))
    return row


def _joint_state(message: Message) -> Row:
    row: Row = {}
    for field in ("position", "velocity", "effort"):
        row |= _named(field, message.name, getattr(message, field))
    return row


def _multi_array(message: Message) -> Row:
    return _named("data", range(len(message.data)), message.data)


def _trajectory(message: Message) -> Row:
    if len(message.points) != 1:
        raise ValueError(
            f"has {len(message.points)} points, which a controller interpolates in a way of its "
            "own; expected one (its state topic tells the set points)"
        )
    return _point("", message.joint_names, message.points[0])


def _controller_state(message: Message) -> Row:
    """Returns all points of a state: reference, feedback and output, or desired and actual.

    A message that has both says the same in desired and actual as in the first two.
    """
    row: Row = {}
    new = hasattr(message, "reference")
    for field in ("reference", "feedback", "output") if new else ("desired", "actual"):
        if hasattr(message, field):
            row |= _point(f"{field}.", message.joint_names, getattr(message, field))
    return row


JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"

#: How each type that is understood becomes a row. ValueError says what is wrong with a message.
ROW_OF: dict[str, Callable[[Message], Row]] = {
    JOINT_STATE: _joint_state,
    MULTI_ARRAY: _multi_array,
    TRAJECTORY: _trajectory,
    CONTROLLER_STATE: _controller_state,
}
