"""Reads the messages of an MCAP file, topic by topic, in the order in which they lie there."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, final

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap_ros2.decoder import DecoderFactory

from gfm.core import RecordingError

_MAGIC = b"\x89MCAP0\r\n"
#: No recording of joints has a record of this size: a longer one is damage.
RECORD_LIMIT_BYTES = 256 * 2**20
#: What reading damaged bytes raises besides McapError.
DAMAGE = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    LookupError,
    MemoryError,
)


@dataclass(kw_only=True)
class McapContent:
    """The messages of the topics that were asked for, and what the file says about itself.

    Attributes:
        topics: Type of every topic in the file, by name.
        messages: Decoded messages of the topics that were asked for, in file order.
        metadata: MCAP metadata records by name.
        complete: False where the file ends, or is damaged, before MCAP's closing record.
    """

    topics: dict[str, str] = field(default_factory=dict)
    messages: dict[str, list[Any]] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    complete: bool = False


def read_mcap(path: Path, types: Mapping[str, str]) -> McapContent:
    """Returns the messages of some topics, up to where the file ends or is damaged.

    Args:
        path: The file.
        types: The message type that is expected, by topic; other topics are not decoded.

    Raises:
        RecordingError: no such file, not MCAP, a topic of another type, a message that is none.
    """
    collector = _Collector(path, types)
    with opened_mcap(path) as stream:
        records = StreamReader(
            stream, validate_crcs=True, record_size_limit=RECORD_LIMIT_BYTES
        ).records
        try:
            for record in records:
                collector.take(record)
                if isinstance(record, Footer):
                    collector.content.complete = True
                    break
        except DAMAGE:
            collector.content.complete = False
    return collector.content


def opened_mcap(path: Path) -> BinaryIO:
    """Returns a file that begins as MCAP does, at its beginning.

    Raises:
        RecordingError: no such file, or not MCAP.
    """
    try:
        stream = path.open("rb")
        start = stream.read(len(_MAGIC))
    except FileNotFoundError as exc:
        raise RecordingError(str(path), "no such file", "an MCAP recording") from exc
    except OSError as exc:
        expected = "an MCAP recording (other formats: `gfm import`)"
        raise RecordingError(str(path), exc.strerror or str(exc), expected) from exc
    if start != _MAGIC:
        stream.close()
        expected = f"the MCAP signature {_MAGIC!r} (other formats: `gfm import`)"
        raise RecordingError(str(path), f"not an MCAP file, begins with {start!r}", expected)
    stream.seek(0)
    return stream


@final
class _Collector:
    """Sorts the records of one file; decodes what was asked for."""

    def __init__(self, path: Path, types: Mapping[str, str]) -> None:
        self.content = McapContent()
        self._path = path
        self._types = types
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._decoders: dict[int, Callable[[bytes], Any]] = {}

    def take(self, record: McapRecord) -> None:
        """Takes the next record."""
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._take_channel(record)
        elif isinstance(record, Message):
            self._take_message(record)
        elif isinstance(record, Metadata):
            self.content.metadata.setdefault(record.name, {}).update(record.metadata)

    def _take_channel(self, channel: Channel) -> None:
        schema = self._schemas.get(channel.schema_id)
        self._channels[channel.id] = channel
        self.content.topics[channel.topic] = schema.name if schema else "no schema"
        expected = self._types.get(channel.topic)
        if expected is None or channel.id in self._decoders:
            return
        decoder = DecoderFactory().decoder_for(channel.message_encoding, schema)
        if schema is None or schema.name != expected or decoder is None:
            got = f"{self.content.topics[channel.topic]} in {channel.message_encoding!r}"
            where = f"{self._path}: topic {channel.topic}"
            wanted = f"{expected} in 'cdr' with a ros2msg schema (other types: `gfm import`)"
            raise RecordingError(where, f"is {got}", wanted)
        self._decoders[channel.id] = decoder
        self.content.messages.setdefault(channel.topic, [])

    def _take_message(self, message: Message) -> None:
        decoder = self._decoders.get(message.channel_id)
        if decoder is None:
            return
        topic = self._channels[message.channel_id].topic
        messages = self.content.messages[topic]
        try:
            messages.append(decoder(message.data))
        except DAMAGE as exc:
            where = f"{self._path}: topic {topic}: message {len(messages)}"
            raise RecordingError(where, f"cannot be decoded ({exc})", "a cdr message") from exc
