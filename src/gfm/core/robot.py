"""What crosses between a policy and a robot: one command, one observation, and why they differ.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag, StrEnum

from gfm.core.checks import Array, check_shapes


class CommandKind(StrEnum):
    """What a joint command means; its value is the one non-empty field of a JointState command."""

    POSITION = "position"
    VELOCITY = "velocity"
    EFFORT = "effort"


class Reason(IntFlag):
    """Why the applied command differs from the requested one."""

    NONE = 0
    """It does not."""
    POSITION = 1
    """It would have led out of the joint range."""
    VELOCITY = 2
    """It was faster than allowed."""
    ACCELERATION = 4
    """It changed speed more quickly than allowed."""
    EFFORT = 8
    """It was stronger than allowed."""
    WATCHDOG = 16
    """None came in time: the robot is stopped."""
    MODE = 32
    """It was of another kind: the arm comes to rest first."""
    POWER = 64
    """It would have put more power into the motion than allowed."""
    STOPPED = 128
    """The robot is stopped: somebody said so, its driver let go, or something failed."""
    SCALED = 256
    """Somebody has the robot go at a part of its speed, or not at all."""
    WORKSPACE = 512
    """It would have led out of the workspace."""
    COLLISION = 1024
    """It would have led too near to what stands around the arm, or to the arm itself."""
    OBJECT = 2048
    """It was made for where the object is, and that is not known, or not any more."""
    LOAD = 4096
    """The arm bears a load that nobody told the robot of, and would not have borne that, too."""


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
        speed_share: Share of the robot's speed limits that its task may have, more than 0 and at
            most 1: no joint is told to go faster. What the bridge itself allows holds beside it.
    """

    kind: CommandKind
    joint_names: tuple[str, ...]
    values: Array
    stamp_ns: int
    number: int = 0
    needs_object: bool = False
    speed_share: float = 1.0

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
        requested: What its driver had asked for, under the stamp of what was applied; None where
            the bridge itself acts.
        reason: Why the applied command differs from the requested one, see `Reason`.
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
    requested: Command | None = None
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
