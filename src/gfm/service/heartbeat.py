"""Signs of life of a service's own loop, for whoever supervises it on the same host.

A heartbeat is a file: it holds the process id, and its modification time is the last beat. It needs
no network, so that a router that is away makes nobody look hung, and `find` can read it where there
is no Python to spare.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from pathlib import Path
from typing import final

from typing_extensions import override

from gfm.core import BadInputError, Clock

_BEAT_NS = 500_000_000


class Heartbeat(ABC):
    """Told by a loop that it goes on."""

    @abstractmethod
    def beat(self) -> None:
        """Notes that the loop goes on; called before every step, so it costs next to nothing."""

    @abstractmethod
    def end(self) -> None:
        """Notes that the loop has ended as it should."""


@final
class NoHeartbeat(Heartbeat):
    """Nobody looks."""

    @override
    def beat(self) -> None:
        pass

    @override
    def end(self) -> None:
        pass


@final
class FileHeartbeat(Heartbeat):
    """Touches a file twice a second at most; there is none before the first beat."""

    def __init__(self, path: Path, clock: Clock) -> None:
        """Removes what an earlier process left.

        Raises:
            BadInputError: there is no folder for the file.
        """
        if not path.parent.is_dir():
            raise BadInputError(f"heartbeat {path}: expected a file in a folder that exists")
        self._path = path
        self._clock = clock
        self._beaten_ns: int | None = None
        path.unlink(missing_ok=True)

    @override
    def beat(self) -> None:
        now_ns = self._clock.now_ns()
        if self._beaten_ns is not None and now_ns - self._beaten_ns < _BEAT_NS:
            return
        self._beaten_ns = now_ns
        try:
            os.utime(self._path)
        except FileNotFoundError:  # the first beat, or somebody cleaned up
            self._path.write_text(f"{os.getpid()}\n", encoding="ascii")

    @override
    def end(self) -> None:
        self._path.unlink(missing_ok=True)


def make_heartbeat(path: str, clock: Clock) -> Heartbeat:
    """Returns the heartbeat that a service's settings ask for; none where the path is empty."""
    return FileHeartbeat(Path(path), clock) if path else NoHeartbeat()
