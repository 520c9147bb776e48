"""Where metrics go: rows of JSON, and TensorBoard."""

from __future__ import annotations

import errno
import json
import logging
import os
import socket
from abc import ABC, abstractmethod
from collections.abc import Mapping
from io import BytesIO, FileIO
from pathlib import Path
from typing import final

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.record_writer import RecordWriter
from typing_extensions import override

from gfm.core import BadInputError

METRICS = "metrics.jsonl"

_log = logging.getLogger(__name__)


class MetricsSink(ABC):
    """Takes rows of metrics."""

    @abstractmethod
    def write(self, step: int, time_s: float, row: Mapping[str, float]) -> None:
        """Takes one row.

        Args:
            step: What the curves are drawn over: learner steps.
            time_s: Since 1970-01-01 UTC.
            row: Values by name; names carry units where there are any.
        """

    @abstractmethod
    def close(self) -> None:
        """Ends; everything written is on disk."""


@final
class NoMetrics(MetricsSink):
    """Forgets."""

    @override
    def write(self, step: int, time_s: float, row: Mapping[str, float]) -> None:
        pass

    @override
    def close(self) -> None:
        pass


@final
class FolderMetrics(MetricsSink):
    """Appends to `metrics.jsonl` and to a TensorBoard file in one folder.

    A row that the disk does not take is left out of both, whole, and said once; learning does not
    depend on it.
    """

    def __init__(self, folder: Path) -> None:
        """Opens the files.

        Raises:
            BadInputError: the folder cannot be made or written to.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._rows = _Appended((folder / METRICS).open("ab", buffering=0))
        except OSError as exc:
            raise BadInputError(f"{folder}: cannot be written to: {exc.strerror}") from exc
        self._folder = folder
        self._events: _Appended | None = None
        self._failing = False

    @override
    def write(self, step: int, time_s: float, row: Mapping[str, float]) -> None:
        line = {"learner_step": step, "time_s": round(time_s, 3), **row}
        values = [Summary.Value(tag=name, simple_value=value) for name, value in row.items()]
        event = Event(step=step, wall_time=time_s, summary=Summary(value=values))
        try:
            self._rows.append(json.dumps(line).encode() + b"\n")
            self._open_events(time_s).append(_record(event))
        except OSError as error:
            if not self._failing:
                reason = error.strerror or error
                _log.error("no metrics from step %d on: %s: %s", step, self._folder, reason)
            self._failing = True
        else:
            self._failing = False

    @override
    def close(self) -> None:
        self._rows.close()
        if self._events is not None:
            self._events.close()

    def _open_events(self, time_s: float) -> _Appended:
        if self._events is None:
            # TensorBoard reads the files of a folder in the order of their names.
            name = f"events.out.tfevents.{int(time_s):010d}.{socket.gethostname()}.{os.getpid()}"
            self._events = _Appended((self._folder / name).open("ab", buffering=0))
            self._events.append(_record(Event(wall_time=time_s, file_version="brain.Event:2")))
        return self._events


class _Appended:
    """A file that grows by whole pieces."""

    def __init__(self, file: FileIO) -> None:
        self._file = file

    def append(self, piece: bytes) -> None:
        before = self._file.tell()
        try:
            if self._file.write(piece) != len(piece):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError:
            self._file.truncate(before)
            self._file.seek(before)
            raise

    def close(self) -> None:
        self._file.close()


def _record(event: Event) -> bytes:
    """Returns an event as TensorBoard's files hold it."""
    record = BytesIO()
    RecordWriter(record).write(event.SerializeToString())
    return record.getvalue()
