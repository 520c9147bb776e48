"""What is readable of a recording that was cut off or damaged, as a recording of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gfm.core import RecordingError
from gfm.recording import schemas
from gfm.recording.new_file import new_file
from gfm.recording.raw import RawRecording, read_raw, write_raw

#: Keys of the metadata that say where a recording was saved from, and what was lost.
SALVAGED_FROM, LOST = "salvaged_from", "salvaged_without"


@dataclass(frozen=True, kw_only=True)
class Salvaged:
    """What was saved of a file.

    Attributes:
        measurements: Messages of joint states.
        duration_s: From the first of them to the last.
        messages: Of all topics.
        damaged_chunks: That could not be read.
        lost_bytes: Behind what could be read.
        unpaired: Commands told or asked for whose other half is lost; they are left out.
        chunk_s: How long a chunk lasts, the median, s: as much again a killed writer may have had
            in its memory. None where there is no chunk.
    """

    measurements: int
    duration_s: float
    messages: int
    damaged_chunks: int
    lost_bytes: int
    unpaired: int
    chunk_s: float | None

    @property
    def lost(self) -> str:
        """What was lost, in words."""
        parts = []
        if self.damaged_chunks:
            parts.append(f"{self.damaged_chunks} damaged chunks")
        if self.lost_bytes:
            parts.append(f"the last {self.lost_bytes} bytes")
        if self.unpaired:
            parts.append(f"{self.unpaired} halves of commands")
        return ", ".join(parts) or "nothing that is in the file"


def salvage(path: Path, out: Path) -> Salvaged:
    """Writes what is readable of a file to a new one; the old one stays as it is.

    Raises:
        RecordingError: the file is not MCAP, or whole, or nothing of it is readable.
        BadInputError: `out` exists, or cannot be written.
    """
    raw = read_raw(path)
    # A part may be whole: what records may end between the last byte and the name.
    if raw.complete and path.suffix != ".part":
        raise RecordingError(str(path), "is whole", "a file that was cut off or damaged")
    saved = _paired(raw)
    told = _salvaged(raw, saved)
    if not told.measurements:
        problem = f"nothing is readable on {schemas.JOINT_STATES}"
        raise RecordingError(str(path), problem, "at least one measurement")
    about = raw.entries()
    ours = about.setdefault(schemas.ABOUT_RECORD, {})
    ours |= {SALVAGED_FROM: path.name, LOST: told.lost}
    with new_file(out) as place:
        write_raw(place, saved, about)
    return told


def _paired(raw: RawRecording) -> RawRecording:
    """Returns a recording without commands of which only one half is there.

    A cut may fall between what was applied and what was asked for; both have the same stamp.
    """
    topics = raw.by_topic()
    twins = [topics.get(topic, []) for topic in (schemas.COMMAND, schemas.REQUESTED)]
    if not twins[1]:
        return raw
    stamps = [raw.stamps_ns(schemas.COMMAND, listed).tolist() for listed in twins]
    alone = set(stamps[0]) ^ set(stamps[1])
    left_out = {
        id(message)
        for listed, times in zip(twins, stamps, strict=True)
        for message, stamp_ns in zip(listed, times, strict=True)
        if stamp_ns in alone
    }
    return replace(raw, messages=[m for m in raw.messages if id(m) not in left_out])


def _salvaged(raw: RawRecording, saved: RawRecording) -> Salvaged:
    topics = saved.by_topic()
    measured = schemas.JOINT_STATES
    times_s = saved.since_first(measured) if topics.get(measured) else np.zeros(1)
    return Salvaged(
        measurements=len(topics.get(measured, [])),
        duration_s=float(np.ptp(times_s)),
        messages=len(saved.messages),
        damaged_chunks=raw.damaged_chunks,
        lost_bytes=raw.lost_bytes,
        unpaired=len(raw.messages) - len(saved.messages),
        chunk_s=float(np.median(raw.chunk_s)) if raw.chunk_s else None,
    )
