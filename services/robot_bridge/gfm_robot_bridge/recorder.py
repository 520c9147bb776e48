"""The bridge's recordings: one at a time, in one folder, each with one kind of command."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

from gfm.core import Command, CommandKind, Observation, RefusedError
from gfm.recording import RecordingWriter
from gfm_wire import RecordDone, RecordStart

_log = logging.getLogger(__name__)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")


@dataclass(kw_only=True)
class _Recording:
    """One recording under way, or ended by a change of mode."""

    writer: RecordingWriter
    kind: CommandKind | None = None
    reports: int = 0
    ended: bool = False
    tracked_ns: int = -1


@final
class Recorder:
    """Writes reports and commands while a recording is under way.

    A recording begins with the command that is in force, if that is of the kind of those that
    follow. Commands of another kind end it: a recording has one kind.

    Args:
        folder: Where recordings go.
        about: What every recording says about itself.

    Attributes:
        finished: Recordings completed.
    """

    def __init__(self, folder: Path, about: Mapping[str, str]) -> None:
        self.finished = 0
        self._folder = folder
        self._about = dict(about)
        self._recording: _Recording | None = None
        self._in_force: tuple[Command, Command] | None = None

    @property
    def name(self) -> str:
        """The recording under way, or nothing."""
        return "" if self._recording is None else self._recording.writer.path.name

    def start(self, request: RecordStart) -> None:
        """Begins a recording.

        Raises:
            RefusedError: one is under way, or the name is no plain file name or is taken.
        """
        if self._recording is not None:
            raise RefusedError(f"{self.name} is being recorded; stop it first")
        if not _NAME.fullmatch(request.name):
            raise RefusedError(f"name {request.name!r}: expected letters, digits, dots, dashes, _")
        path = self._folder / f"{request.name}.mcap"
        if path.exists():
            raise RefusedError(f"{path} exists; recordings are never overwritten")
        try:
            writer = RecordingWriter(path, about=self._about | dict(request.metadata))
        except OSError as exc:
            raise RefusedError(f"{path} cannot be written: {exc.strerror}") from exc
        self._recording = _Recording(writer=writer)

    def stop(self) -> RecordDone:
        """Completes the recording.

        Raises:
            RefusedError: none is under way.
        """
        if self._recording is None:
            raise RefusedError("nothing is being recorded")
        recording, self._recording = self._recording, None
        recording.writer.close()
        self.finished += 1
        return RecordDone(path=str(recording.writer.path), ticks=recording.reports)

    def command(self, requested: Command, applied: Command) -> None:
        """Takes what was asked for and what the robot was told, both stamped as they act."""
        before, self._in_force = self._in_force, (requested, applied)
        recording = self._recording
        if recording is None or recording.ended:
            return
        if recording.kind is None:
            recording.kind = applied.kind
            if before is not None and before[1].kind is applied.kind:
                _write(recording.writer, *before)
        if recording.kind is applied.kind:
            _write(recording.writer, requested, applied)
        else:
            recording.ended = True
            _log.warning("%s ends: %s commands follow", self.name, applied.kind)

    def report(self, report: Observation) -> None:
        """Takes one sensor report."""
        if self._recording is not None and not self._recording.ended:
            self._recording.writer.write_state(
                report.stamp_ns, report.joint_names, report.position, report.velocity, report.effort
            )
            self._recording.reports += 1
            self._object_pose(self._recording, report)

    def _object_pose(self, recording: _Recording, report: Observation) -> None:
        """Writes where the object was, once for each time that it was tracked."""
        place, turn = report.object_position, report.object_quaternion
        if place is None or turn is None or report.object_stamp_ns <= recording.tracked_ns:
            return
        recording.tracked_ns = report.object_stamp_ns
        recording.writer.write_object_pose(report.object_stamp_ns, place, turn)


def _write(writer: RecordingWriter, requested: Command, applied: Command) -> None:
    writer.write_command(applied)
    writer.write_requested(requested)
