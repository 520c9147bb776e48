"""Signals, turned into a flag: the first asks the loop to end, the second ends the process."""

from __future__ import annotations

import logging
import os
import signal
from types import FrameType
from typing import final

_log = logging.getLogger(__name__)


@final
class StopSignal:
    """Called, it says whether SIGINT or SIGTERM has arrived."""

    def __init__(self) -> None:
        self._stopped = False

    def __call__(self) -> bool:
        """Returns whether to stop."""
        return self._stopped

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
