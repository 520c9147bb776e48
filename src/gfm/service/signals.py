"""Signals, turned into a flag: the first asks the loop to end, the second ends the process.

Before the loop there may be waiting, for a peer or for a large file. Nothing has begun then that
would have to be finished, and the first signal ends it at once.
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import final

_log = logging.getLogger(__name__)


class StopRequested(BaseException):
    """Ends what a signal may end at once; like KeyboardInterrupt it passes all other handlers."""


@final
class StopSignal:
    """Called, it says whether SIGINT or SIGTERM has arrived."""

    def __init__(self) -> None:
        self._stopped = False
        self._at_once = False

    def __call__(self) -> bool:
        """Returns whether to stop."""
        return self._stopped

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Lets a signal raise StopRequested within the block, also one that came before it."""
        self._at_once = True
        try:
            if self._stopped:
                raise StopRequested
            yield
        finally:
            self._at_once = False

    def install(self) -> None:
        """Takes over SIGINT and SIGTERM of this process; only the main thread may do that."""
        signal.signal(signal.SIGINT, self._receive)
        signal.signal(signal.SIGTERM, self._receive)

    def _receive(self, number: int, _frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        if self._stopped:
            _log.warning("%s again: ending at once", name)
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        _log.info("%s: stopping", name)
        self._stopped = True
        if self._at_once:
            raise StopRequested
