"""How punctual the bridge is: how often something took how long."""

from __future__ import annotations

from bisect import bisect_left
from typing import final

from gfm.recording.periods import ENDS_MS


@final
class Histogram:
    """Counts durations.

    Args:
        name: Of what is measured, as it begins the names in a status.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._counts = [0] * (len(ENDS_MS) + 1)
        self._most_ns = 0

    def add(self, duration_ns: int) -> None:
        """Counts one; a negative one counts as nothing."""
        self._counts[bisect_left(ENDS_MS, duration_ns * 1e-6)] += 1
        self._most_ns = max(self._most_ns, duration_ns)

    def counters(self) -> dict[str, int]:
        """Returns how many were in each bin, by the name of its upper end."""
        names = [f"{self._name}_to_{end:g}_ms" for end in ENDS_MS]
        names.append(f"{self._name}_over_{ENDS_MS[-1]:g}_ms")
        return dict(zip(names, self._counts, strict=True))

    def gauges(self) -> dict[str, float]:
        """Returns below what 99 % were (the upper end of their bin), and the longest, in ms."""
        return {f"{self._name}_p99_ms": self._p99_ms(), f"{self._name}_most_ms": self._most_ms}

    @property
    def _most_ms(self) -> float:
        return self._most_ns * 1e-6

    def _p99_ms(self) -> float:
        left = 0.99 * sum(self._counts)
        for end, count in zip(ENDS_MS, self._counts, strict=False):
            left -= count
            if left <= 0.0:
                return min(end, self._most_ms)
        return self._most_ms


@final
class Timing:
    """What the bridge measures of itself.

    Attributes:
        jitter: How late a period began.
        delays: From its beginning until the robot was told.
        ages: Of commands, from their stamps until they were decided.
    """

    def __init__(self) -> None:
        self.jitter = Histogram("jitter")
        self.delays = Histogram("read_to_send")
        self.ages = Histogram("command_age")

    def counters(self) -> dict[str, int]:
        """Returns the bins of all."""
        return self.jitter.counters() | self.delays.counters() | self.ages.counters()

    def gauges(self) -> dict[str, float]:
        """Returns the numbers of all, ms."""
        return self.jitter.gauges() | self.delays.gauges() | self.ages.gauges()
