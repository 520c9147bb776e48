"""Asking and waiting, for commands that have nothing else to do meanwhile."""

from __future__ import annotations

from gfm.core import Clock
from gfm.transport.port import Transport
from gfm_wire import Message

_POLL_NS = 200_000


def ask(
    transport: Transport, key: str, message: Message, *, timeout_s: float, clock: Clock
) -> Message:
    """Returns the answer to a question; blocks, which a service must not.

    Raises:
        UnreachableError: nobody answered in time.
        RefusedError: the other side said no.
    """
    pending = transport.request(key, message, timeout_s=timeout_s)
    while (answer := pending.poll()) is None:
        clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
    return answer
