"""The port of a connection to a rosbridge: JSON objects out and in; nothing here waits."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Op = Mapping[str, Any]
"""One operation of the rosbridge protocol, version 2."""


@dataclass(frozen=True, kw_only=True)
class Arrived:
    """An operation that came in.

    Attributes:
        op: What it says.
        at_ns: When it came, on this process's clock.
    """

    op: dict[str, Any]
    at_ns: int


@dataclass(frozen=True, kw_only=True)
class Due:
    """An operation with its time.

    Attributes:
        op: To send.
        at_ns: When, on this process's clock; at once where that has passed.
        until_ns: From when on it is not sent any more; None sends it in any case.
    """

    op: Op
    at_ns: int
    until_ns: int | None = None


class Link(ABC):
    """One connection at a time; it never comes back by itself.

    Attributes:
        peer: At the other end, for people.
    """

    peer: str

    @abstractmethod
    def open(self) -> None:
        """Begins to connect; nothing of an earlier connection is left, in either direction."""

    @property
    @abstractmethod
    def is_open(self) -> bool:
        """Whether it is connected."""

    @property
    @abstractmethod
    def problem(self) -> str:
        """Why it is not, and will not be, connected, in words; empty while it is or may be."""

    @abstractmethod
    def say(self, op: Op) -> None:
        """Sends an operation after those that were said before; forgets it where not connected."""

    @abstractmethod
    def plan(self, ops: Sequence[Due]) -> None:
        """Sends operations at their times, in place of what waits of an earlier plan."""

    @abstractmethod
    def receive(self) -> list[Arrived]:
        """Returns what came since the last call, oldest first."""

    @abstractmethod
    def drop(self, why: str) -> None:
        """Ends the connection at once."""

    @abstractmethod
    def close(self) -> None:
        """Sends what is planned, then ends the connection."""
