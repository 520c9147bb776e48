"""ROS messages as rosbridge writes them in JSON, to and from values.

Shape letters: J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar
from xml.etree import ElementTree

import msgspec
import numpy as np

from gfm.core import Command, CommandKind, Observation, RefusedError
from gfm.core.checks import Array
from gfm.sim.sawyer_numbers import HAND_RPY, HAND_XYZ
from gfm_robot_bridge.intera.assembly import Assembly
from gfm_robot_bridge.intera.topics import POSITION_MODE, TORQUE_MODE, VELOCITY_MODE
from gfm_robot_bridge.limits import Limits
from gfm_wire import SetPayload

#: For each kind its mode, and the only field that such a command fills.
_MODES = {
    CommandKind.POSITION: (POSITION_MODE, "position"),
    CommandKind.VELOCITY: (VELOCITY_MODE, "velocity"),
    CommandKind.EFFORT: (TORQUE_MODE, "effort"),
}
_FIELDS = ("position", "velocity", "acceleration", "effort")
_GIGA = 1_000_000_000
#: Link to which the robot attaches what it is told of, and how that is called.
_HAND, _PAYLOAD = "right_hand", "gfm_payload"
#: Of a load of which mass and centre are known, kg m^2.
_SMALL_INERTIA = "1e-6"
_Value = TypeVar("_Value")


class _Time(msgspec.Struct):
    secs: int
    nsecs: int


class _Header(msgspec.Struct):
    stamp: _Time


class _JointState(msgspec.Struct):
    header: _Header
    name: list[str]
    position: list[float]
    velocity: list[float]
    effort: list[float]


class _JointLimits(msgspec.Struct):
    joint_names: list[str]
    position_lower: list[float]
    position_upper: list[float]
    velocity: list[float]
    accel: list[float]
    effort: list[float]


def joint_command(command: Command) -> dict[str, Any]:
    """Returns a command as intera_core_msgs/JointCommand.

    Only the field of its mode is filled: no position is sent that the arm is not to go to.
    """
    mode, field = _MODES[command.kind]
    return {
        "header": {
            "stamp": {"secs": command.stamp_ns // _GIGA, "nsecs": command.stamp_ns % _GIGA},
            "frame_id": "",
        },
        "mode": mode,
        "names": list(command.joint_names),
        **{name: command.values.tolist() if name == field else [] for name in _FIELDS},
    }


def urdf_configuration(payload: SetPayload, stamp_ns: int) -> dict[str, Any]:
    """Returns a payload as intera_core_msgs/URDFConfiguration: a fragment that hangs on the hand.

    Args:
        payload: In the frame of the last link.
        stamp_ns: Of the configuration: a message with another one is a new configuration, one with
            the same is the same again.
    """
    return {
        "time": {"secs": stamp_ns // _GIGA, "nsecs": stamp_ns % _GIGA},
        "link": _HAND,
        "joint": _PAYLOAD,
        "urdf": _fragment(payload.mass_kg, _in_hand(payload.com_m)),
    }


def _fragment(mass_kg: float, com_m: Array) -> str:
    """Returns URDF of a load, m in the frame of the hand, shape (3,)."""
    robot = ElementTree.Element("robot", name=_PAYLOAD)
    link = ElementTree.SubElement(robot, "link", name=_PAYLOAD)
    inertial = ElementTree.SubElement(link, "inertial")
    place = " ".join(f"{value:.6g}" for value in com_m)
    ElementTree.SubElement(inertial, "origin", xyz=place, rpy="0 0 0")
    ElementTree.SubElement(inertial, "mass", value=f"{mass_kg:.6g}")
    crossed = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    own = dict.fromkeys(("ixx", "iyy", "izz"), _SMALL_INERTIA)
    ElementTree.SubElement(inertial, "inertia", own | crossed)
    joint = ElementTree.SubElement(robot, "joint", name=_PAYLOAD, type="fixed")
    ElementTree.SubElement(joint, "parent", link=_HAND)
    ElementTree.SubElement(joint, "child", link=_PAYLOAD)
    ElementTree.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
    return ElementTree.tostring(robot, encoding="unicode")


def _in_hand(point_m: Array) -> Array:
    """Returns a point of the last link's frame in that of the hand, which is turned about z."""
    x, y, z = point_m - np.array(HAND_XYZ)
    cos, sin = np.cos(HAND_RPY[2]), np.sin(HAND_RPY[2])
    return np.array([cos * x + sin * y, cos * y - sin * x, z])


def joint_report(msg: object, joint_names: Sequence[str]) -> Observation | None:
    """Returns what a sensor_msgs/JointState says of some joints, in their order.

    Others come with it (the head), or alone (a gripper's): None where none of them is named.

    Raises:
        RefusedError: it is not as declared, some of the joints are missing, or a number is.
    """
    state = _converted(msg, _JointState, "joint_states")
    index = {name: i for i, name in enumerate(state.name)}
    if index.keys().isdisjoint(joint_names):
        return None
    order = _order(index, joint_names, "joint_states")
    return Observation(
        joint_names=tuple(joint_names),
        position=_picked(state.position, order, "joint_states.position"),
        velocity=_picked(state.velocity, order, "joint_states.velocity"),
        effort=_picked(state.effort, order, "joint_states.effort"),
        stamp_ns=state.header.stamp.secs * _GIGA + state.header.stamp.nsecs,
    )


def joint_limits(msg: object, joint_names: Sequence[str]) -> Limits:
    """Returns what an intera_core_msgs/JointLimits says of some joints, in their order.

    Raises:
        RefusedError: it is not as declared, some of the joints are missing, or a limit is none.
    """
    said = _converted(msg, _JointLimits, "joint_limits")
    index = {name: i for i, name in enumerate(said.joint_names)}
    order = _order(index, joint_names, "joint_limits")
    limits = Limits(
        lower=_picked(said.position_lower, order, "joint_limits.position_lower"),
        upper=_picked(said.position_upper, order, "joint_limits.position_upper"),
        velocity=_picked(said.velocity, order, "joint_limits.velocity"),
        acceleration=_picked(said.accel, order, "joint_limits.accel"),
        effort=_picked(said.effort, order, "joint_limits.effort"),
    )
    for name in ("velocity", "acceleration", "effort"):
        if not (values := getattr(limits, name) > 0.0).all():
            joint = joint_names[int(np.argmin(values))]
            raise RefusedError(f"joint_limits: {name} of {joint}, expected more than 0")
    return limits


def assembly(msg: object) -> Assembly:
    """Returns what an intera_core_msgs/RobotAssemblyState says.

    Raises:
        RefusedError: it is not as declared.
    """
    return _converted(msg, Assembly, "state")


def _converted(msg: object, kind: type[_Value], what: str) -> _Value:
    try:
        return msgspec.convert(msg, kind)
    except msgspec.ValidationError as exc:
        raise RefusedError(f"{what}: {exc}") from exc


def _order(index: Mapping[str, int], joint_names: Sequence[str], what: str) -> list[int]:
    if missing := [name for name in joint_names if name not in index]:
        raise RefusedError(f"{what} names {', '.join(index)}, expected also {', '.join(missing)}")
    return [index[name] for name in joint_names]


def _picked(values: Sequence[float], order: Sequence[int], what: str) -> Array:
    """Returns values in an order, shape (J,)."""
    if len(values) <= max(order):
        raise RefusedError(f"{what} has {len(values)} numbers, expected one for each name")
    return np.array([values[i] for i in order])
