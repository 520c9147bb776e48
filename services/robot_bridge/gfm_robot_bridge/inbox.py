"""Where commands arrive: the newest one counts, whoever sent the others is told why not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

from gfm.core import Clock, Command, CommandKind
from gfm.transport import QUEUED_REQUESTS, Request, Transport
from gfm_robot_bridge.gate import CommandGate

COMMAND = "robot/command"


@dataclass(frozen=True, kw_only=True)
class Heard:
    """A command that is listened to.

    Attributes:
        request: With which it came, to be answered.
        command: As it came.
        begins: Whether it begins a session.
        heard_ns: When, on the bridge's clock.
    """

    request: Request
    command: Command
    begins: bool
    heard_ns: int


def in_order(command: Command, joint_names: tuple[str, ...]) -> Command:
    """Returns a command with its joints in an order; it names them all."""
    order = [command.joint_names.index(name) for name in joint_names]
    return replace(command, joint_names=joint_names, values=command.values[order])


@final
class Inbox:
    """Takes the newest command of the one who drives.

    Args:
        transport: On which they arrive.
        clock: Of this process.
        gate: Says which are listened to.
        refusal: Says why a kind of command is not taken; empty where it is.

    Attributes:
        counters: Commands that were not listened to, by name.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        gate: CommandGate,
        refusal: Callable[[CommandKind], str],
    ) -> None:
        self.counters: Counter[str] = Counter(
            stale_commands=0, superseded_commands=0, rejected_messages=0
        )
        self._server = transport.serve(COMMAND)
        self._clock = clock
        self._gate = gate
        self._refusal = refusal

    def newest(self) -> Heard | None:
        """Empties the queue; returns the newest command that is listened to, refuses the rest."""
        found: Heard | None = None
        for _ in range(QUEUED_REQUESTS):  # who sends without pause shall not hold up the robot
            if (request := self._server.receive()) is None:
                break
            heard = self._heard(request)
            if heard is not None and found is not None:
                self.counters["superseded_commands"] += 1
                found.request.refuse(
                    f"command {found.command.number}: a newer one came, {heard.command.number}"
                )
            found = heard or found
        return found

    def refuse_all(self, reason: str) -> None:
        """Refuses whatever waits."""
        for _ in range(QUEUED_REQUESTS):
            if (request := self._server.receive()) is None:
                break
            self.refuse(request, reason)

    def refuse(self, request: Request, reason: str) -> None:
        """Refuses one, and counts it."""
        self.counters["rejected_messages"] += 1
        request.refuse(reason)

    def _heard(self, request: Request) -> Heard | None:
        command, now_ns = request.message, self._clock.now_ns()
        if not isinstance(command, Command):
            self.refuse(request, f"got {type(command).__name__}, expected Command")
            return None
        if problem := self._problem(request, command, now_ns):
            self.refuse(request, problem)
            return None
        begins = self._gate.accept(command, request.stamp, now_ns)
        return Heard(request=request, command=command, begins=begins, heard_ns=now_ns)

    def _problem(self, request: Request, command: Command, now_ns: int) -> str:
        stale = self._gate.stale(command, self._clock.utc_ns())
        self.counters["stale_commands"] += bool(stale)
        refused = self._gate.refusal(command, request.stamp, now_ns)
        return stale or refused or self._refusal(command.kind)
