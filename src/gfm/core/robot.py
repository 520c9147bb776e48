"""What crosses between a policy and a robot: one command, one observation.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from gfm.core.checks import Array, check_shapes


class CommandKind(StrEnum):
    """What a joint command means; its value is the one non-empty field of a JointState command."""

    POSITION = "position"
    VELOCITY = "velocity"
    EFFORT = "effort"


@dataclass(frozen=True, kw_only=True)
class Command:
    """One joint command; it holds until the next.

    Attributes:
        kind: What `values` are: rad, rad/s or N m.
        joint_names: The commanded joints, in the order of `values`.
        values: Setpoints, shape (J,).
        stamp_ns: When it was issued, on the issuer's clock.
        number: Counts the issuer's commands from 0, so that gaps show.
        needs_object: Whether it was made for where the object is: where that is not known, or not
            any more, the robot is stopped instead.
    """

    kind: CommandKind
    joint_names: tuple[str, ...]
    values: Array
    stamp_ns: int
    number: int = 0
    needs_object: bool = False

    def __post_init__(self) -> None:
        check_shapes({"values": self.values}, {"values": (len(self.joint_names),)})


@dataclass(frozen=True, kw_only=True)
class Observation:
    """What the robot reports at one tick, with the command in force at that tick.

    Attributes:
        joint_names: The joints, in the order of the arrays.
        position: rad, link side, shape (J,).
        velocity: rad/s, shape (J,).
        effort: Drive torque, N m, shape (J,).
        stamp_ns: Measurement time on the robot's clock.
        received_ns: When the bridge got it, on the bridge's monotonic clock.
        applied: The command that the robot was told, after every limit; None before the first.
        reason: Why the applied command differs from the requested one (bit mask, 0 = it does not).
        heard_ns: When the bridge took the last command, on its monotonic clock ...
        decided_ns: ... when it knew what to apply of it ...
        sent_ns: ... and when it told the robot.
        object_position: Of the tracked object in the base frame, m, shape (3,), or None.
        object_quaternion: w x y z, shape (4,), or None.
        object_stamp_ns: When it was there, on the robot's clock: trackers are late.
    """

    joint_names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array
    stamp_ns: int
    received_ns: int = 0
    applied: Command | None = None
    reason: int = 0
    heard_ns: int = 0
    decided_ns: int = 0
    sent_ns: int = 0
    object_position: Array | None = None
    object_quaternion: Array | None = None
    object_stamp_ns: int = 0

    def __post_init__(self) -> None:
        joints = (len(self.joint_names),)
        check_shapes(
            {
                "position": self.position,
                "velocity": self.velocity,
                "effort": self.effort,
                "object_position": self.object_position,
                "object_quaternion": self.object_quaternion,
            },
            {
                "position": joints,
                "velocity": joints,
                "effort": joints,
                "object_position": (3,),
                "object_quaternion": (4,),
            },
        )
