"""What the bridge did in a period, as messages of a recording: its reasons, and its timing."""

from __future__ import annotations

import math

from gfm.core import Observation, Reason
from gfm.recording.messages import Message, header
from gfm.recording.schemas import HEADER, MessageType

#: Upper ends of the bins in which delays are counted, ms; what took longer is in a last one.
ENDS_MS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
SAFETY_TOPIC, TIMING_TOPIC = "/bridge/safety", "/bridge/timing"

_FLAGS = {str(one.name).lower(): one for one in Reason if one}

#: Why what is in force is not what was asked for: the mask, and each of its bits by its name.
SAFETY = MessageType(
    "gfm_msgs/msg/Safety",
    "std_msgs/Header header\nuint32 reason\n"
    + "".join(f"bool {name}\n" for name in _FLAGS)
    + HEADER,
)
#: The bridge's monotonic clock when it got the report of the header's stamp, and how long the
#: command in force took: NaN where the bridge itself acted, or nothing is in force.
TIMING = MessageType(
    "gfm_msgs/msg/Timing",
    "std_msgs/Header header\nint64 received_ns\nfloat64 heard_to_decided_ms\n"
    f"float64 decided_to_sent_ms\nfloat64 sent_to_received_ms\n{HEADER}",
)


def safety(newest: Observation) -> Message:
    """Returns `SAFETY` of what was in force at a report."""
    flags: Message = {name: bool(newest.reason & one) for name, one in _FLAGS.items()}
    return {"header": header(newest.stamp_ns), "reason": newest.reason, **flags}


def timing(newest: Observation) -> Message:
    """Returns `TIMING` of a report."""
    return {
        "header": header(newest.stamp_ns),
        "received_ns": newest.received_ns,
        "heard_to_decided_ms": _ms(newest.heard_ns, newest.decided_ns),
        "decided_to_sent_ms": _ms(newest.decided_ns, newest.sent_ns),
        "sent_to_received_ms": _ms(newest.sent_ns, newest.received_ns),
    }


def _ms(begin_ns: int, end_ns: int) -> float:
    return (end_ns - begin_ns) * 1e-6 if begin_ns and end_ns else math.nan
