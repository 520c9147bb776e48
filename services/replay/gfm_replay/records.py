"""What a journal's file holds, as bytes: a header, two states, and a record per sequence.

Everything carries a checksum: what a process was writing when it ended is told from what is whole.

Shape letters: T transitions, O observation size, A action size.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from gfm.core import EnvironmentSpec, Sequence
from gfm_replay.arrivals import Life

FORMAT = "gfm.replay/2"
HEADER_BYTES = 4096
STATE_BYTES = 2048
_CHECK_BYTES = 8


@dataclass(frozen=True, kw_only=True)
class Layout:
    """What a file is for.

    Attributes:
        spec: Of the environment that all sequences are of.
        steps: T.
        capacity: Sequences that are kept; there is one slot more, so that the one that is being
            written takes the place of none that counts.
    """

    spec: EnvironmentSpec
    steps: int
    capacity: int

    @property
    def slots(self) -> int:
        """Records that fit."""
        return self.capacity + 1

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of one record; the life's floor and cursor are those before this sequence."""
        spec, steps, number = self.spec, self.steps, "<i8"
        return np.dtype(
            [
                *((name, number) for name in ("index", "epoch", "number", "floor", "cursor")),
                *((name, number) for name in ("weights_life", "weights_version")),
                ("actor", "S64"),
                ("observation", "<f4", (steps + 1, spec.observation_size)),
                ("action", "<f4", (steps, spec.action_size)),
                *((name, "<f4", (steps,)) for name in ("reward", "discount", "log_prob")),
                ("check", "<u4"),
            ]
        )

    @property
    def first_record(self) -> int:
        """Where the records begin in the file, bytes."""
        return HEADER_BYTES + 2 * STATE_BYTES

    @property
    def total_bytes(self) -> int:
        """Of the whole file."""
        return self.first_record + self.slots * self.dtype.itemsize

    def offset(self, index: int) -> int:
        """Returns where the record of the sequence `index` is, bytes."""
        return self.first_record + index % self.slots * self.dtype.itemsize


def encode_record(layout: Layout, index: int, sequence: Sequence, life: Life) -> bytes:
    """Returns the record of the sequence that is the `index`-th; the first is 1."""
    record = np.zeros((), layout.dtype)
    for name in layout.dtype.names or ():
        if hasattr(sequence, name):
            record[name] = getattr(sequence, name)
    record["index"], record["floor"], record["cursor"] = index, life.floor, life.cursor
    body = record.tobytes()[:-4]
    return body + zlib.crc32(body).to_bytes(4, "little")


def is_whole(record: bytes) -> bool:
    """Returns whether a record is as it was written."""
    return zlib.crc32(record[:-4]) == int.from_bytes(record[-4:], "little")


def encode_header(layout: Layout) -> bytes:
    """Returns the first bytes of a file."""
    meta = {
        "format": FORMAT,
        "spec": asdict(layout.spec),
        "steps": layout.steps,
        "capacity": layout.capacity,
    }
    return encode_json(meta, HEADER_BYTES)


def decode_header(body: bytes) -> Layout:
    """Returns what a file is for.

    Raises:
        ValueError, KeyError, TypeError: it is damaged, or of another format.
    """
    meta = decode_json(body)
    if meta is None:
        raise ValueError("the header is damaged, or that of something else")
    if meta["format"] != FORMAT:
        raise ValueError(f"format is {meta['format']!r}, expected {FORMAT!r}")
    spec = EnvironmentSpec(**meta["spec"])
    return Layout(spec=spec, steps=int(meta["steps"]), capacity=int(meta["capacity"]))


def encode_json(value: Mapping[str, object], size: int) -> bytes:
    """Returns JSON behind its checksum, filled up with blanks."""
    text = json.dumps(value).encode().ljust(size - _CHECK_BYTES)
    return f"{zlib.crc32(text):08x}".encode() + text


def decode_json(body: bytes) -> dict[str, Any] | None:
    """Returns the map, or None where the checksum is not that of the text."""
    check, text = body[:_CHECK_BYTES], body[_CHECK_BYTES:]
    if f"{zlib.crc32(text):08x}".encode() != check:
        return None
    value: dict[str, Any] = json.loads(text)
    return value
