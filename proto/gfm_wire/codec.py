"""Bytes from messages, messages from bytes: one msgpack map, checked to the last field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import msgpack

from gfm.core import WireError
from gfm_wire.kinds import Integer, Reason, Text, wrong_type
from gfm_wire.schema import field_difference
from gfm_wire.schemas import SCHEMAS, Message
from gfm_wire.sizes import MAX_BYTES, most_bytes

MAX_ITEMS = 4096
"""The longest list or map: msgpack reserves memory for a list before it has seen its items."""

_BY_NAME = {schema.name: schema for schema in SCHEMAS}
_BY_TYPE = {schema.value_type: schema for schema in SCHEMAS}
_ENVELOPE = ("schema", "version", "sender", "epoch", "number", "body")


@dataclass(frozen=True, kw_only=True)
class Stamp:
    """Who sent a message, so that gaps show.

    Attributes:
        sender: The sending connection's name.
        epoch: When that connection began, UTC nanoseconds: tells lives of one name apart.
        number: Counts the sender's messages under one key from 0.
    """

    sender: str = ""
    epoch: int = 0
    number: int = 0


UNSTAMPED = Stamp()


def encode(message: Message, stamp: Stamp = UNSTAMPED, *, max_bytes: int = MAX_BYTES) -> bytes:
    """Returns the body of a message.

    Raises:
        WireError: it would be larger than `max_bytes`, or than a message of its kind may be.
        TypeError: there is no schema for this type.
    """
    schema = _BY_TYPE.get(type(message))
    if schema is None:
        raise TypeError(f"{type(message).__name__} is no message; there are: {', '.join(_BY_NAME)}")
    envelope = {
        "schema": schema.name,
        "version": schema.version,
        "sender": stamp.sender,
        "epoch": stamp.epoch,
        "number": stamp.number,
        "body": schema.pack(message),
    }
    body = cast(bytes, msgpack.packb(envelope))
    _check_size(len(body), min(max_bytes, most_bytes(schema.name)))
    return body


def decode(body: bytes, *, max_bytes: int = MAX_BYTES) -> Message:
    """Returns the message of a body; see `decode_stamped`."""
    return decode_stamped(body, max_bytes=max_bytes)[0]


def decode_stamped(body: bytes, *, max_bytes: int = MAX_BYTES) -> tuple[Message, Stamp]:
    """Returns the message of a body, and who sent it.

    Raises:
        WireError: and nothing else, whatever the bytes are.
    """
    _check_size(len(body), max_bytes)
    envelope = _unpacked(body)
    if not isinstance(envelope, dict):
        raise wrong_type("the body", envelope, "a map")
    if envelope.keys() != set(_ENVELOPE):
        difference = field_difference(envelope, dict.fromkeys(_ENVELOPE))
        raise WireError(Reason.FIELDS, f"the envelope {difference}")
    stamp = Stamp(
        sender=Text().unpack(envelope["sender"], "sender"),
        epoch=Integer(least=0).unpack(envelope["epoch"], "epoch"),
        number=Integer(least=0).unpack(envelope["number"], "number"),
    )
    return _message(envelope, len(body)), stamp


def _message(envelope: dict[str, Any], size: int) -> Message:
    name, version = envelope["schema"], envelope["version"]
    schema = _BY_NAME.get(name) if isinstance(name, str) else None
    if schema is None:
        raise WireError(Reason.SCHEMA, f"{name!r:.40} is not one of {', '.join(_BY_NAME)}")
    if type(version) is not int or version != schema.version:
        raise WireError(
            Reason.VERSION, f"{name} is of version {version!r:.40}, expected {schema.version}"
        )
    _check_size(size, most_bytes(schema.name))
    return cast(Message, schema.unpack(envelope["body"], schema.name))


def _unpacked(body: bytes) -> object:
    try:
        return msgpack.unpackb(body, max_array_len=MAX_ITEMS, max_map_len=MAX_ITEMS)
    except msgpack.StackError as exc:
        raise WireError(Reason.TOO_DEEP, "the body is nested too deeply") from exc
    except (ValueError, msgpack.UnpackException) as exc:
        raise WireError(Reason.NOT_MSGPACK, str(exc) or type(exc).__name__) from exc


def _check_size(size: int, max_bytes: int) -> None:
    if size > max_bytes:
        raise WireError(Reason.TOO_LARGE, f"{size} bytes, limit {max_bytes}")
