"""When control periods begin: evenly in time, whatever one of them took."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final


@dataclass(frozen=True, kw_only=True)
class Begun:
    """The beginning of a period: when, how late that is, and how many were missed before it."""

    now_ns: int
    late_ns: int
    missed: int


@final
class Grid:
    """Moments at a fixed distance of one another.

    Args:
        period_ns: The distance.
        first_ns: The first of them.

    Attributes:
        next_ns: The next one; to set it moves the grid.
    """

    def __init__(self, period_ns: int, first_ns: int) -> None:
        self.next_ns = first_ns
        self._period_ns = period_ns

    def begun(self, now_ns: int) -> Begun | None:
        """Returns the period that begins now; None before the next one is due."""
        late_ns = now_ns - self.next_ns
        if late_ns < 0:
            return None
        missed = late_ns // self._period_ns
        self.next_ns += (missed + 1) * self._period_ns
        return Begun(now_ns=now_ns, late_ns=late_ns, missed=missed)
