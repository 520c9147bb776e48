"""The time of what takes long: what is under way is broken off where it is over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass


class OutOfTimeError(Exception):
    """The time is over."""


@dataclass
class Clock:
    """Says whether there is time left; all who work on one thing share it.

    Attributes:
        in_time: Whether there is; None where nothing is bounded.
    """

    in_time: Callable[[], bool] | None = None

    def check(self) -> None:
        """Raises OutOfTimeError where the time is over."""
        if self.in_time is not None and not self.in_time():
            raise OutOfTimeError

    @contextmanager
    def until(self, in_time: Callable[[], bool]) -> Iterator[None]:
        """Bounds what is done within."""
        before, self.in_time = self.in_time, in_time
        try:
            yield
        finally:
            self.in_time = before
