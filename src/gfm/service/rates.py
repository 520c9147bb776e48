"""How many questions a second each sender may ask."""

from __future__ import annotations

from collections import OrderedDict
from typing import final

from gfm.core import Clock

_SENDERS = 4096
"""Senders that are told apart; of more, those are forgotten first that asked longest ago."""


@final
class Rates:
    """A token bucket for each sender: what it leaves unused it may ask later, a second's worth."""

    def __init__(self, clock: Clock, per_s: float) -> None:
        """Lets each sender ask so often.

        Args:
            clock: Time.
            per_s: Questions a second, at least 1; as many at once.
        """
        self.per_s = per_s
        self._clock = clock
        self._left: OrderedDict[str, tuple[float, int]] = OrderedDict()

    def take(self, sender: str) -> bool:
        """Returns whether a sender may ask one more question now."""
        now_ns = self._clock.now_ns()
        left, then_ns = self._left.pop(sender, (self.per_s, now_ns))
        left = min(left + 1e-9 * (now_ns - then_ns) * self.per_s, self.per_s)
        may = left >= 1.0
        self._left[sender] = (left - may, now_ns)
        if len(self._left) > _SENDERS:
            self._left.popitem(last=False)
        return may
