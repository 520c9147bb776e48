"""Answers for a service while one of its steps lasts long.

A service is asked how it is between two steps. A step may last: a large network learns, a file is
read. Whoever asks meanwhile is told what the service said last, and since when its step lasts.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import final

from gfm.core import Clock, GfmError, Status
from gfm.service.service import RunningService

_log = logging.getLogger(__name__)

#: A step that lasts no longer is not spoken of: the service answers for itself soon enough.
_PATIENCE_NS = 300_000_000
_SAY_NS = 500_000_000
_LOOK_S = 0.05


@final
class StandIn:
    """Knows what a service said last; `turn` is called by its loop, `answer` by another thread."""

    def __init__(self, running: RunningService, clock: Clock, stopped: Callable[[], bool]) -> None:
        self._running = running
        self._clock = clock
        self._stopped = stopped
        self._began_ns = self._said_ns = clock.now_ns()
        self._said = running.status()

    def turn(self) -> None:
        """Notes that a step begins, and now and then what the service says before it."""
        self._began_ns = self._clock.now_ns()
        if self._began_ns - self._said_ns >= _SAY_NS:
            self._said, self._said_ns = self._running.status(), self._began_ns

    def answer(self) -> None:
        """Answers one question for the status where the step lasts."""
        lasted_ns = self._clock.now_ns() - self._began_ns
        if lasted_ns >= _PATIENCE_NS:
            self._running.answer(lambda: self._status(lasted_ns * 1e-9))

    def _status(self, lasted_s: float) -> Status:
        words = [self._said.note, f"in one step for {lasted_s:.1f} s"]
        if self._stopped():
            words.append("told to stop, after this step")
        return replace(
            self._said,
            gauges={**self._said.gauges, "step_s": lasted_s},
            note="; ".join(word for word in words if word),
        )


@contextmanager
def standing_in(
    running: RunningService, clock: Clock, stopped: Callable[[], bool]
) -> Iterator[StandIn]:
    """Yields a stand-in that answers from a thread of its own for the length of the block."""
    stand_in, over = StandIn(running, clock, stopped), threading.Event()

    def answer() -> None:
        try:
            while not over.wait(_LOOK_S):
                stand_in.answer()
        except GfmError:
            _log.exception("nobody answers in long steps any more")

    thread = threading.Thread(target=answer, name="stand-in", daemon=True)
    thread.start()
    try:
        yield stand_in
    finally:
        over.set()
        thread.join()
