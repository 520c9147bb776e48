"""Questions of one key in turn of who asks: whoever asks much waits behind itself alone."""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import final

from typing_extensions import override

from gfm.service.rates import Rates
from gfm.service.refusals import Refusals
from gfm.transport import Request, Server
from gfm_wire import Message

_READ_AHEAD = 32
"""Questions that are read for each that is handed out: a flood costs no more than that."""

_SENDERS = 4096
"""Senders that are told apart; all further ones wait in one line."""

_OTHERS = "others"

_MOST = 4096
"""Questions in all lines together: beyond that none is read, and the link's own queue gives up the
oldest."""


@final
class Turns(Server):
    """A server whose senders have lines of their own; the front of each is handed out in turn.

    A line is bounded, and so is how often one sender may ask. What comes on top is answered at
    once, and counted under its sender. A name is what a sender says of itself: who goes by many has
    as many turns.
    """

    def __init__(
        self,
        server: Server,
        refusals: Refusals,
        rates: Rates,
        *,
        longest: int,
        busy: Message | None = None,
    ) -> None:
        """Takes over a server.

        Args:
            server: Where questions come from.
            refusals: Told of what is not let into a line.
            rates: How often each sender may ask.
            longest: Questions that one sender may have waiting.
            busy: The answer to what comes on top of that; None refuses it.
        """
        self._server = server
        self._refusals = refusals
        self._rates = rates
        self._longest = longest
        self._busy = busy
        self._lines: OrderedDict[str, deque[Request]] = OrderedDict()
        self._waiting = 0

    @override
    def receive(self) -> Request | None:
        self._read()
        if not self._lines:
            return None
        sender, line = self._lines.popitem(last=False)
        request = line.popleft()
        self._waiting -= 1
        if line:
            self._lines[sender] = line
        return request

    def _read(self) -> None:
        for _ in range(_READ_AHEAD):
            if self._waiting >= _MOST or (request := self._server.receive()) is None:
                return
            self._line_up(request)

    def _line_up(self, request: Request) -> None:
        sender = request.stamp.sender
        if sender not in self._lines and len(self._lines) >= _SENDERS:
            sender = _OTHERS
        if not self._rates.take(sender):
            expected = f"expected at most {self._rates.per_s:g}"
            self._turn_away(request, "rate", f"more questions a second than allowed, {expected}")
            return
        line = self._lines.setdefault(sender, deque())
        if len(line) >= self._longest:
            waiting = f"{len(line)} of its questions wait, expected at most {self._longest}"
            self._turn_away(request, "queue", waiting)
            return
        line.append(request)
        self._waiting += 1

    def _turn_away(self, request: Request, reason: str, detail: str) -> None:
        self._refusals.add(reason, request.stamp.sender, detail)
        if self._busy is None:
            request.refuse(detail)
        else:
            request.reply(self._busy)
