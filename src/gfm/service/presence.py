"""Whether somebody answers: one line in the log when they go, and one when they are back."""

from __future__ import annotations

import logging
from typing import final

from gfm.core import Clock

_log = logging.getLogger(__name__)


@final
class Presence:
    """One peer, as its asker sees it."""

    def __init__(self, peer: str, clock: Clock) -> None:
        self._peer = peer
        self._clock = clock
        self._lost_ns: int | None = None

    def lost(self, reason: object) -> None:
        """Notes that a question was not answered."""
        if self._lost_ns is None:
            self._lost_ns = self._clock.now_ns()
            _log.warning("%s does not answer, asking on: %s", self._peer, reason)

    def heard(self) -> None:
        """Notes a sign of life."""
        if self._lost_ns is not None:
            away_s = (self._clock.now_ns() - self._lost_ns) * 1e-9
            self._lost_ns = None
            _log.info("%s answers again, after %.1f s", self._peer, away_s)
