"""How punctual a bridge was, by what it recorded of itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap_ros2.decoder import DecoderFactory

from gfm.core.checks import Array
from gfm.recording.mcap_file import DAMAGE
from gfm.recording.periods import ENDS_MS, TIMING, TIMING_TOPIC
from gfm.recording.raw import RawRecording

#: What `punctuality` returns, by its names.
MEANINGS = {
    "heard_to_sent": "from a command heard to sent",
    "uneven": "reports off their median period",
}


@dataclass(frozen=True, kw_only=True)
class Delays:
    """How often something took how long.

    Attributes:
        count: How often it was measured.
        median_ms: Half of them took no longer.
        p99_ms: 99 % of them took no longer.
        most_ms: The longest.
        bins: How many took more than the end before and at most this one, by their ends in ms;
            the last by "over" the last end.
    """

    count: int
    median_ms: float
    p99_ms: float
    most_ms: float
    bins: dict[str, int]


def punctuality(raw: RawRecording) -> dict[str, Delays]:
    """Returns delays by their names; nothing of a recording without `/bridge/timing`.

    heard_to_sent: from when the bridge took the command in force until it told the robot.
    uneven: by how much the time between two reports differs from the median, on its clock.
    """
    told = _told(raw)
    taken = np.array([one.heard_to_decided_ms + one.decided_to_sent_ms for one in told])
    periods = np.diff([one.received_ns for one in told]) * 1e-6
    values = {
        "heard_to_sent": taken[np.isfinite(taken)],
        "uneven": np.abs(periods - np.median(periods)) if len(periods) else periods,
    }
    return {name: delays(each) for name, each in values.items() if len(each)}


def _told(raw: RawRecording) -> list[Any]:
    """Returns the messages of the topic; none where there are no such ones, or not whole."""
    messages = raw.by_topic().get(TIMING_TOPIC, [])
    channel = raw.channel_of(TIMING_TOPIC) if messages else None
    schema = None if channel is None else raw.schemas.get(channel.schema_id)
    if channel is None or schema is None or schema.name != TIMING.name:
        return []
    try:
        decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
        return [] if decode is None else [decode(message.data) for message in messages]
    except DAMAGE:
        return []


def delays(values_ms: Array) -> Delays:
    """Returns how often values are how large.

    Args:
        values_ms: At least one, shape (N,).
    """
    counts = np.bincount(np.searchsorted(ENDS_MS, values_ms), minlength=len(ENDS_MS) + 1)
    names = [*(f"{end:g}" for end in ENDS_MS), "over"]
    median, p99 = np.quantile(values_ms, (0.5, 0.99))
    return Delays(
        count=len(values_ms),
        median_ms=float(median),
        p99_ms=float(p99),
        most_ms=float(values_ms.max()),
        bins=dict(zip(names, counts.tolist(), strict=True)),
    )
