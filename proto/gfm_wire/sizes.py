"""How large a body may be: as large as its kind of message ever is, and not as any may be."""

from __future__ import annotations

MAX_BYTES = 64 * 1024 * 1024
"""The largest body of all."""

SMALL_BYTES = 256 * 1024
"""Of a message that names no other limit."""

_MIB = 1024 * 1024
LARGE = {
    "Batch": MAX_BYTES,
    "Weights": MAX_BYTES,
    "Sequence": 16 * _MIB,
    "SampleRequest": 4 * _MIB,
    "RunEnvironment": 4 * _MIB,
    "RobotExchange": 4 * _MIB,
    "RobotStates": 4 * _MIB,
}
"""Limits of the messages that hold long arrays or lists, by name."""


def most_bytes(name: str) -> int:
    """Returns how large a body may be that holds the message of this name."""
    return LARGE.get(name, SMALL_BYTES)
