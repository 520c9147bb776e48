"""Work that the control loop does not wait for: writing files, one piece after the other."""

from __future__ import annotations

import logging
import queue
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import final

from typing_extensions import override

_log = logging.getLogger(__name__)

Piece = Callable[[], None]
#: Pieces that wait: some ten seconds of all that a robot says and is told.
_WAITING = 10_000


class Background(ABC):
    """Does pieces of work in the order in which they come."""

    @abstractmethod
    def do(self, piece: Piece) -> bool:
        """Takes a piece; returns False where too many wait already, and forgets it."""

    @abstractmethod
    def close(self, timeout_s: float) -> None:
        """Finishes what was taken, or gives up after `timeout_s`."""


@final
class AtOnce(Background):
    """Does every piece before it returns: where time stands still meanwhile, and in tests."""

    @override
    def do(self, piece: Piece) -> bool:
        piece()
        return True

    @override
    def close(self, timeout_s: float) -> None:
        pass


@final
class InThread(Background):
    """A thread of its own, which a slow disk may stop for a while."""

    def __init__(self, waiting: int = _WAITING) -> None:
        self._pieces: queue.Queue[Piece | None] = queue.Queue(waiting)
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @override
    def do(self, piece: Piece) -> bool:
        try:
            self._pieces.put_nowait(piece)
        except queue.Full:
            return False
        return True

    @override
    def close(self, timeout_s: float) -> None:
        try:
            self._pieces.put(None, timeout=timeout_s)
        except queue.Full:
            _log.warning("%d pieces of a recording are not written", self._pieces.qsize())
            return
        self._thread.join(timeout_s)

    def _work(self) -> None:
        while (piece := self._pieces.get()) is not None:
            try:
                piece()
            except Exception:  # noqa: BLE001  whatever it is, the next piece is written
                _log.exception("a piece of a recording failed")
