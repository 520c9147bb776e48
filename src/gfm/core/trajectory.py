"""One recording of one robot: what was commanded and what was measured, each with its stamps.

Shape letters: T measurements, C commands, J joints, P object poses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array, Stamps, check_shapes
from gfm.core.robot import CommandKind

#: Metadata: measured joints that no command names, separated by commas.
UNCOMMANDED = "uncommanded_joints"


@dataclass(frozen=True, kw_only=True)
class ObjectTrack:
    """The recorded poses of a free object in the base frame.

    Attributes:
        stamp_ns: Measurement times, increasing, shape (P,).
        position: m, shape (P, 3).
        quaternion: w x y z, unit length, shape (P, 4).
    """

    stamp_ns: Stamps
    position: Array
    quaternion: Array

    def __post_init__(self) -> None:
        poses = len(self.stamp_ns)
        check_shapes(
            {"position": self.position, "quaternion": self.quaternion},
            {"position": (poses, 3), "quaternion": (poses, 4)},
        )


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One recording: measured joint states and the commands that caused them.

    Stamps are nanoseconds on one clock, strictly increasing within each stream. A command holds
    from its stamp until the next one.

    Attributes:
        name: Where it came from, for messages and tables.
        joint_names: The joints, in the order of every array.
        stamp_ns: Measurement times, shape (T,).
        position: rad, link side, shape (T, J).
        velocity: rad/s, shape (T, J), or None where not recorded.
        effort: Drive torque, N m, shape (T, J), or None where not recorded.
        command_kind: What `command` is.
        command_stamp_ns: When each command was issued, shape (C,).
        command: Applied setpoints in rad, rad/s or N m, shape (C, J).
        requested: What was asked for before any limit, shape (C, J), or None where the same.
        servo_gain: Per joint, the factor by which this recording's servo gain differs from the
            model's (a setting known to whoever recorded it), by joint name; absent means 1, and
            0 that the drive was switched off and exerts nothing.
        object_track: Poses of the free object, or None.
        metadata: Whatever else the file said about itself.
    """

    name: str
    joint_names: tuple[str, ...]
    stamp_ns: Stamps
    position: Array
    velocity: Array | None
    effort: Array | None
    command_kind: CommandKind
    command_stamp_ns: Stamps
    command: Array
    requested: Array | None = None
    servo_gain: Mapping[str, float] = field(default_factory=dict)
    object_track: ObjectTrack | None = None
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        states = (len(self.stamp_ns), len(self.joint_names))
        commands = (len(self.command_stamp_ns), len(self.joint_names))
        check_shapes(
            {
                "position": self.position,
                "velocity": self.velocity,
                "effort": self.effort,
                "command": self.command,
                "requested": self.requested,
            },
            {
                "position": states,
                "velocity": states,
                "effort": states,
                "command": commands,
                "requested": commands,
            },
        )

    @property
    def uncommanded(self) -> tuple[str, ...]:
        """The joints that no command names."""
        listed = self.metadata.get(UNCOMMANDED, "").split(", ")
        return tuple(name for name in self.joint_names if name in listed)

    @property
    def time_s(self) -> Array:
        """Measurement times in seconds since the first measurement, shape (T,)."""
        return np.asarray((self.stamp_ns - self.stamp_ns[0]) * 1e-9)

    @property
    def command_time_s(self) -> Array:
        """Command times in seconds since the first measurement, shape (C,)."""
        return np.asarray((self.command_stamp_ns - self.stamp_ns[0]) * 1e-9)

    @property
    def duration_s(self) -> float:
        """Time from the first to the last measurement."""
        return float(self.stamp_ns[-1] - self.stamp_ns[0]) * 1e-9

    @property
    def period_s(self) -> float:
        """Median time from one measurement to the next."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def held_command(self) -> Array:
        """The command in force at each measurement, the first one before it, shape (T, J)."""
        place = np.searchsorted(self.command_stamp_ns, self.stamp_ns, side="right") - 1
        return self.command[np.maximum(place, 0)]

    @property
    def gains(self) -> Array:
        """The factor on each joint's servo gain, 0 where its drive was off, shape (J,)."""
        return np.array([self.servo_gain.get(name, 1.0) for name in self.joint_names])

    def measured_at(self, rows: slice | NDArray[np.bool_]) -> Trajectory:
        """Returns the recording with some of its measurements, and all of its commands."""
        return replace(
            self,
            stamp_ns=self.stamp_ns[rows],
            position=self.position[rows],
            velocity=None if self.velocity is None else self.velocity[rows],
            effort=None if self.effort is None else self.effort[rows],
        )

    def with_joints(self, names: Sequence[str]) -> Trajectory:
        """Returns the recording with these of its joints, in this order.

        Raises:
            ValueError: it has no joint of one of the names.
        """
        columns = [self.joint_names.index(name) for name in names]

        def chosen(values: Array | None) -> Array | None:
            return None if values is None else values[:, columns]

        return replace(
            self,
            joint_names=tuple(names),
            position=self.position[:, columns],
            velocity=chosen(self.velocity),
            effort=chosen(self.effort),
            command=self.command[:, columns],
            requested=chosen(self.requested),
        )
