"""What every adapter does alike: stamp and encode, decode and count what is refused."""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from typing import final

from gfm.core import RefusedError, WireError
from gfm_wire import Message, Refusal, Stamp, decode_stamped, encode, largest_body

QUEUED_REQUESTS = 1024
"""Questions that wait at one server; beyond that the oldest one is given up."""

LONGEST_REASON = 1000
"""Characters of a refusal that are sent."""

_log = logging.getLogger(__name__)


@final
class Bodies:
    """Encodes and decodes for one connection.

    Attributes:
        rejected: Bodies that were refused so far, by reason.
    """

    def __init__(self, sender: str, epoch: int) -> None:
        self.rejected: dict[str, int] = defaultdict(int)
        self._sender = sender
        self._epoch = epoch
        self._sent: Counter[str] = Counter()

    def encode(self, key: str, message: Message) -> bytes:
        """Returns the body of a message, stamped with sender, epoch and number under `key`."""
        stamp = Stamp(sender=self._sender, epoch=self._epoch, number=self._sent[key])
        body = encode(message, stamp)
        self._sent[key] += 1
        return body

    def decode_stamped(self, key: str, body: bytes) -> tuple[Message, Stamp]:
        """Returns the message of a body and who sent it, or counts it and raises the WireError."""
        try:
            return decode_stamped(body, max_bytes=largest_body(key))
        except WireError as error:
            self._count(key, error)
            raise

    def _count(self, key: str, error: WireError) -> None:
        self.rejected[error.reason] += 1
        count = self.rejected[error.reason]
        if count == 10 ** (len(str(count)) - 1):  # 1, 10, 100 ...: a flood must not fill the log
            _log.warning("refused a body under %s (%d so far): %s", key, count, error)

    def answer(self, key: str, body: bytes) -> tuple[Message, Stamp]:
        """Returns the answer in a body and who sent it.

        Raises:
            RefusedError: it is a refusal, or cannot be understood.
        """
        try:
            message, stamp = self.decode_stamped(key, body)
        except WireError as exc:
            raise RefusedError(f"the answer under {key} cannot be understood: {exc}") from exc
        if isinstance(message, Refusal):
            raise RefusedError(message.reason)
        return message, stamp
