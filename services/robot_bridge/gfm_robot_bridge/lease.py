"""Who alone may drive: the first who came, until it lets go or falls silent."""

from __future__ import annotations

from typing import final

from gfm_wire import Stamp


@final
class Lease:
    """One holder: a connection, told by the stamp on what it sends.

    Args:
        what: What is held, in words.
        silence_ns: After so much silence somebody else may take it.
    """

    def __init__(self, what: str, silence_ns: int) -> None:
        self._what = what
        self._silence_ns = silence_ns
        self._holder: Stamp | None = None
        self._heard_ns = 0

    def refusal(self, sender: Stamp, now_ns: int) -> str:
        """Returns in words who else holds it; empty where `sender` does, or may take it."""
        silent_ns = now_ns - self._heard_ns
        if (
            self._holder is None
            or same_connection(self._holder, sender)
            or silent_ns > self._silence_ns
        ):
            return ""
        return (
            f"{self._what} is held by {name_of(self._holder)}, heard {silent_ns * 1e-9:.1f} s ago; "
            f"expected that it lets go, or {self._silence_ns * 1e-9:g} s without it"
        )

    def is_held_by(self, sender: Stamp) -> bool:
        """Returns whether `sender` holds it."""
        return self._holder is not None and same_connection(self._holder, sender)

    def take(self, sender: Stamp, now_ns: int) -> None:
        """Gives it to `sender`, or notes that it was heard."""
        self._holder = sender
        self._heard_ns = now_ns

    def release(self) -> None:
        """Gives it to nobody."""
        self._holder = None


def same_connection(one: Stamp, other: Stamp) -> bool:
    """Returns whether two messages came from one connection."""
    return (one.sender, one.epoch) == (other.sender, other.epoch)


def name_of(sender: Stamp) -> str:
    """Returns the name of a connection, for people."""
    return sender.sender or "a connection without a name"
