"""Where metrics go: rows of JSON, and TensorBoard."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import final

from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter
from typing_extensions import override

METRICS = "metrics.jsonl"


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
    """Appends to `metrics.jsonl` and to a TensorBoard file in one folder."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._rows = (folder / METRICS).open("a", encoding="utf-8", buffering=1)
        self._events = EventFileWriter(str(folder))

    @override
    def write(self, step: int, time_s: float, row: Mapping[str, float]) -> None:
        line = {"learner_step": step, "time_s": round(time_s, 3), **row}
        self._rows.write(json.dumps(line) + "\n")
        values = [Summary.Value(tag=name, simple_value=value) for name, value in row.items()]
        summary = Summary(value=values)
        self._events.add_event(Event(step=step, wall_time=time_s, summary=summary))

    @override
    def close(self) -> None:
        self._rows.close()
        self._events.close()
