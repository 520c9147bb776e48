"""What a service refused of messages that were well formed: how often, why, and from whom."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Mapping
from typing import final

_SENDERS = 32
_LONGEST_NAME = 64
_OTHERS = "others"

_log = logging.getLogger(__name__)


@final
class Refusals:
    """Counts refused messages; says the first, the tenth, the hundredth ... of a reason in the log.

    Attributes:
        total: All of them.
        note: The last one, in words; empty before the first.
    """

    def __init__(self) -> None:
        self.total = 0
        self.note = ""
        self._reasons: Counter[str] = Counter()
        self._senders: Counter[str] = Counter()

    def add(self, reason: str, sender: str, detail: str) -> None:
        """Counts one message.

        Args:
            reason: One word under which it is counted.
            sender: Who sent it, as it says itself.
            detail: What was wrong with it.
        """
        name = self._known(sender)
        self.total += 1
        self._reasons[reason] += 1
        self._senders[name] += 1
        self.note = f"refused a message of {name}: {detail}"
        count = self._reasons[reason]
        if count == 10 ** (len(str(count)) - 1):  # a flood must not fill the log
            about = {"sender": name, "reason": reason}
            _log.warning("%s (%s, %d so far)", self.note, reason, count, extra=about)

    @property
    def counters(self) -> Mapping[str, int]:
        """By reason, by sender, and in all, as a status tells them."""
        return {
            "rejected_messages": self.total,
            **{f"refused_{reason}": count for reason, count in self._reasons.items()},
            **{f"refused_from_{name}": count for name, count in self._senders.items()},
        }

    def _known(self, sender: str) -> str:
        """Returns the name to count under: strangers must not make the status grow."""
        name = re.sub(r"[^A-Za-z0-9._-]", "_", sender[:_LONGEST_NAME]) or "nameless"
        return name if name in self._senders or len(self._senders) < _SENDERS else _OTHERS
