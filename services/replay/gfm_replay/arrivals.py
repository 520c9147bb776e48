"""Which sequences have arrived: each counts once, however often it is sent."""

from __future__ import annotations

from collections import OrderedDict
from typing import final

from gfm.core import RefusedError

OUT_OF_ORDER = 1024
"""Numbers that are remembered beyond a gap before the gap is given up."""

ACTORS = 10_000
"""Actors that are remembered; the one not heard of for longest is forgotten first."""


@final
class Life:
    """The numbers that have arrived from one actor in one epoch."""

    def __init__(self, epoch: int) -> None:
        self.epoch = epoch
        self.cursor = 0
        self._beyond: set[int] = set()

    def has(self, number: int) -> bool:
        """Returns whether `number` has arrived, or was given up."""
        return number < self.cursor or number in self._beyond

    def add(self, number: int) -> int:
        """Notes a number that had not arrived; returns how many were given up for it."""
        self._beyond.add(number)
        given_up = 0
        if len(self._beyond) > OUT_OF_ORDER:
            first = min(self._beyond)
            given_up = first - self.cursor
            self.cursor = first
        while self.cursor in self._beyond:
            self._beyond.remove(self.cursor)
            self.cursor += 1
        return given_up


@final
class Arrivals:
    """The current life of every actor."""

    def __init__(self) -> None:
        self._lives: OrderedDict[str, Life] = OrderedDict()

    def life(self, actor: str, epoch: int) -> Life:
        """Returns the life that a sequence belongs to; a newer epoch begins a new one.

        Raises:
            RefusedError: a newer life of this actor has begun.
        """
        life = self._lives.get(actor)
        if life is None or epoch > life.epoch:
            life = self._lives[actor] = Life(epoch)
        elif epoch < life.epoch:
            raise RefusedError(
                f"{actor:.64} of epoch {epoch} is over: another one began at epoch {life.epoch}"
            )
        self._lives.move_to_end(actor)
        if len(self._lives) > ACTORS:
            self._lives.popitem(last=False)
        return life

    def __len__(self) -> int:
        return len(self._lives)
