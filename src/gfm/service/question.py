"""A question that is asked until it is answered, without waiting for the answer."""

from __future__ import annotations

from typing import final

from gfm.core import Clock, RefusedError, UnreachableError
from gfm.service.presence import Presence
from gfm.transport import PendingReply, Transport
from gfm_wire import Message, Stamp

_TIMEOUT_S = 2.0
_PAUSE_NS = 200_000_000


@final
class Question:
    """One question to one peer; between two times that it is asked lies a pause."""

    def __init__(self, transport: Transport, clock: Clock, key: str, peer: str) -> None:
        self._transport = transport
        self._clock = clock
        self._key = key
        self._presence = Presence(peer, clock)
        self._pending: PendingReply | None = None
        self._ask_ns = clock.now_ns()

    @property
    def is_under_way(self) -> bool:
        """Whether an answer is waited for."""
        return self._pending is not None

    def poll(self, message: Message) -> tuple[Message, Stamp] | None:
        """Returns an answer and who gave it, or None; asks where nothing is under way.

        Raises:
            RefusedError: the other side said no.
        """
        if self._pending is None:
            if self._clock.now_ns() < self._ask_ns:
                return None
            self._pending = self._transport.request(self._key, message, timeout_s=_TIMEOUT_S)
        pending = self._pending
        try:
            answer = pending.poll()
        except UnreachableError as error:
            self._presence.lost(error)
            self._end()
            return None
        except RefusedError:
            self._presence.heard()
            self._end()
            raise
        if answer is None:
            return None
        self._presence.heard()
        self._end()
        return answer, pending.stamp

    def _end(self) -> None:
        self._pending = None
        self._ask_ns = self._clock.now_ns() + _PAUSE_NS
