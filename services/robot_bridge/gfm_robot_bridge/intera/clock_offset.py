"""By how much the robot's clock is ahead of this one's, from stamps and times of arrival."""

from __future__ import annotations

from collections import deque
from typing import final


@final
class ClockOffset:
    """The filter of least delay: of all messages in a window, the one that was under way shortest.

    A message stamped t and heard at t' with a delay d tells t - t' = offset - d. Delays are
    positive and vary, so the greatest difference in the window is nearest to the offset: less by
    the least delay. Clocks that drift, or are set, are followed within a window.

    Args:
        window_ns: How long a message counts.

    Attributes:
        newest_delay_ns: Of the newest message, beyond the least.
    """

    def __init__(self, window_ns: int = 10_000_000_000) -> None:
        self.newest_delay_ns = 0
        self._window_ns = window_ns
        #: Times of arrival and differences; each difference is less than all before it.
        self._candidates: deque[tuple[int, int]] = deque()

    @property
    def known(self) -> bool:
        """Whether a message was heard."""
        return bool(self._candidates)

    @property
    def ns(self) -> int:
        """What to add to this process's clock; 0 before the first message."""
        return self._candidates[0][1] if self._candidates else 0

    def add(self, stamp_ns: int, arrived_ns: int) -> None:
        """Takes a message.

        Args:
            stamp_ns: Its stamp, on the robot's clock.
            arrived_ns: When it was heard, on this process's clock.
        """
        ahead_ns = stamp_ns - arrived_ns
        while self._candidates and self._candidates[-1][1] <= ahead_ns:
            self._candidates.pop()
        self._candidates.append((arrived_ns, ahead_ns))
        while self._candidates[0][0] < arrived_ns - self._window_ns:
            self._candidates.popleft()
        self.newest_delay_ns = self.ns - ahead_ns
