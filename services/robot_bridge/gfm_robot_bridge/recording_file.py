"""One recording as it is written, away from the control loop."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import final

from gfm.recording import RecordingWriter

_log = logging.getLogger(__name__)


@final
class RecordingFile:
    """What the disk does to a recording ends it, never the loop that it comes from.

    Every method is a piece of work for a `Background`; the attributes may be read meanwhile.

    Args:
        path: The file to make.
        about: What the recording says about itself.
        first: What is written before anything else.

    Attributes:
        path: As given.
        is_open: Whether it was begun.
        is_done: Whether it is complete.
        problem: Why it ended early, in words; empty where it did not.
    """

    def __init__(
        self, path: Path, about: Mapping[str, str], first: Callable[[RecordingWriter], None]
    ) -> None:
        self.path = path
        self.is_open = False
        self.is_done = False
        self.problem = ""
        self._about = dict(about)
        self._first = first
        self._writer: RecordingWriter | None = None

    def begin(self) -> None:
        """Opens the file."""
        self._guarded(self._begin)

    def write(self, piece: Callable[[RecordingWriter], None]) -> None:
        """Writes a piece, unless the recording has ended."""
        writer = self._writer
        if writer is not None:
            self._guarded(lambda: piece(writer))

    def finish(self) -> None:
        """Completes the file, unless the recording has ended."""
        writer = self._writer
        if writer is not None and self._guarded(writer.close):
            self._writer, self.is_done = None, True

    def give_up(self, problem: str) -> None:
        """Ends the recording; what is written stays, under the name of a part."""
        if not self.problem:
            rest = f"; what there is stays in {self.path.name}.part" if self.is_open else ""
            self.problem = f"{self.path}: {problem}{rest}"
            _log.warning("the recording ends: %s", self.problem)

    def _begin(self) -> None:
        self._writer = RecordingWriter(self.path, about=self._about)
        self._first(self._writer)
        self.is_open = True

    def _guarded(self, work: Callable[[], None]) -> bool:
        try:
            work()
        except OSError as error:
            self.give_up(error.strerror or str(error))
            writer, self._writer = self._writer, None
            if writer is not None:
                with suppress(OSError):
                    writer.abandon()
            return False
        return True
