"""Sequences on disk: what was acknowledged is there after any end of the process, once each.

One file, whose space is reserved when it is made: a full disk is met there and nowhere else. A
sequence and its place in the life of its actor are one record, written by one call before the
acknowledgement; there is no second file that could say otherwise. The file is never mapped into
memory: where a mapping has no room left, the process dies.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from gfm.core import BadInputError, Sequence
from gfm_replay.arrivals import Life
from gfm_replay.records import (
    HEADER_BYTES,
    STATE_BYTES,
    Layout,
    decode_header,
    decode_json,
    encode_header,
    encode_json,
    encode_record,
    is_whole,
)

NAME = "sequences.ring"
_CHUNK = 256

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Kept:
    """What a journal holds.

    Attributes:
        layout: What it is for.
        records: The whole ones, oldest first, at most as many as its capacity.
        sampled: Sequences handed out so far.
        random: State of the random numbers; None where it was never written.
    """

    layout: Layout
    records: NDArray[Any]
    sampled: int
    random: dict[str, Any] | None

    def lives(self) -> Iterator[tuple[str, int, Life]]:
        """Yields actor, epoch and life of all that the records are of, last heard of last."""
        names = ("actor", "epoch", "number", "floor", "cursor")
        columns = zip(*(self.records[name].tolist() for name in names), strict=True)
        known: dict[tuple[bytes, int], tuple[list[int], int, int]] = {}
        for actor, epoch, number, floor, cursor in columns:
            numbers, _, _ = known.pop((actor, epoch), ([], 0, 0))
            numbers.append(number)
            known[actor, epoch] = numbers, floor, cursor
        for (actor, epoch), (numbers, floor, cursor) in known.items():
            life = Life(floor, cursor, (number for number in numbers[:-1] if number >= cursor))
            life.add(numbers[-1])
            yield actor.decode(), epoch, life


@final
class Journal:
    """The file of one replay service, which alone may have it open.

    Attributes:
        folder: Where it is.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._file: int | None = None
        self._layout: Layout | None = None
        self._generation = 0

    def open(self) -> Kept | None:
        """Returns what is kept; None where there is no file yet.

        Raises:
            BadInputError: the file is no journal, has lost its end, or is in use.
        """
        path = self.folder / NAME
        if not path.exists():
            return None
        self._file = self._locked(path)
        try:
            return self._read(self._file)
        except (OSError, ValueError, KeyError, TypeError) as exc:
            self.close()
            raise BadInputError(f"{path}: damaged replay: {exc}") from exc

    def _read(self, file: int) -> Kept:
        self._layout = layout = decode_header(os.pread(file, HEADER_BYTES, 0))
        if (size := os.fstat(file).st_size) != layout.total_bytes:
            raise ValueError(f"{size} bytes, expected {layout.total_bytes}")
        state = self._newest_state()
        return Kept(
            layout=layout,
            records=self._records(layout),
            sampled=int(state.get("sampled", 0)),
            random=state.get("random"),
        )

    def make(self, layout: Layout) -> None:
        """Makes the file, all of it or nothing.

        Raises:
            OSError: there is no room for it, or no way to write there.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        if (free := shutil.disk_usage(self.folder).free) < layout.total_bytes:
            wanted = f"{free / 2**20:.0f} of {layout.total_bytes / 2**20:.0f} MiB are free"
            raise OSError(errno.ENOSPC, wanted, str(self.folder))
        partial = self.folder / f".{NAME}.{os.getpid()}.partial"
        try:
            file = self._locked(partial, os.O_CREAT | os.O_TRUNC)
            try:
                os.posix_fallocate(file, 0, layout.total_bytes)
                _write(file, encode_header(layout), 0)
                os.fsync(file)
                partial.replace(self.folder / NAME)
            except BaseException:
                os.close(file)
                raise
        finally:
            partial.unlink(missing_ok=True)
        self._file, self._layout = file, layout

    def append(self, index: int, sequence: Sequence, life: Life) -> None:
        """Writes the `index`-th sequence, over the oldest where the ring is full; the first is 1.

        Args:
            index: Counts all sequences that were ever stored.
            sequence: Of the layout's shapes.
            life: That it belongs to, before it is added.

        Raises:
            OSError: it could not be written; it does not count then.
        """
        file, layout = self._opened()
        _write(file, encode_record(layout, index, sequence, life), layout.offset(index))

    def note(self, sampled: int, rng: np.random.Generator) -> None:
        """Writes how many sequences were handed out, and where chance stands.

        The last two states are kept: one of them is always whole.

        Raises:
            OSError: it could not be written.
        """
        file, _ = self._opened()
        generation = self._generation + 1
        state = {"generation": generation, "sampled": sampled, "random": rng.bit_generator.state}
        place = HEADER_BYTES + generation % 2 * STATE_BYTES
        _write(file, encode_json(state, STATE_BYTES), place)
        self._generation = generation

    def close(self) -> None:
        """Puts everything on the disk and lets another process have the file."""
        if self._file is not None:
            os.fsync(self._file)
            os.close(self._file)
            self._file = None

    def _opened(self) -> tuple[int, Layout]:
        if self._file is None or self._layout is None:
            raise RuntimeError("the journal is not open")
        return self._file, self._layout

    def _locked(self, path: Path, flags: int = 0) -> int:
        try:
            file = os.open(path, os.O_RDWR | os.O_CLOEXEC | flags, 0o644)
        except PermissionError as exc:
            raise BadInputError(f"{path}: cannot be written: {exc.strerror}") from exc
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as exc:
            os.close(file)
            raise BadInputError(f"{path}: another replay service has it open") from exc
        return file

    def _newest_state(self) -> dict[str, Any]:
        file, _ = self._opened()
        places = (HEADER_BYTES, HEADER_BYTES + STATE_BYTES)
        bodies = [os.pread(file, STATE_BYTES, place) for place in places]
        states = [state for body in bodies if (state := decode_json(body)) is not None]
        written = sum(any(body) for body in bodies)
        if written > len(states):
            _log.warning("%s: a state is damaged, going on from the one before", self.folder)
        newest: dict[str, Any] = max(states, key=lambda s: s["generation"], default={})
        self._generation = int(newest.get("generation", 0))
        return newest

    def _records(self, layout: Layout) -> NDArray[Any]:
        """Returns the whole records, oldest first."""
        whole, damaged = [], 0
        for some, raw in self._chunks(layout):
            size = layout.dtype.itemsize
            used = np.flatnonzero(some["index"] > 0)
            good = [i for i in used if is_whole(raw[i * size : (i + 1) * size])]
            damaged += len(used) - len(good)
            whole.append(some[good])
        if damaged:
            _log.warning(
                "%s: %d of %d records are damaged and left out",
                *(self.folder, damaged, damaged + sum(map(len, whole))),
            )
        records: NDArray[Any] = np.concatenate(whole)
        records = records[np.argsort(records["index"])]
        newest: NDArray[Any] = records[
            records["index"] > records["index"].max(initial=0) - layout.capacity
        ]
        return newest

    def _chunks(self, layout: Layout) -> Iterator[tuple[NDArray[Any], bytes]]:
        file, _ = self._opened()
        size = layout.dtype.itemsize
        for start in range(0, layout.slots, _CHUNK):
            count = min(_CHUNK, layout.slots - start)
            raw = os.pread(file, count * size, layout.first_record + start * size)
            yield np.frombuffer(raw, layout.dtype), raw


def _write(file: int, body: bytes, place: int) -> None:
    if (written := os.pwrite(file, body, place)) != len(body):
        raise OSError(errno.ENOSPC, f"{written} of {len(body)} bytes could be written")
