"""Hears a bridge and tells viewers, for as long as somebody watches."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import final

from gfm.core import BadInputError, Clock, Observation
from gfm.live.retelling import Retelling
from gfm.live.viewer import Viewer
from gfm.transport import Transport
from gfm_wire import Stamp

_log = logging.getLogger(__name__)

KEY = "robot/observation"
#: Periods that wait here while viewers are told; the oldest are dropped.
KEEP = 256
_NAP_NS = 5_000_000
_TELL_NS = 10_000_000_000
_SILENT_NS = 2_000_000_000


@dataclass(kw_only=True)
class Heard:
    """How much was heard.

    Attributes:
        periods: That were told to viewers.
        lost: Published and not heard: this process or its network was too slow.
    """

    periods: int = 0
    lost: int = 0


@final
class Watching:
    """Tells viewers what a bridge publishes. The bridge notices nothing of it.

    Args:
        transport: Of a watcher.
        viewers: To be told.
        clock: To wait by.

    Attributes:
        heard: How much.
    """

    def __init__(self, transport: Transport, viewers: Sequence[Viewer], clock: Clock) -> None:
        self.heard = Heard()
        self._subscription = transport.subscribe(KEY, keep=KEEP)
        self._viewers = viewers
        self._retellings = [Retelling(viewer) for viewer in viewers]
        self._clock = clock
        self._last: Stamp | None = None
        self._heard_ns = self._told_ns = clock.now_ns()
        self._silent = False
        self._told_lost = 0

    def turn(self) -> bool:
        """Tells viewers what waits; returns whether anything did."""
        found = False
        for _ in range(KEEP):
            if (message := self._subscription.take()) is None:
                break
            if isinstance(message, Observation):
                self._note(self._subscription.stamp)
                for retelling in self._retellings:
                    retelling.take(message)
                found = True
        for viewer in self._viewers:
            viewer.welcome()
        self._say()
        return found

    def watch(self, stopped: Callable[[], bool], wait_s: float) -> None:
        """Tells viewers until told to stop.

        Args:
            stopped: Says so.
            wait_s: How long to wait for the first period.

        Raises:
            BadInputError: nothing is published meanwhile.
        """
        began_ns = self._clock.now_ns()
        while not stopped():
            self.turn()
            now_ns = self._clock.now_ns()
            if not self.heard.periods and now_ns - began_ns > wait_s * 1e9:
                raise BadInputError(
                    f"nothing is published under {KEY} within {wait_s:g} s; expected a robot "
                    "bridge and its robot in this run (--run names another)"
                )
            self._clock.sleep_until_ns(now_ns + _NAP_NS)

    def _note(self, stamp: Stamp) -> None:
        """Counts a period, and those that were lost before it."""
        last = self._last
        if last is not None and (stamp.sender, stamp.epoch) == (last.sender, last.epoch):
            self.heard.lost += max(stamp.number - last.number - 1, 0)
        self._last, self._heard_ns = stamp, self._clock.now_ns()
        self.heard.periods += 1

    def _say(self) -> None:
        """Logs what a person has to know: silence, once, and losses, now and then."""
        now_ns = self._clock.now_ns()
        silent = bool(self.heard.periods) and now_ns - self._heard_ns > _SILENT_NS
        if silent != self._silent:
            self._silent = silent
            _log.warning("%s", "the bridge is silent" if silent else "the bridge is heard again")
        if self.heard.lost > self._told_lost and now_ns - self._told_ns > _TELL_NS:
            self._told_ns, self._told_lost = now_ns, self.heard.lost
            _log.warning(
                "%d of %d periods were lost: too slow here, or on the way",
                self.heard.lost,
                self.heard.periods + self.heard.lost,
            )
