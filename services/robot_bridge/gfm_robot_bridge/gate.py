"""Which commands are listened to: those of one driver, in one session, complete and in order."""

from __future__ import annotations

from typing import final

import numpy as np

from gfm.core import Command
from gfm_robot_bridge.lease import Lease
from gfm_wire import Stamp


@final
class CommandGate:
    """Knows the session of whoever commands.

    A command with number 0 begins a session, where nobody else holds the robot. After a fault only
    that ends it: a driver that was away learns that the robot stopped, before it moves again.

    Args:
        joint_names: That every command must name, in any order.
        lease: Who may drive.
        oldest_ns: Age beyond which a command is refused; None takes any.

    Attributes:
        closed: Why nobody is listened to for now, in words; empty where somebody is.
        locked: The same, until a person says that it is over.
    """

    def __init__(
        self, joint_names: tuple[str, ...], lease: Lease, oldest_ns: int | None = None
    ) -> None:
        self.lease = lease
        self.closed = self.locked = ""
        self._joint_names = joint_names
        self._oldest_ns = oldest_ns
        self._last_number: int | None = None
        self._heard_ns = 0
        self._fault = ""
        self._shut = ""

    @property
    def in_session(self) -> bool:
        """Whether somebody commands the robot."""
        return self._last_number is not None and not self._fault

    def refusal(self, command: Command, sender: Stamp, now_ns: int) -> str:
        """Returns why a command is not listened to, in words; empty where it is."""
        if closed := self._shut or self.closed or self.locked:
            return closed
        if sorted(command.joint_names) != sorted(self._joint_names):
            names, expected = ", ".join(command.joint_names), ", ".join(self._joint_names)
            return f"command names joints {names}, expected {expected}"
        if not np.isfinite(command.values).all():
            return f"command holds {command.values.tolist()}, expected finite numbers"
        if not 0.0 < command.speed_share <= 1.0:
            return f"command has the speed share {command.speed_share:g}, expected above 0 to 1"
        if problem := self.lease.refusal(sender, now_ns):
            return problem
        return "" if command.number == 0 else self._out_of_order(command.number, sender)

    def _out_of_order(self, number: int, sender: Stamp) -> str:
        if self._fault:
            return f"{self._fault}; a command with number 0 begins again"
        if self._last_number is None or not self.lease.is_held_by(sender):
            return f"command has number {number}, expected 0 to begin a session"
        if number <= self._last_number:
            return f"command {number} came after {self._last_number}: stale"
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

    def accept(self, command: Command, sender: Stamp, now_ns: int) -> bool:
        """Takes note of a command; returns whether it begins a session."""
        self.lease.take(sender, now_ns)
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

    def shut(self, why: str) -> None:
        """Ends the session for good: nobody begins another."""
        self._shut = self._fault = why

    def release(self) -> None:
        """Ends the session, and with it the lease: whoever comes next may begin one."""
        self.lease.release()
        self._last_number, self._fault = None, ""
