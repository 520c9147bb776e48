"""What the robot's computer reads and writes: apart from the bridge's own reading of the same.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import Any, TypeVar
from xml.etree import ElementTree

import msgspec
import numpy as np

from gfm.core import Command, CommandKind, Observation, RefusedError
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.limits import Limits
from gfm_wire import SetPayload

_Message = TypeVar("_Message")
_KINDS = {1: CommandKind.POSITION, 2: CommandKind.VELOCITY, 3: CommandKind.EFFORT}
#: Joints beside the arm's, before and after them.
_HEAD, _TORSO = "head_pan", "torso_t0"
_HAND, _HAND_FORWARD_M = "right_hand", 0.0245


class _JointCommand(msgspec.Struct):
    mode: int
    names: list[str]
    position: list[float] = []
    velocity: list[float] = []
    effort: list[float] = []


class _Switch(msgspec.Struct):
    data: bool


class _Number(msgspec.Struct):
    data: float


class _Time(msgspec.Struct):
    secs: int
    nsecs: int


class _Configuration(msgspec.Struct):
    time: _Time
    link: str
    joint: str
    urdf: str


def read_command(msg: object, stamp_ns: int) -> Command:
    """Returns the setpoints of an intera_core_msgs/JointCommand.

    As in the robot, the mode says which field counts; the others may be there, and old.

    Args:
        msg: The message.
        stamp_ns: When it arrived, on the robot's clock; it acts by that.

    Raises:
        RefusedError: it is no command for the arm.
    """
    said = _read(msg, _JointCommand)
    if (kind := _KINDS.get(said.mode)) is None:
        raise RefusedError(f"mode {said.mode}, expected 1, 2 or 3")
    if sorted(said.names) != sorted(JOINT_NAMES):
        raise RefusedError(f"names {', '.join(said.names)}, expected {', '.join(JOINT_NAMES)}")
    numbers = getattr(said, kind)
    if len(numbers) != len(JOINT_NAMES):
        raise RefusedError(f"{kind} has {len(numbers)} numbers, expected {len(JOINT_NAMES)}")
    return Command(
        kind=kind, joint_names=tuple(said.names), values=np.array(numbers), stamp_ns=stamp_ns
    )


def read_switch(msg: object) -> bool:
    """Returns the value of a std_msgs/Bool, or of a request to a std_srvs/SetBool.

    Raises:
        RefusedError: it has none.
    """
    return _read(msg, _Switch).data


def read_number(msg: object) -> float:
    """Returns the value of a std_msgs/Float64.

    Raises:
        RefusedError: it has none.
    """
    return _read(msg, _Number).data


def read_payload(msg: object) -> tuple[int, SetPayload]:
    """Returns the time of an intera_core_msgs/URDFConfiguration, ns, and the load that it hangs on.

    The hand stands 24.5 mm in front of the last link, turned by a quarter about its axis.

    Raises:
        RefusedError: it hangs on another link, or is no load.
    """
    said = _read(msg, _Configuration)
    if said.link != _HAND:
        raise RefusedError(f"urdf hangs on {said.link!r:.40}, expected {_HAND!r}")
    try:
        inertial = f"link[@name='{said.joint}']/inertial"
        found = ElementTree.fromstring(said.urdf).find(inertial)
        if found is None:
            raise RefusedError(f"urdf has no {inertial}")
        mass = float(_attribute(found, "mass", "value"))
        x, y, z = (float(word) for word in _attribute(found, "origin", "xyz").split())
    except (ElementTree.ParseError, ValueError) as error:
        raise RefusedError(f"urdf: {error}") from error
    com = np.array([-y, x, z + _HAND_FORWARD_M])
    if not np.isfinite([mass, *com]).all() or mass < 0.0:
        raise RefusedError(f"urdf has a mass of {mass} at {x}, {y}, {z}, expected finite numbers")
    stamp_ns = said.time.secs * 10**9 + said.time.nsecs
    return stamp_ns, SetPayload(mass_kg=mass, com_m=com)


def _attribute(element: ElementTree.Element, child: str, name: str) -> str:
    found = element.find(child)
    if found is None or name not in found.attrib:
        raise RefusedError(f"urdf has no {child} with {name}")
    return found.attrib[name]


def joint_states(report: Observation, stamp_ns: int) -> dict[str, Any]:
    """Returns a report as sensor_msgs/JointState: the arm between the head and the torso."""
    return {
        "header": {
            "seq": 0,
            "stamp": {"secs": stamp_ns // 10**9, "nsecs": stamp_ns % 10**9},
            "frame_id": "",
        },
        "name": [_HEAD, *JOINT_NAMES, _TORSO],
        "position": [0.0, *report.position.tolist(), 0.0],
        "velocity": [0.0, *report.velocity.tolist(), 0.0],
        "effort": [0.0, *report.effort.tolist(), 0.0],
    }


def limits_message(limits: Limits) -> dict[str, Any]:
    """Returns intera_core_msgs/JointLimits."""
    return {
        "joint_names": [*JOINT_NAMES],
        "position_lower": limits.lower.tolist(),
        "position_upper": limits.upper.tolist(),
        "velocity": limits.velocity.tolist(),
        "accel": limits.acceleration.tolist(),
        "effort": limits.effort.tolist(),
    }


def _read(msg: object, kind: type[_Message]) -> _Message:
    try:
        return msgspec.convert(msg, kind)
    except msgspec.ValidationError as exc:
        raise RefusedError(str(exc)) from exc
