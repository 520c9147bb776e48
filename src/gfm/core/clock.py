"""Time, injected: nothing else in this project asks the operating system what time it is."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import final

from typing_extensions import override


class Clock(ABC):
    """A monotonic clock and, beside it, the date."""

    @abstractmethod
    def now_ns(self) -> int:
        """Returns nanoseconds since an arbitrary origin; never goes backwards."""

    @abstractmethod
    def utc_ns(self) -> int:
        """Returns nanoseconds since 1970-01-01 UTC, for stamps that leave the process."""

    @abstractmethod
    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Returns at `deadline_ns` of this clock, or at once where that has passed."""


@final
class MonotonicClock(Clock):
    """The operating system's clocks."""

    @override
    def now_ns(self) -> int:
        return time.monotonic_ns()

    @override
    def utc_ns(self) -> int:
        return time.time_ns()

    @override
    def sleep_until_ns(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns * 1e-9)


@final
class ManualClock(Clock):
    """A clock that moves only when told to: tests never sleep."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def advance_s(self, seconds: float) -> None:
        """Moves the clock forward by `seconds`."""
        self._now_ns += round(seconds * 1e9)

    @override
    def now_ns(self) -> int:
        return self._now_ns

    @override
    def utc_ns(self) -> int:
        return self._now_ns

    @override
    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._now_ns = max(self._now_ns, deadline_ns)
