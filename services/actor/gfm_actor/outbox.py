"""Sequences on their way to the replay service: each arrives, however often it must be sent."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from typing import final

from gfm.core import Clock, RefusedError, Sequence, UnreachableError
from gfm.service.presence import Presence
from gfm.transport import PendingReply, Transport
from gfm_wire import SequenceAck

_KEY = "replay/insert"
_PAUSE_NS = 100_000_000

_log = logging.getLogger(__name__)


@dataclass(kw_only=True)
class _Letter:
    """One unacknowledged sequence; `reply` is None while a pause before sending again lasts."""

    sequence: Sequence
    reply: PendingReply | None
    resend_ns: int = 0


@final
class Outbox:
    """Sends at least once; the replay service counts each number once.

    Attributes:
        sent: Sequences handed to the outbox.
        acked: Sequences that have arrived.
        resent: Times that a sequence was sent again.
        refused: Sequences that the replay service did not want.
        note: Why nothing gets through, in words; empty while it does.
    """

    def __init__(
        self, transport: Transport, clock: Clock, *, window: int, timeout_s: float
    ) -> None:
        self.sent = 0
        self.acked = 0
        self.resent = 0
        self.refused = 0
        self.note = ""
        self._transport = transport
        self._clock = clock
        self._window = window
        self._timeout_s = timeout_s
        self._replay = Presence("replay", clock)
        self._letters: deque[_Letter] = deque()

    def __len__(self) -> int:
        return len(self._letters)

    def has_room(self, count: int) -> bool:
        """Returns whether `count` more sequences fit into the window."""
        return len(self._letters) + count <= self._window

    def send(self, sequence: Sequence) -> None:
        """Sends a sequence, and again until it is acknowledged or refused."""
        self._letters.append(_Letter(sequence=sequence, reply=self._ask(sequence)))
        self.sent += 1

    def poll(self) -> None:
        """Takes in the answers that have come, and sends again what got none."""
        self._letters = deque(letter for letter in self._letters if not self._is_settled(letter))

    def _ask(self, sequence: Sequence) -> PendingReply:
        return self._transport.request(_KEY, sequence, timeout_s=self._timeout_s)

    def _is_settled(self, letter: _Letter) -> bool:
        if letter.reply is None:
            self._resend_when_due(letter)
            return False
        try:
            answer = letter.reply.poll()
        except UnreachableError as error:
            self._replay.lost(error)
            self.note = f"waiting for replay: {error}"
            letter.reply = None
            letter.resend_ns = self._clock.now_ns() + _PAUSE_NS
            return False
        except RefusedError as error:
            self._replay.heard()
            self._note_refusal(letter.sequence, str(error))
            return True
        if answer is None:
            return False
        self._replay.heard()
        if isinstance(answer, SequenceAck):
            self.acked += 1
            self.note = ""
        else:
            self._note_refusal(letter.sequence, f"the answer was {type(answer).__name__}")
        return True

    def _resend_when_due(self, letter: _Letter) -> None:
        if self._clock.now_ns() >= letter.resend_ns:
            letter.reply = self._ask(letter.sequence)
            self.resent += 1

    def _note_refusal(self, sequence: Sequence, reason: str) -> None:
        self.refused += 1
        self.note = f"replay refused sequence {sequence.number}: {reason}"
        _log.warning("%s", self.note)
