"""What becomes of messages on their way: late, unevenly late, lost."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Generic, TypeVar, final

import numpy as np

_Item = TypeVar("_Item")


@dataclass(frozen=True, kw_only=True)
class Weather:
    """How bad it is.

    Attributes:
        latency_s: That every message is late.
        jitter_s: By how much more at most, evenly distributed.
        loss: Which part is lost.
    """

    latency_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0


@final
class Path(Generic[_Item]):
    """One direction; as over TCP, nothing overtakes.

    Args:
        weather: On it.
        rng: Of what is lost and how late the rest is.
    """

    def __init__(self, weather: Weather, rng: np.random.Generator) -> None:
        self._weather = weather
        self._rng = rng
        self._waiting: deque[tuple[int, _Item]] = deque()
        self._last_ns = 0

    def put(self, item: _Item, now_ns: int, *, may_be_lost: bool) -> None:
        """Takes a message at a time of this process's clock."""
        lost, late = self._rng.random(2)
        if may_be_lost and lost < self._weather.loss:
            return
        delay_s = self._weather.latency_s + late * self._weather.jitter_s
        self._last_ns = max(self._last_ns, now_ns + round(delay_s * 1e9))
        self._waiting.append((self._last_ns, item))

    def arrived(self, now_ns: int) -> list[_Item]:
        """Returns what arrives until now, in order."""
        there: list[_Item] = []
        while self._waiting and self._waiting[0][0] <= now_ns:
            there.append(self._waiting.popleft()[1])
        return there
