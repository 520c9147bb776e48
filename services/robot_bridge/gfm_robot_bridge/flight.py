"""The flight record: what happened in the seconds before a stop, in a file for each."""

from __future__ import annotations

import json
import logging
from collections import deque
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import final

from gfm.core import Command, Observation, Reason
from gfm_robot_bridge.background import Background

_log = logging.getLogger(__name__)


@final
class FlightRecord:
    """Remembers the newest reports and commands, and writes them down when asked.

    A file has a line of JSON for the stop, then one for each report and for what was told after it:
    rad, rad/s, N m, and nanoseconds of the robot's clock and of the bridge's.

    Args:
        folder: Of the files; the oldest are removed where there are more than `kept`.
        periods: How many are remembered.
        kept: How many files.
        background: That writes.

    Attributes:
        written: Files so far.
    """

    def __init__(self, folder: Path, periods: int, kept: int, background: Background) -> None:
        self.written = 0
        self._folder = folder
        self._kept = kept
        self._background = background
        self._lines: deque[dict[str, object]] = deque(maxlen=2 * periods)

    def report(self, report: Observation) -> None:
        """Remembers a report."""
        self._lines.append(
            {
                "stamp_ns": report.stamp_ns,
                "received_ns": report.received_ns,
                "position": report.position.tolist(),
                "velocity": report.velocity.tolist(),
                "effort": report.effort.tolist(),
            }
        )

    def told(self, requested: Command | None, applied: Sequence[Command], reason: Reason) -> None:
        """Remembers a command, None where the bridge itself acted, and what became of it."""
        self._lines.append(
            {
                "requested": None if requested is None else _words(requested),
                "applied": [_words(command) for command in applied],
                "reason": [one.name for one in Reason if one in reason],
            }
        )

    def write(self, why: str, utc_ns: int, about: Mapping[str, str]) -> None:
        """Has a file written of what is remembered.

        Args:
            why: The robot was stopped.
            utc_ns: The date.
            about: What the file says of the bridge.
        """
        when = datetime.fromtimestamp(utc_ns * 1e-9, UTC).strftime("%Y%m%d-%H%M%S-%f")
        head = {"why": why, "utc_ns": utc_ns, **about}
        lines = [head, *self._lines]
        self._background.do(lambda: self._write(self._folder / f"flight_{when}.jsonl", lines))

    def _write(self, path: Path, lines: Sequence[Mapping[str, object]]) -> None:
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                file.writelines(json.dumps(line) + "\n" for line in lines)
            for old in sorted(self._folder.glob("flight_*.jsonl"))[: -self._kept]:
                old.unlink()
        except OSError as error:
            _log.warning("%s: no flight record: %s", path, error.strerror)
        else:
            self.written += 1


def _words(command: Command) -> dict[str, object]:
    return {
        "kind": str(command.kind),
        "values": command.values.tolist(),
        "stamp_ns": command.stamp_ns,
        "number": command.number,
        "speed_share": command.speed_share,
    }
