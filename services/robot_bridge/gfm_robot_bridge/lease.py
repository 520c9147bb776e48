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
        self._holder: tuple[str, int] | None = None
        self._heard_ns = 0

    def refusal(self, sender: Stamp, now_ns: int) -> str:
        """Returns in words who else holds it; empty where `sender` does, or may take it."""
        silent_ns = now_ns - self._heard_ns
        if self._holder is None or self._holder == _who(sender) or silent_ns > self._silence_ns:
            return ""
        holder = self._holder[0] or "a connection without a name"
        return (
            f"{self._what} is held by {holder}, heard {silent_ns * 1e-9:.1f} s ago; "
            f"expected that it lets go, or {self._silence_ns * 1e-9:g} s without it"
        )

    def is_held_by(self, sender: Stamp) -> bool:
        """Returns whether `sender` holds it."""
        return self._holder == _who(sender)

    def take(self, sender: Stamp, now_ns: int) -> None:
        """Gives it to `sender`, or notes that it was heard."""
        self._holder = _who(sender)
        self._heard_ns = now_ns

    def release(self) -> None:
        """Gives it to nobody."""
        self._holder = None


def _who(sender: Stamp) -> tuple[str, int]:
    return sender.sender, sender.epoch
