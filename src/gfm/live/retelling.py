"""What a bridge publishes, under the topics of its recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from gfm.core import Observation
from gfm.recording.scene import Scene, sawyer_scene
from gfm.recording.topics import (
    SEEN_NS,
    TopicWriter,
    write_lasting,
    write_moving,
    write_object,
    write_period,
    write_report,
    write_told,
)
from gfm.sim.sawyer import JOINT_NAMES
from gfm.sim.sawyer_numbers import JOINTS

_NEVER_NS = -SEEN_NS


@dataclass(kw_only=True)
class _Told:
    """Stamps of what was told last, by the robot's clock; and whether what lasts was told."""

    report_ns: int = _NEVER_NS
    command_ns: int = _NEVER_NS
    object_ns: int = _NEVER_NS
    frames_ns: int = _NEVER_NS
    lasting: bool = False


@final
class Retelling:
    """Tells a writer of a robot, period by period.

    A bridge publishes the newest report of a period, and the last of the setpoints that were told
    in it: its recordings have all of them.

    Args:
        writer: Gets it.
    """

    def __init__(self, writer: TopicWriter) -> None:
        self._writer = writer
        self._scene: Scene | None = None
        self._told = _Told()

    def take(self, newest: Observation) -> None:
        """Tells of one period what is new in it."""
        if newest.stamp_ns < self._told.report_ns:
            self._told = _Told()  # the robot was started again, and its clock with it
        self._command(newest)
        if newest.stamp_ns > self._told.report_ns:
            self._told.report_ns = newest.stamp_ns
            write_report(newest, self._writer)
            self._frames(newest)
        self._object(newest)
        write_period(newest, True, self._writer)

    def _command(self, newest: Observation) -> None:
        applied = newest.applied
        if applied is not None and applied.stamp_ns > self._told.command_ns:
            self._told.command_ns = applied.stamp_ns
            write_told(newest.requested or applied, applied, newest.reason, self._writer)

    def _frames(self, newest: Observation) -> None:
        if newest.joint_names != JOINT_NAMES or newest.stamp_ns < self._told.frames_ns + SEEN_NS:
            return
        self._told.frames_ns = newest.stamp_ns
        if self._scene is None:
            speeds = np.array([joint.velocity for joint in JOINTS])
            efforts = np.array([joint.effort for joint in JOINTS])
            self._scene = sawyer_scene(JOINT_NAMES, speeds, efforts)
        if not self._told.lasting:
            self._told.lasting = True
            write_lasting(self._scene, newest.stamp_ns, self._writer)
        write_moving(self._scene, newest, self._writer)

    def _object(self, newest: Observation) -> None:
        place, turn, seen_ns = (
            newest.object_position,
            newest.object_quaternion,
            newest.object_stamp_ns,
        )
        if place is not None and turn is not None and seen_ns > self._told.object_ns:
            self._told.object_ns = seen_ns
            write_object(seen_ns, place, turn, None, self._writer)
