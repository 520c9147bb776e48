"""What is said under which topic: the same in a recording and to a viewer that looks on.

Shape letters: J joints.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gfm.core import Command, Observation
from gfm.core.checks import Array
from gfm.recording import messages, periods, schemas
from gfm.recording.messages import BASE_FRAME

if TYPE_CHECKING:
    from gfm.recording.scene import Scene

#: Between two pictures of the arm: an eye needs no more.
SEEN_NS = 50_000_000


class TopicWriter(ABC):
    """Takes messages under topics, and knows the messages of each."""

    @abstractmethod
    def write_message(
        self, topic: str, kind: schemas.MessageType, message: Mapping[str, object], stamp_ns: int
    ) -> None:
        """Writes a message of any type."""

    def write_state(
        self,
        stamp_ns: int,
        joint_names: Sequence[str],
        position: Array,
        velocity: Array | None = None,
        effort: Array | None = None,
    ) -> None:
        """Writes one measurement: rad, rad/s, N m, each of shape (J,)."""
        fields = {"position": position, "velocity": velocity, "effort": effort}
        state = messages.joint_state(stamp_ns, joint_names, fields)
        self.write_message(schemas.JOINT_STATES, schemas.JOINT_STATE, state, stamp_ns)

    def write_command(self, applied: Command) -> None:
        """Writes the command that the robot was told; its stamp is when it took effect."""
        self._write_setpoint(schemas.COMMAND, applied)

    def write_requested(self, requested: Command) -> None:
        """Writes what was asked for before any limit, under the stamp of what was applied."""
        self._write_setpoint(schemas.REQUESTED, requested)

    def write_reason(self, stamp_ns: int, mask: int) -> None:
        """Writes why what was applied under that stamp is not what was requested: a bit mask."""
        self.write_message(schemas.REASON, schemas.REASON_MASK, {"data": mask}, stamp_ns)

    def write_object_pose(
        self,
        stamp_ns: int,
        position: Array,
        quaternion: Array,
        covariance: Array | None = None,
        camera: str = "",
    ) -> None:
        """Writes one pose in the base frame, with its covariance on a topic of its own.

        Args:
            stamp_ns: When the object was there.
            position: m, shape (3,).
            quaternion: w x y z, shape (4,).
            covariance: Of x, y, z and the turns about them, m and rad, shape (6, 6); or None.
            camera: That alone sees it there, whose topics these are; none: all together.
        """
        place = schemas.CAMERA.format(camera) if camera else ""
        head, pose = messages.header(stamp_ns, BASE_FRAME), messages.pose(position, quaternion)
        message: messages.Message = {"header": head, "pose": pose}
        self.write_message(place + schemas.OBJECT_POSE, schemas.POSE, message, stamp_ns)
        if covariance is not None:
            spread = {"pose": pose, "covariance": covariance.ravel().tolist()}
            message = {"header": head, "pose": spread}
            topic, kind = place + schemas.OBJECT_POSE_SPREAD, schemas.POSE_SPREAD
            self.write_message(topic, kind, message, stamp_ns)

    def write_frames(self, topic: str, stamp_ns: int, frames: Sequence[messages.Frame]) -> None:
        """Writes where frames are, on `/tf`, or on `/tf_static` where they stay there."""
        message = messages.transforms(stamp_ns, frames)
        self.write_message(topic, schemas.TRANSFORMS, message, stamp_ns)

    def write_description(self, stamp_ns: int, urdf: str) -> None:
        """Writes the robot's description in URDF."""
        self.write_message(schemas.DESCRIPTION, schemas.TEXT, {"data": urdf}, stamp_ns)

    def _write_setpoint(self, topic: str, command: Command) -> None:
        fields = {str(command.kind): command.values}
        state = messages.joint_state(command.stamp_ns, command.joint_names, fields)
        self.write_message(topic, schemas.JOINT_STATE, state, command.stamp_ns)


def write_told(requested: Command, applied: Command, reason: int, writer: TopicWriter) -> None:
    """Writes what was asked for and what the robot was told, stamped as it acts, and why."""
    writer.write_command(applied)
    writer.write_requested(requested)
    writer.write_reason(applied.stamp_ns, reason)


def write_report(report: Observation, writer: TopicWriter) -> None:
    """Writes what the joints measured."""
    writer.write_state(
        report.stamp_ns, report.joint_names, report.position, report.velocity, report.effort
    )


def write_period(newest: Observation, timed: bool, writer: TopicWriter) -> None:
    """Writes what the bridge did until a report; its own times only where they mean anything."""
    stamp_ns = newest.stamp_ns
    writer.write_message(periods.SAFETY_TOPIC, periods.SAFETY, periods.safety(newest), stamp_ns)
    if timed:
        timing = periods.timing(newest)
        writer.write_message(periods.TIMING_TOPIC, periods.TIMING, timing, stamp_ns)


def write_lasting(scene: Scene, stamp_ns: int, writer: TopicWriter) -> None:
    """Writes what does not change: the robot's description, and frames that do not move."""
    writer.write_description(stamp_ns, scene.description)
    writer.write_frames(schemas.FIXED_FRAMES, stamp_ns, scene.fixed)


def write_moving(scene: Scene, report: Observation, writer: TopicWriter) -> None:
    """Writes where the arm's links are."""
    writer.write_frames(schemas.FRAMES, report.stamp_ns, scene.moving(report.position))


def write_object(
    seen_ns: int,
    position: Array,
    quaternion: Array,
    covariance: Array | None,
    writer: TopicWriter,
    camera: str = "",
) -> None:
    """Writes where the object is, as a pose and as a frame.

    Args:
        seen_ns: When it was there.
        position: In the robot's base frame, m, shape (3,).
        quaternion: w x y z, shape (4,).
        covariance: See `TopicWriter.write_object_pose`.
        writer: To which.
        camera: That alone sees it there; none: all together.
    """
    writer.write_object_pose(seen_ns, position, quaternion, covariance, camera)
    child = f"object_by_{camera}" if camera else "object"
    frame = messages.Frame(parent=BASE_FRAME, child=child, position=position, quaternion=quaternion)
    writer.write_frames(schemas.FRAMES, seen_ns, [frame])
