"""The bridge's recordings: one at a time, in one folder, each with one kind of command."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import final

from gfm.core import Command, CommandKind, Observation, RefusedError
from gfm.recording import RecordingWriter, schemas
from gfm.recording.topics import (
    SEEN_NS,
    write_lasting,
    write_moving,
    write_object,
    write_period,
    write_report,
    write_told,
)
from gfm_robot_bridge.background import Background, Piece
from gfm_robot_bridge.content import Content
from gfm_robot_bridge.object_port import Seen
from gfm_robot_bridge.recording_file import RecordingFile
from gfm_wire import Ack, RecordDone, RecordStart

_log = logging.getLogger(__name__)
#: Asked for an answer; None while it is not known.
Pending = Callable[[], Ack | RecordDone | None]
About = Callable[[], Mapping[str, str]]
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


@dataclass(kw_only=True)
class _Recording:
    """One recording under way, or ended by a change of mode."""

    file: RecordingFile
    kind: CommandKind | None = None
    reports: int = 0
    ended: bool = False
    tracked_ns: int = -1
    seen_ns: int = -SEEN_NS


@final
class Recorder:
    """Writes reports and commands while a recording is under way.

    A recording begins with the command that is in force, if that is of the kind of those that
    follow. Commands of another kind end it: a recording has one kind. So does a disk that is full,
    or too slow.

    Args:
        folder: Where recordings go.
        about: Asked at its beginning: what a recording says about itself.
        background: That writes.
        content: What recordings hold beside reports and commands.

    Attributes:
        finished: Recordings completed.
        failed: Recordings that the disk ended.
    """

    def __init__(
        self,
        folder: Path,
        about: About,
        background: Background,
        content: Content | None = None,
    ) -> None:
        self.finished = 0
        self.failed = 0
        self._folder = folder
        self._about = about
        self._background = background
        self._content = content or Content()
        self._recording: _Recording | None = None
        self._in_force: tuple[Command, Command, int] | None = None

    @property
    def name(self) -> str:
        """The recording under way, or nothing."""
        return "" if self._recording is None else self._recording.file.path.name

    def start(self, request: RecordStart) -> Pending:
        """Begins a recording; returns what to ask for the answer.

        Raises:
            RefusedError: one is under way, or the name is no plain file name or is taken; asked for
                the answer, too: the file cannot be written.
        """
        if self._recording is not None:
            raise RefusedError(f"{self.name} is being recorded; stop it first")
        if not _NAME.fullmatch(request.name):
            raise RefusedError(f"name {request.name!r}: expected letters, digits, dots, dashes, _")
        path = self._folder / f"{request.name}.mcap"
        if path.exists():
            raise RefusedError(f"{path} exists; recordings are never overwritten")
        about = {**self._about(), **request.metadata}
        recording = _Recording(file=RecordingFile(path, about, partial(_first, self._content)))
        self._recording = recording
        self._do(recording.file, recording.file.begin)

        def answer() -> Ack | None:
            if recording.file.problem:
                self._recording = None
                self._raise(recording.file)
            return Ack() if recording.file.is_open else None

        return answer

    def stop(self) -> Pending:
        """Completes the recording; returns what to ask for the answer.

        Raises:
            RefusedError: none is under way; asked for the answer, too: the disk ended it.
        """
        if self._recording is None:
            raise RefusedError("nothing is being recorded")
        recording, self._recording = self._recording, None
        self._do(recording.file, recording.file.finish)

        def answer() -> RecordDone | None:
            if recording.file.problem:
                self._raise(recording.file)
            if not recording.file.is_done:
                return None
            self.finished += 1
            return RecordDone(path=str(recording.file.path), ticks=recording.reports)

        return answer

    def close(self, timeout_s: float) -> None:
        """Completes what is under way, or gives up after `timeout_s`."""
        if self._recording is not None:
            self._background.do(self._recording.file.finish)
        self._background.close(timeout_s)

    def _raise(self, file: RecordingFile) -> None:
        self.failed += 1
        raise RefusedError(file.problem)

    def _do(self, file: RecordingFile, piece: Piece) -> None:
        if not self._background.do(piece):
            file.give_up("the disk is too slow")

    def _write(self, file: RecordingFile, piece: Callable[[RecordingWriter], None]) -> None:
        if not file.problem:
            self._do(file, partial(file.write, piece))

    def command(self, requested: Command, applied: Command, reason: int) -> None:
        """Takes what was asked for, what the robot was told, both stamped as they act, and why."""
        before, self._in_force = self._in_force, (requested, applied, reason)
        recording = self._recording
        if recording is None or recording.ended:
            return
        if recording.kind is None:
            recording.kind = applied.kind
            if before is not None and before[1].kind is applied.kind:
                self._write(recording.file, partial(write_told, *before))
        if recording.kind is applied.kind:
            self._write(recording.file, partial(write_told, requested, applied, reason))
        else:
            recording.ended = True
            _log.warning("%s ends: %s commands follow", self.name, applied.kind)

    def report(self, report: Observation) -> None:
        """Takes one sensor report."""
        recording = self._recording
        if recording is not None and not recording.ended:
            self._write(recording.file, partial(write_report, report))
            recording.reports += 1
            self._frames(recording, report)
            self._object_pose(recording, report)

    def tracked(self, seen: Seen) -> None:
        """Takes where the object is by a tracker outside, and by each of its cameras alone."""
        recording = self._recording
        if recording is not None and not recording.ended:
            self._write(recording.file, partial(_tracked, seen))

    def period(self, newest: Observation) -> None:
        """Takes the newest report of a period with what is in force."""
        recording = self._recording
        if recording is not None and not recording.ended:
            self._write(recording.file, partial(write_period, newest, self._content.timed))

    def _frames(self, recording: _Recording, report: Observation) -> None:
        """Writes where the arm's links are, not more often than an eye needs it."""
        scene = self._content.scene
        if scene is None or report.stamp_ns < recording.seen_ns + SEEN_NS:
            return
        if recording.reports == 1:
            self._write(recording.file, partial(write_lasting, scene, report.stamp_ns))
        recording.seen_ns = report.stamp_ns
        self._write(recording.file, partial(write_moving, scene, report))

    def _object_pose(self, recording: _Recording, report: Observation) -> None:
        """Writes where the object was, once for each time that it was tracked."""
        place, turn, seen_ns = (
            report.object_position,
            report.object_quaternion,
            report.object_stamp_ns,
        )
        if place is None or turn is None or seen_ns <= recording.tracked_ns:
            return
        recording.tracked_ns = seen_ns
        self._write(
            recording.file, partial(write_object, seen_ns, place, turn, self._content.covariance)
        )


def _first(content: Content, writer: RecordingWriter) -> None:
    if content.limits:
        writer.add_metadata(schemas.LIMITS_RECORD, content.limits)
    if content.scene is not None:
        writer.attach("model.xml", "application/xml", content.scene.model_xml.encode())


def _tracked(seen: Seen, writer: RecordingWriter) -> None:
    poses = {**seen.told.views, "": seen.pose}
    for camera, pose in poses.items():
        place, turn, spread = pose.position, pose.quaternion, pose.covariance
        write_object(seen.stamp_ns, place, turn, spread, writer, camera)
