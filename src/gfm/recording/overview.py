"""What is in a recording: topics with their rates, joints, metadata; nothing is judged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Message
from mcap_ros2.decoder import DecoderFactory

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.recording import schemas
from gfm.recording.mcap_file import DAMAGE
from gfm.recording.punctuality import Delays, punctuality
from gfm.recording.raw import RawRecording, read_raw

#: A period so many times the median is a gap, and says nothing of the jitter.
_GAP_PERIODS = 5.0


@dataclass(frozen=True, kw_only=True)
class Rhythm:
    """How regularly messages of a topic come.

    Attributes:
        period_s: Median time from one to the next.
        rate_hz: Messages over the whole time.
        jitter_s: Standard deviation of the period, gaps left out.
        longest_gap_s: Longest time from one to the next.
        backwards: How often one is not later than the one before.
    """

    period_s: float
    rate_hz: float
    jitter_s: float
    longest_gap_s: float
    backwards: int


@dataclass(frozen=True, kw_only=True)
class TopicOverview:
    """One topic.

    Attributes:
        topic: Its name.
        type: Of its messages.
        encoding: Of its messages.
        messages: How many there are.
        stamped_by: header: of each message; log: when the recorder got it.
        begin_s: Of its first message, in seconds since the first measurement; None without one.
        end_s: Of its last message.
        rhythm: None with less than two messages.
        joints: That its first message names, if it is of joints.
        filled: The fields that are filled there.
    """

    topic: str
    type: str
    encoding: str
    messages: int
    stamped_by: str
    begin_s: float | None
    end_s: float | None
    rhythm: Rhythm | None
    joints: tuple[str, ...] = ()
    filled: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Overview:
    """One file.

    Attributes:
        path: As given.
        bytes: Its size.
        profile: Of MCAP.
        writer: Software that wrote it.
        complete: Whether it is whole, and undamaged.
        damaged_chunks: That cannot be read.
        lost_bytes: Behind what can be read.
        begin_ns: Stamp of the first measurement, or of the first message; None without one.
        duration_s: From the first to the last measurement, or message.
        command_kind: What the commands are; None where there are none, or of no one kind.
        topics: By name.
        metadata: By record.
        attachments: Names and sizes in bytes.
        punctuality: Of the bridge, by what was measured; empty where it says nothing of that.
    """

    path: str
    bytes: int
    profile: str
    writer: str
    complete: bool
    damaged_chunks: int
    lost_bytes: int
    begin_ns: int | None
    duration_s: float
    command_kind: str | None
    topics: tuple[TopicOverview, ...]
    metadata: dict[str, dict[str, str]]
    attachments: dict[str, int]
    punctuality: dict[str, Delays]

    @property
    def damage(self) -> str:
        """What cannot be read, in words; empty where the file is whole."""
        if self.complete:
            return ""
        parts = [f"{self.damaged_chunks} damaged chunks"] if self.damaged_chunks else []
        parts += [f"the last {self.lost_bytes} bytes unreadable"] if self.lost_bytes else []
        return f"cut off or damaged: {', '.join(parts) or 'it lacks its closing record'}"

    def as_json(self) -> dict[str, Any]:
        """Returns it as JSON values."""
        return asdict(self)


def overview(
    path: Path, *, joint_states: str = schemas.JOINT_STATES, command: str = schemas.COMMAND
) -> Overview:
    """Returns what is in a file, up to where it can be read.

    Args:
        path: The file.
        joint_states: Topic of the measurements.
        command: Topic of the applied commands.

    Raises:
        RecordingError: no such file, or not MCAP.
    """
    raw = read_raw(path)
    messages = raw.by_topic()
    topics = tuple(_topic(raw, t, listed, joint_states) for t, listed in sorted(messages.items()))
    told = next((one for one in topics if one.topic == command), None)
    measured = next((one for one in topics if one.topic == joint_states and one.messages), None)
    shown = [measured] if measured else [one for one in topics if one.messages]
    first = messages[measured.topic][:1] if measured else raw.messages[:1]
    return Overview(
        path=str(path),
        bytes=path.stat().st_size,
        profile=raw.profile,
        writer=raw.writer,
        complete=raw.complete,
        damaged_chunks=raw.damaged_chunks,
        lost_bytes=raw.lost_bytes,
        begin_ns=int(raw.stamps_ns(shown[0].topic, first)[0]) if first else None,
        duration_s=max((one.end_s or 0.0) - (one.begin_s or 0.0) for one in shown)
        if shown
        else 0.0,
        command_kind=told.filled[0] if told is not None and len(told.filled) == 1 else None,
        topics=topics,
        metadata=raw.entries(),
        attachments={one.name: len(one.data) for one in raw.attachments},
        punctuality=punctuality(raw),
    )


def rhythm(time_s: Array) -> Rhythm | None:
    """Returns how regular times are, s, shape (messages,); None where there are less than two."""
    if len(time_s) < 2:
        return None
    periods = np.diff(time_s)
    median, span = float(np.median(periods)), float(np.ptp(time_s))
    regular = periods[periods < _GAP_PERIODS * median]
    return Rhythm(
        period_s=median,
        rate_hz=len(periods) / span if span > 0.0 else 0.0,
        jitter_s=float(np.std(regular)) if len(regular) else 0.0,
        longest_gap_s=float(periods.max()),
        backwards=int((periods <= 0.0).sum()),
    )


def _topic(
    raw: RawRecording, topic: str, messages: Sequence[Message], joint_states: str
) -> TopicOverview:
    channel = raw.channel_of(topic)
    schema = raw.schemas.get(channel.schema_id)
    kind = schema.name if schema else "no schema"
    time_s = raw.since_first(topic, joint_states) if messages else np.zeros(0)
    joints, filled = _first_joints(raw, topic, messages)
    return TopicOverview(
        topic=topic,
        type=kind,
        encoding=channel.message_encoding,
        messages=len(messages),
        stamped_by="header" if raw.is_stamped(topic) else "log",
        begin_s=float(time_s[0]) if len(time_s) else None,
        end_s=float(time_s[-1]) if len(time_s) else None,
        rhythm=rhythm(time_s),
        joints=joints,
        filled=filled,
    )


def _first_joints(
    raw: RawRecording, topic: str, messages: Sequence[Message]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Returns the joints that a topic's first message names, and the fields that it fills."""
    channel = raw.channel_of(topic)
    schema = raw.schemas.get(channel.schema_id)
    if not messages or schema is None or schema.name != schemas.JOINT_STATE.name:
        return (), ()
    try:
        decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
        message = None if decode is None else decode(messages[0].data)
    except DAMAGE:
        message = None
    if message is None:
        return (), ()
    filled = tuple(str(kind) for kind in CommandKind if len(getattr(message, kind)))
    return tuple(message.name), filled
