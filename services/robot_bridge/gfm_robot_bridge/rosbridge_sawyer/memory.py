"""A rosbridge in memory: link and door of one process, without a socket or a thread."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, final

import msgspec
from typing_extensions import override

from gfm.core import Clock
from gfm_robot_bridge.intera.link import Arrived, Due, Link, Op
from gfm_robot_bridge.rosbridge_sawyer.door import Door, Said


@final
class MemoryDoor(Door):
    """Where the links of one process come in; messages become JSON on the way.

    Attributes:
        is_shut: Set to let nobody in.
    """

    def __init__(self) -> None:
        self.is_shut = False
        self._said: deque[Said] = deque()
        self._links: dict[int, MemoryLink] = {}
        self._numbers = itertools.count()

    @override
    def receive(self) -> Said | None:
        return self._said.popleft() if self._said else None

    @override
    def send(self, client: int, op: Mapping[str, Any]) -> None:
        if (link := self._links.get(client)) is not None:
            link.take(_through_json(op))

    @override
    def close(self) -> None:
        self.is_shut = True
        for link in list(self._links.values()):
            link.drop("it closed the connection")

    def enter(self, link: MemoryLink) -> int:
        """Takes a link; returns its number."""
        number = next(self._numbers)
        self._links[number] = link
        return number

    def leave(self, number: int) -> None:
        """Forgets a link."""
        if self._links.pop(number, None) is not None:
            self._said.append(Said(client=number, op=None))

    def hear(self, number: int, op: Op) -> None:
        """Takes what a link says."""
        self._said.append(Said(client=number, op=_through_json(op)))


@final
class MemoryLink(Link):
    """Goes through a door; what is planned leaves when `receive` or `pass_time` is called.

    Args:
        door: Of the robot.
        clock: Of this process.
    """

    def __init__(self, door: MemoryDoor, clock: Clock) -> None:
        self.peer = "rosbridge in memory"
        self._door = door
        self._clock = clock
        self._number: int | None = None
        self._problem = ""
        self._planned: deque[Due] = deque()
        self._arrived: deque[Arrived] = deque()

    @override
    def open(self) -> None:
        self.drop("it is opened anew")
        self._arrived.clear()
        self._problem = "it is shut" if self._door.is_shut else ""
        self._number = None if self._door.is_shut else self._door.enter(self)

    @property
    @override
    def is_open(self) -> bool:
        return self._number is not None

    @property
    @override
    def problem(self) -> str:
        return self._problem

    @override
    def say(self, op: Op) -> None:
        if self._number is not None:
            self._door.hear(self._number, op)

    @override
    def plan(self, ops: Sequence[Due]) -> None:
        self._planned = deque(ops)
        self.pass_time()

    @override
    def receive(self) -> list[Arrived]:
        self.pass_time()
        return [self._arrived.popleft() for _ in range(len(self._arrived))]

    @override
    def drop(self, why: str) -> None:
        self._planned.clear()
        if self._number is not None:
            self._door.leave(self._number)
            self._number, self._problem = None, why

    @override
    def close(self) -> None:
        for due in self._planned:
            self.say(due.op)
        self.drop("it is closed")

    def pass_time(self) -> None:
        """Sends what is due."""
        now_ns = self._clock.now_ns()
        while self._planned and self._planned[0].at_ns <= now_ns:
            due = self._planned.popleft()
            if due.until_ns is None or now_ns <= due.until_ns:
                self.say(due.op)

    def take(self, op: dict[str, Any]) -> None:
        """Takes what the robot says."""
        self._arrived.append(Arrived(op=op, at_ns=self._clock.now_ns()))


def _through_json(op: Mapping[str, Any]) -> dict[str, Any]:
    decoded: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(op))
    return decoded
