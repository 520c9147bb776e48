"""Sequences on their way to the replay service: each arrives, however often it must be sent."""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass
from typing import final

from gfm.core import Clock, RefusedError, Sequence, UnreachableError
from gfm.service.ledger import Ledger, NoLedger
from gfm.service.presence import Presence
from gfm.service.refusals import Refusals
from gfm.transport import PendingReply, Transport
from gfm_wire import Message, NotReady, SequenceAck, Stamp

_KEY = "replay/insert"
_PAUSE_NS = 100_000_000
_NOT_READY_NS = 500_000_000

_log = logging.getLogger(__name__)


@dataclass(kw_only=True)
class _Letter:
    """One unacknowledged sequence; `reply` is None while a pause before sending again lasts.

    What one replay answered, refusing or asking to wait, counts where no other one takes it.
    """

    sequence: Sequence
    reply: PendingReply | None
    refusal: str = ""
    wait: str = ""
    resend_ns: int = 0


@final
class Outbox:
    """Sends at least once; the replay service counts each number once.

    Everybody who serves the key is asked: a second one, started by mistake or on purpose, then
    takes nothing away from the first. An acknowledgement counts where it is of what was sent.

    Attributes:
        sent: Sequences handed to the outbox.
        acked: Sequences that have arrived.
        resent: Times that a sequence was sent again.
        refused: Sequences that the replay service did not want.
        replays: How often another replay answered than before: one started anew, or a second one.
        note: Why nothing gets through, in words; empty while it does.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        refusals: Refusals,
        *,
        window: int,
        timeout_s: float,
        ledger: Ledger | None = None,
    ) -> None:
        self.sent = 0
        self.acked = 0
        self.resent = 0
        self.refused = 0
        self.replays = 0
        self.note = ""
        self._transport = transport
        self._refusals = refusals
        self._clock = clock
        self._window = window
        self._timeout_s = timeout_s
        self._ledger = ledger or NoLedger()
        self._replay = Presence("replay", clock)
        self._heard: tuple[str, int] | None = None
        self._letters: deque[_Letter] = deque()

    def __len__(self) -> int:
        return len(self._letters)

    @property
    def waiting(self) -> frozenset[int]:
        """Numbers of the sequences that are not acknowledged."""
        return frozenset(letter.sequence.number for letter in self._letters)

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
        return self._transport.request(_KEY, sequence, timeout_s=self._timeout_s, everybody=True)

    def _is_settled(self, letter: _Letter) -> bool:
        if letter.reply is None:
            self._resend_when_due(letter)
        while letter.reply is not None:
            try:
                answer = letter.reply.poll()
            except UnreachableError as error:
                return self._ends_without(letter, error)
            except RefusedError as error:
                letter.refusal = str(error)
                self._reject(letter)
                continue
            if answer is None:
                return False
            self._replay.heard()
            if self._is_acknowledged(letter, answer, letter.reply.stamp):
                return True
        return False

    def _is_acknowledged(self, letter: _Letter, answer: Message, stamp: Stamp) -> bool:
        sent = letter.sequence
        if isinstance(answer, NotReady):
            letter.wait = answer.reason
            self._reject(letter)
            return False
        if not isinstance(answer, SequenceAck):
            wrong = f"an answer of kind {type(answer).__name__}"
        elif (answer.actor, answer.epoch, answer.number) != (sent.actor, sent.epoch, sent.number):
            wrong = f"an acknowledgement of {answer.number} of {answer.actor!r:.80}"
        elif answer.cursor > self.sent:
            wrong = f"an acknowledgement up to {answer.cursor} where {self.sent} were sent"
        else:
            self._note_replay(stamp)
            self._ledger.note(sent)
            self.acked += 1
            self.note = ""
            return True
        self._refusals.add("answer", stamp.sender, f"{wrong}, for sequence {sent.number}")
        self._reject(letter)
        return False

    def _reject(self, letter: _Letter) -> None:
        if letter.reply is not None:
            letter.reply.reject()

    def _ends_without(self, letter: _Letter, error: UnreachableError) -> bool:
        """Returns whether a letter is settled for which no further answer will come."""
        if letter.wait:
            self.note = f"replay takes nothing now: {letter.wait}"
            self._pause(letter, _NOT_READY_NS)
            return False
        if letter.refusal:
            self._replay.heard()
            self.refused += 1
            self.note = f"replay refused sequence {letter.sequence.number}: {letter.refusal}"
            _log.warning("%s", self.note, extra={"sequence": letter.sequence.number})
            return True
        self._replay.lost(error)
        self.note = f"waiting for replay: {error}"
        self._pause(letter, _PAUSE_NS)
        return False

    def _pause(self, letter: _Letter, pause_ns: int) -> None:
        letter.reply = None
        letter.resend_ns = self._clock.now_ns() + pause_ns

    def _resend_when_due(self, letter: _Letter) -> None:
        if self._clock.now_ns() >= letter.resend_ns:
            letter.reply, letter.refusal, letter.wait = self._ask(letter.sequence), "", ""
            self.resent += 1

    def _note_replay(self, stamp: Stamp) -> None:
        source = stamp.sender, stamp.epoch
        if self._heard not in (None, source):
            self.replays += 1
            if self.replays == 1:
                _log.warning("another replay than before acknowledges: %.64r", stamp.sender)
        self._heard = source
