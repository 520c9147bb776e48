"""Which commands are listened to: those of one session, complete, finite and in order."""

from __future__ import annotations

from typing import final

import numpy as np

from gfm.core import Command


@final
class CommandGate:
    """Knows the session of whoever commands.

    A command with number 0 begins a session. After a fault only that ends it: a driver that was
    away learns that the robot stopped, before it moves again.

    Args:
        joint_names: That every command must name, in any order.
        oldest_ns: Age beyond which a command is refused; None takes any.
    """

    def __init__(self, joint_names: tuple[str, ...], oldest_ns: int | None = None) -> None:
        self._joint_names = joint_names
        self._oldest_ns = oldest_ns
        self._last_number: int | None = None
        self._heard_ns = 0
        self._fault = ""

    @property
    def in_session(self) -> bool:
        """Whether somebody commands the robot."""
        return self._last_number is not None and not self._fault

    def refusal(self, command: Command) -> str:
        """Returns why a command is not listened to, in words; empty where it is."""
        if sorted(command.joint_names) != sorted(self._joint_names):
            names, expected = ", ".join(command.joint_names), ", ".join(self._joint_names)
            return f"command names joints {names}, expected {expected}"
        if not np.isfinite(command.values).all():
            return f"command holds {command.values.tolist()}, expected finite numbers"
        if command.number == 0:
            return ""
        if self._fault:
            return f"{self._fault}; a command with number 0 begins again"
        if self._last_number is None:
            return f"command has number {command.number}, expected 0 to begin a session"
        if command.number <= self._last_number:
            return f"command {command.number} came after {self._last_number}: stale"
        return ""

    def stale(self, command: Command, utc_ns: int) -> str:
        """Returns in words how a command is too old, or from the future; empty where it is not.

        Args:
            command: Stamped by its driver.
            utc_ns: The date here.
        """
        age_ns = utc_ns - command.stamp_ns
        if self._oldest_ns is None or abs(age_ns) <= self._oldest_ns:
            return ""
        when = f"{abs(age_ns) * 1e-6:.0f} ms {'old' if age_ns > 0 else 'in the future'}"
        return f"command {command.number} is {when}, expected at most {self._oldest_ns * 1e-6:g} ms"

    def accept(self, command: Command, now_ns: int) -> bool:
        """Takes note of a command; returns whether it begins a session."""
        self._fault = ""
        self._last_number = command.number
        self._heard_ns = now_ns
        return command.number == 0

    def silent_ns(self, now_ns: int) -> int:
        """Returns for how long no command came; 0 outside a session."""
        return now_ns - self._heard_ns if self.in_session else 0

    def latch(self, fault: str) -> None:
        """Ends the session with a fault, in words."""
        self._fault = fault
