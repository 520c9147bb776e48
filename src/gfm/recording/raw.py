"""All that an MCAP file holds, message by message as bytes: to count, cut and save it.

Unlike `mcap_file` it takes every topic, decodes none, and goes on behind a damaged chunk.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    Footer,
    Header,
    McapRecord,
    Message,
    Metadata,
    Schema,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer

from gfm.core.checks import Array, Stamps
from gfm.recording.mcap_file import DAMAGE, RECORD_LIMIT_BYTES, opened_mcap
from gfm.recording.schemas import JOINT_STATES

_SECOND_NS = 1_000_000_000
_HEADER_FIRST = (b"std_msgs/Header ", b"std_msgs/msg/Header ")
_STAMP_ENDS = 12
_CHUNK_BYTES = 64 * 1024


@dataclass(kw_only=True)
class RawRecording:
    """The records of one file.

    Attributes:
        profile: Of its header.
        writer: Software that wrote it.
        schemas: By their number.
        channels: By their number.
        messages: In file order.
        metadata: In file order.
        attachments: In file order.
        complete: Whether the closing record was reached, and nothing was damaged before it.
        chunk_s: How long each chunk lasted, by its messages' log times, s.
        damaged_chunks: Chunks that cannot be read.
        lost_bytes: Behind the last record that could be read.
    """

    profile: str = ""
    writer: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: list[Message] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    attachments: list[Attachment] = field(default_factory=list)
    complete: bool = False
    chunk_s: list[float] = field(default_factory=list)
    damaged_chunks: int = 0
    lost_bytes: int = 0

    def by_topic(self) -> dict[str, list[Message]]:
        """Returns the messages of each topic, in file order."""
        topics: dict[str, list[Message]] = {c.topic: [] for c in self.channels.values()}
        for message in self.messages:
            topics[self.channels[message.channel_id].topic].append(message)
        return topics

    def channel_of(self, topic: str) -> Channel:
        """Returns the first channel of a topic that there is."""
        return next(c for c in self.channels.values() if c.topic == topic)

    def is_stamped(self, topic: str) -> bool:
        """Returns whether a topic's messages begin with a header."""
        channel = self.channel_of(topic)
        schema = self.schemas.get(channel.schema_id)
        if schema is None or channel.message_encoding != "cdr" or schema.encoding != "ros2msg":
            return False
        lines = (line.strip() for line in schema.data.splitlines())
        first = next((line for line in lines if line and not line.startswith(b"#")), b"")
        return first.startswith(_HEADER_FIRST)

    def stamps_ns(self, topic: str, messages: Iterable[Message]) -> Stamps:
        """Returns when messages of a topic are stamped: by their header, or as they were logged.

        Shape (messages,).
        """
        if not self.is_stamped(topic):
            return np.array([message.log_time for message in messages], np.int64)
        return np.array([_header_ns(message) for message in messages], np.int64)

    def since_first(self, topic: str, measurements: str = JOINT_STATES) -> Array:
        """Returns when messages of a topic were, in seconds since the first measurement.

        Those without a header are told by when they were logged: that may be another clock.

        Args:
            topic: One that there is.
            measurements: Topic of the measurements; where it has none, the first message counts.

        Returns:
            shape (messages,).
        """
        topics = self.by_topic()
        begins, first = measurements, topics.get(measurements)
        if not first:
            begins, first = self.channels[self.messages[0].channel_id].topic, self.messages
        logged = not (self.is_stamped(topic) and self.is_stamped(begins))
        if logged:
            stamps_ns = np.array([message.log_time for message in topics[topic]], np.int64)
            zero_ns = first[0].log_time
        else:
            stamps_ns = self.stamps_ns(topic, topics[topic])
            zero_ns = self.stamps_ns(begins, first[:1])[0]
        return np.asarray((stamps_ns - zero_ns) * 1e-9)

    def entries(self) -> dict[str, dict[str, str]]:
        """Returns the metadata by record; of two with one name, what the later one says."""
        merged: dict[str, dict[str, str]] = defaultdict(dict)
        for record in self.metadata:
            merged[record.name] |= record.metadata
        return dict(merged)


def read_raw(path: Path) -> RawRecording:
    """Returns what can be read of a file.

    Raises:
        RecordingError: no such file, or not MCAP.
    """
    raw = RawRecording()
    with opened_mcap(path) as stream:
        size, good = path.stat().st_size, 0
        reader = StreamReader(stream, emit_chunks=True, record_size_limit=RECORD_LIMIT_BYTES)
        try:
            for record in reader.records:
                _take(raw, record)
                good = stream.tell()
                if isinstance(record, Footer):
                    raw.complete = not raw.damaged_chunks
                    good = size
                    break
        except DAMAGE:
            raw.complete = False
        raw.lost_bytes = size - good
    # Behind a damaged chunk the closing part of the file may still tell of a channel.
    raw.messages = [m for m in raw.messages if m.channel_id in raw.channels]
    return raw


def write_raw(path: Path, raw: RawRecording, about: Mapping[str, Mapping[str, str]]) -> None:
    """Writes records to a new MCAP file, messages byte by byte as they were.

    Args:
        path: Written over.
        raw: What to write.
        about: Its metadata, by record.
    """
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=_CHUNK_BYTES)
        writer.start(raw.profile, raw.writer)
        for record, entries in about.items():
            writer.add_metadata(record, dict(entries))
        for one in raw.attachments:
            writer.add_attachment(one.create_time, one.log_time, one.name, one.media_type, one.data)
        numbers = _registered(writer, raw)
        for message in raw.messages:
            writer.add_message(
                numbers[message.channel_id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()  # type: ignore[no-untyped-call]


def _registered(writer: Writer, raw: RawRecording) -> dict[int, int]:
    """Registers all channels; returns their new numbers by their old ones."""
    schemas = {
        number: writer.register_schema(schema.name, schema.encoding, schema.data)
        for number, schema in raw.schemas.items()
    }
    return {
        number: writer.register_channel(
            channel.topic,
            channel.message_encoding,
            schemas.get(channel.schema_id, 0),
            channel.metadata,
        )
        for number, channel in raw.channels.items()
    }


def _take(raw: RawRecording, record: McapRecord) -> None:
    match record:
        case Header(profile=profile, library=writer):
            raw.profile, raw.writer = profile, writer
        case Chunk():
            _take_chunk(raw, record)
        case Metadata():
            raw.metadata.append(record)
        case Attachment():
            raw.attachments.append(record)
        case _:
            _take_content(raw, record)


def _take_chunk(raw: RawRecording, chunk: Chunk) -> None:
    try:
        records = breakup_chunk(chunk, validate_crc=True)
    except DAMAGE:
        raw.damaged_chunks += 1
        return
    raw.chunk_s.append((chunk.message_end_time - chunk.message_start_time) * 1e-9)
    for record in records:
        _take_content(raw, record)


def _take_content(raw: RawRecording, record: McapRecord) -> None:
    """Takes what may lie in a chunk."""
    match record:
        case Schema():
            raw.schemas[record.id] = record
        case Channel():
            raw.channels[record.id] = record
        case Message():
            raw.messages.append(record)


def _header_ns(message: Message) -> int:
    """Returns the stamp of a message that begins with a header: cdr puts it behind 4 bytes."""
    if len(message.data) < _STAMP_ENDS:
        return message.log_time
    order = "<" if message.data[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(f"{order}iI", message.data, 4)
    return int(seconds) * _SECOND_NS + int(nanoseconds)
