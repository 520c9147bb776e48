"""The port at which clients of a rosbridge come in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a client said.

    Attributes:
        client: Its number; none is given twice.
        op: What it said; None where it is gone.
    """

    client: int
    op: dict[str, Any] | None


class Door(ABC):
    """Takes what clients say and tells them things; nothing here waits."""

    @abstractmethod
    def receive(self) -> Said | None:
        """Returns what was said next, or None."""

    @abstractmethod
    def send(self, client: int, op: Mapping[str, Any]) -> None:
        """Tells a client something; one that is gone, or takes nothing, is not told."""

    @abstractmethod
    def close(self) -> None:
        """Sends everybody away."""
