"""Where the object is, as a tracker outside of the robot says: with an age, never frozen."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from gfm.core import Clock, Observation
from gfm.transport import QUEUED_REQUESTS, Request, Transport
from gfm_robot_bridge.lease import Lease
from gfm_wire import Ack, ObjectPose, RobotClock, TrackedObject

TRACKED = "robot/tracked"
#: By how much the clocks of two machines may differ, ns: a pose from the future would stay young
#: for longer.
_AHEAD_NS = 50_000_000
#: A tracker that is silent for so long may be replaced by another one, ns.
_SILENCE_NS = 1_000_000_000
_QUATERNION_TOLERANCE = 1e-3
#: A camera's name is part of a topic's.
_CAMERA = re.compile(r"[A-Za-z0-9_-]{1,50}")


@dataclass(frozen=True, kw_only=True)
class Seen:
    """A pose of the object, and when it was there, on the robot's clock, ns."""

    stamp_ns: int
    told: TrackedObject
    pose: ObjectPose


@final
class ObjectPort:
    """Takes poses from one tracker, and adds the newest to reports of a robot that has none.

    Args:
        transport: On which they arrive.
        clock: Of this process.
        robot_clock: How the robot's time passes: poses come in real time.
        oldest_ns: A pose that is older is none.

    Attributes:
        counters: Poses that came, and messages that there is none, by name.
        rejected: Messages that were refused.
    """

    def __init__(
        self, transport: Transport, clock: Clock, robot_clock: RobotClock, oldest_ns: int
    ) -> None:
        self.counters: Counter[str] = Counter(tracked_poses=0, invalid_poses=0)
        self.rejected = 0
        self._server = transport.serve(TRACKED)
        self._clock = clock
        self._is_live = robot_clock is RobotClock.WALL
        self._oldest_ns = oldest_ns
        self._lease = Lease("the object's pose", _SILENCE_NS)
        self._told_ns = 0
        self._seen: Seen | None = None

    def hear(self, robot_ns: int) -> list[Seen]:
        """Returns the poses that are new, oldest first.

        Args:
            robot_ns: What the robot's clock shows now.
        """
        new: list[Seen] = []
        for _ in range(QUEUED_REQUESTS):
            if (request := self._server.receive()) is None:
                break
            message = request.message
            if not isinstance(message, TrackedObject):
                self._refuse(request, f"got {type(message).__name__}, expected TrackedObject")
            elif problem := self._problem(request, message):
                self._refuse(request, problem)
            else:
                self._lease.take(request.stamp, self._clock.now_ns())
                new += self._taken(message, robot_ns)
                request.reply(Ack())
        return new

    def added_to(self, report: Observation) -> Observation:
        """Returns a report with the object's pose, where it has none and one is young enough."""
        seen = self._seen
        if report.object_position is not None or seen is None:
            return report
        if report.stamp_ns - seen.stamp_ns > self._oldest_ns:
            return report
        return replace(
            report,
            object_position=seen.pose.position,
            object_quaternion=seen.pose.quaternion,
            object_stamp_ns=seen.stamp_ns,
        )

    def problem(self, report: Observation) -> str:
        """Returns in words why a report does not say where the object is; empty where it does."""
        seen_ns, oldest = report.object_stamp_ns, f"expected at most {self._oldest_ns * 1e-6:g} ms"
        if report.object_position is None:
            if self._seen is None:
                return "object: nobody says where it is"
            seen_ns = self._seen.stamp_ns
        age_ns = report.stamp_ns - seen_ns
        if age_ns <= self._oldest_ns:
            return ""
        return f"object: its pose is {age_ns * 1e-6:.0f} ms old, {oldest}"

    def _taken(self, message: TrackedObject, robot_ns: int) -> list[Seen]:
        if message.pose is None:
            self.counters["invalid_poses"] += 1
            self._seen = None
            return []
        is_new, self._told_ns = message.stamp_ns > self._told_ns, message.stamp_ns
        if not is_new and self._seen is not None:
            return []
        self.counters["tracked_poses"] += 1
        stamp_ns = robot_ns - (self._clock.utc_ns() - message.stamp_ns)
        self._seen = Seen(stamp_ns=stamp_ns, told=message, pose=message.pose)
        return [self._seen]

    def _problem(self, request: Request, message: TrackedObject) -> str:
        """Returns why a message is not believed, in words; empty where it is."""
        if not self._is_live:
            return "poses come in real time, and the robot's clock is lockstep; expected wall"
        if held := self._lease.refusal(request.stamp, self._clock.now_ns()):
            return held
        age_ns = self._clock.utc_ns() - message.stamp_ns
        if age_ns > self._oldest_ns:
            return (
                f"pose is {age_ns * 1e-6:.0f} ms old, expected at most {self._oldest_ns * 1e-6:g}"
            )
        if -age_ns > _AHEAD_NS:
            return (
                f"pose is {-age_ns * 1e-6:.0f} ms in the future, expected at most "
                f"{_AHEAD_NS * 1e-6:g}: the clocks differ"
            )
        if message.stamp_ns < self._told_ns:
            return f"pose is {(self._told_ns - message.stamp_ns) * 1e-6:.0f} ms older than the last"
        for camera in message.views:
            if not _CAMERA.fullmatch(camera):
                return f"camera {camera!r}: expected letters, digits, - or _"
        poses = message.views if message.pose is None else {**message.views, "": message.pose}
        return next((why for one in poses.values() if (why := _cannot_be(one))), "")

    def _refuse(self, request: Request, reason: str) -> None:
        self.rejected += 1
        request.refuse(reason)


def _cannot_be(pose: ObjectPose) -> str:
    """Returns why a pose makes no sense, in words; empty where it does."""
    length = float(np.linalg.norm(pose.quaternion))
    if abs(length - 1.0) > _QUATERNION_TOLERANCE:
        return f"pose has a quaternion of length {length:.3g}, expected 1"
    least = float(np.linalg.eigvalsh(0.5 * (pose.covariance + pose.covariance.T))[0])
    if least < 0.0 or not np.allclose(pose.covariance, pose.covariance.T):
        return "pose has a covariance that is none, expected a symmetric one without negative parts"
    return ""
