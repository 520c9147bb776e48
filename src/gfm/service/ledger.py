"""Which sequences an actor was told have arrived: its own word, to lay beside what replay keeps.

One file per life of an actor, `NAME.EPOCH.acked`, with a line per sequence: its number and the
checksum of its arrays in hexadecimal. A line is written when the acknowledgement has been heard,
by one call; what a process was writing when it was killed lacks its end of line.
"""

from __future__ import annotations

import logging
import os
import re
from abc import ABC, abstractmethod
from pathlib import Path
from typing import final

from typing_extensions import override

from gfm.core import BadInputError, Sequence

_NAME = re.compile(r"(?P<actor>.+)\.(?P<epoch>\d+)\.acked")

_log = logging.getLogger(__name__)


class Ledger(ABC):
    """Told of every sequence that was acknowledged."""

    @abstractmethod
    def note(self, sequence: Sequence) -> None:
        """Notes one sequence."""


@final
class NoLedger(Ledger):
    """Nobody keeps accounts."""

    @override
    def note(self, sequence: Sequence) -> None:
        pass


@final
class FolderLedger(Ledger):
    """Appends to the file of one life in a folder; where the disk takes nothing, says so once."""

    def __init__(self, folder: Path, actor: str, epoch: int) -> None:
        """Opens the file.

        Raises:
            BadInputError: the folder cannot be made or written to.
        """
        path = folder / f"{actor}.{epoch}.acked"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
        except OSError as exc:
            raise BadInputError(f"ledger {path}: cannot be written: {exc.strerror}") from exc
        self._path = path
        self._failing = False

    @override
    def note(self, sequence: Sequence) -> None:
        line = f"{sequence.number} {sequence.checksum:08x}\n".encode("ascii")
        try:
            os.write(self._file, line)
        except OSError as error:
            if not self._failing:
                _log.error("%s lacks what follows: %s", self._path, error.strerror or error)
            self._failing = True


def make_ledger(folder: str, actor: str, epoch: int) -> Ledger:
    """Returns the ledger that an actor's settings ask for; none where the folder is empty."""
    return FolderLedger(Path(folder), actor, epoch) if folder else NoLedger()


def read_ledgers(folder: Path) -> dict[tuple[str, int], dict[int, int]]:
    """Returns checksums by number of what was acknowledged, by actor and epoch.

    Raises:
        BadInputError: the folder cannot be read, has no ledger, or a line is none.
    """
    try:
        found = {
            (match["actor"], int(match["epoch"])): path.read_text(encoding="ascii")
            for path in sorted(folder.iterdir())
            if (match := _NAME.fullmatch(path.name))
        }
    except (OSError, UnicodeDecodeError) as exc:
        raise BadInputError(f"ledgers {folder}: cannot be read: {exc}") from exc
    if not found:
        raise BadInputError(f"{folder}: has no ledger, expected NAME.EPOCH.acked of actors")
    return {life: _lines(folder, life, text) for life, text in found.items()}


def _lines(folder: Path, life: tuple[str, int], text: str) -> dict[int, int]:
    whole = text[: text.rfind("\n") + 1]
    try:
        pairs = [line.split() for line in whole.splitlines()]
        return {int(number): int(checksum, 16) for number, checksum in pairs}
    except ValueError as exc:
        path = folder / f"{life[0]}.{life[1]}.acked"
        raise BadInputError(f"{path}: {exc}, expected NUMBER CHECKSUM in every line") from exc
