"""Counters that go on from one process of a service to the next: sums over its lives.

A file holds what earlier lives of one name counted. A process reads it once, adds its own counts,
and writes the sums now and then: one that is killed loses the counts of the last second.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import final

from gfm.core import BadInputError, Clock

_WRITE_NS = 1_000_000_000

_log = logging.getLogger(__name__)


@final
class Sums:
    """The sums of one service."""

    def __init__(self, path: Path, clock: Clock) -> None:
        """Reads what earlier processes counted; a damaged file counts as none, with a warning.

        Args:
            path: The file.
            clock: Of the times between two writes.

        Raises:
            BadInputError: there is no folder for the file.
        """
        if not path.parent.is_dir():
            raise BadInputError(f"sums {path}: expected a file in a folder that exists")
        self._path = path
        self._clock = clock
        self._past = _read(path)
        self._written_ns: int | None = None
        self._failing = False

    def total(self, counters: Mapping[str, int], lasting: Collection[str]) -> dict[str, int]:
        """Returns the sums over all lives.

        Args:
            counters: Of this process.
            lasting: Those among them that the service itself goes on with: these are sums already.
        """
        added = {name: n + counters.get(name, 0) for name, n in self._past.items()}
        return {**counters, **{name: n for name, n in added.items() if name not in lasting}}

    def is_due(self) -> bool:
        """Returns whether it is time to write: once a second."""
        now_ns = self._clock.now_ns()
        return self._written_ns is None or now_ns - self._written_ns >= _WRITE_NS

    def write(self, total: Mapping[str, int]) -> None:
        """Writes the sums; where the disk takes nothing, says so once."""
        self._written_ns = self._clock.now_ns()
        partial = self._path.with_name(f".{self._path.name}.partial")
        try:
            partial.write_text(json.dumps(dict(total)), encoding="utf-8")
            partial.replace(self._path)
        except OSError as error:
            if not self._failing:
                _log.error("sums are not kept: %s: %s", self._path, error.strerror or error)
            self._failing = True
        else:
            self._failing = False


def _read(path: Path) -> dict[str, int]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return {str(name): int(count) for name, count in found.items()}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, AttributeError, TypeError) as error:
        _log.warning("%s: cannot be read, sums begin anew: %s", path, error)
        return {}


def make_sums(path: str, name: str, clock: Clock) -> Sums | None:
    """Returns the sums that a service's settings ask for.

    Args:
        path: The file, or a folder in which the service has one of its own; empty keeps none.
        name: Of the service.
        clock: Of the times between two writes.

    Raises:
        BadInputError: there is no folder for the file.
    """
    if not path:
        return None
    place = Path(path)
    return Sums(place / f"{name}.json" if place.is_dir() else place, clock)
