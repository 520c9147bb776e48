"""Which sequences have arrived: each counts once, however often it is sent.

An actor and an epoch are one life. Epochs are names, not times: a life that begins takes nothing
from another one, so that neither a clock that was set back nor a stranger who invents an epoch
keeps an actor from being heard.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from typing import final

OUT_OF_ORDER = 1024
"""Numbers that are remembered beyond a gap before the gap is given up."""

LIVES = 10_000
"""Lives that are remembered; the one not heard of for longest is forgotten first."""


@final
class Life:
    """The numbers that have arrived from one actor in one epoch.

    Attributes:
        floor: No number below it is taken: whether it arrived before this life was first heard of
            here cannot be known.
        cursor: No number below it is waited for: it has arrived, or was given up.
    """

    def __init__(self, floor: int = 0, cursor: int = 0, beyond: Iterable[int] = ()) -> None:
        self.floor = floor
        self.cursor = cursor
        self._beyond = set(beyond)

    @classmethod
    def beginning_with(cls, number: int) -> Life:
        """Returns a life of which `number` is the first that is heard of here.

        Where that is a late one, another process has acknowledged those before; what is still on
        its way lies within OUT_OF_ORDER of it.
        """
        floor = max(0, number - OUT_OF_ORDER)
        return cls(floor, floor)

    def has(self, number: int) -> bool:
        """Returns whether `number` has arrived, or was given up."""
        return number < self.cursor or number in self._beyond

    def add(self, number: int) -> int:
        """Notes a number that had not arrived; returns how many were given up for it."""
        self._beyond.add(number)
        given_up = 0
        if len(self._beyond) > OUT_OF_ORDER:
            first = min(self._beyond)
            given_up = first - self.cursor if self.cursor > self.floor or self.floor == 0 else 0
            self.cursor = first
        while self.cursor in self._beyond:
            self._beyond.remove(self.cursor)
            self.cursor += 1
        return given_up


@final
class Arrivals:
    """The lives of all actors."""

    def __init__(self) -> None:
        self._lives: OrderedDict[tuple[str, int], Life] = OrderedDict()

    def life(self, actor: str, epoch: int, number: int) -> Life:
        """Returns the life that a sequence belongs to; it begins with `number` where it is new."""
        key = actor, epoch
        if key not in self._lives:
            self.put(actor, epoch, Life.beginning_with(number))
        self._lives.move_to_end(key)
        return self._lives[key]

    def put(self, actor: str, epoch: int, life: Life) -> None:
        """Remembers a life."""
        self._lives[actor, epoch] = life
        if len(self._lives) > LIVES:
            self._lives.popitem(last=False)

    def __len__(self) -> int:
        return len(self._lives)
