"""Keeps the arm away from what it must not touch: lets through what can be stopped before it.

Shape letters: J joints, N moments, C places where two shapes are near.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from gfm.core import Observation, Reason
from gfm.core.checks import Array
from gfm_robot_bridge.foresight import Foresight
from gfm_robot_bridge.load import Load, by_load
from gfm_robot_bridge.plan import Plan
from gfm_robot_bridge.surroundings import SEEN_M, Surroundings

#: A path is looked at so often at least, m of the way of any point of the arm.
_FINE_M = 0.02
#: Sensors are not exact: a distance may look so much smaller than it is, m ...
_NOISE_M = 0.001
#: .. and what is too near has to be farther by so much in the end, m.
_AWAY_M = 0.001
#: Where so much of the clearance is lost, m, the model does not tell what this robot does.
_LOST_M = 0.005
#: In which time what is left of a distance is used up at most, s, by speeds that were corrected.
_APPROACH_S = 0.4
_CORRECTIONS = 10


@dataclass(frozen=True, kw_only=True)
class Loss:
    """A clearance that was lost in spite of all.

    Attributes:
        words: Which one, and by how much.
        again: Whether it was lost before, and the arm was not led away since.
    """

    words: str
    again: bool


@final
class Guard:
    """Knows how near is too near.

    No distance may fall below the clearance on the way to rest. What was nearer when the arm was
    seen first may stay so near; what came nearer since has to be led away.

    Whatever the arm does, each distance stays above what it may be less twice (`_LOST_M` + what a
    stop still costs), until a person resets a loss that came `again`: it may be lost once, with all
    that the stop costs, and once more before it is led away.

    Args:
        surroundings: Of the arm.
        foresight: Of what it does.
        clearance_m: Distance to keep.
    """

    def __init__(
        self, surroundings: Surroundings, foresight: Foresight, clearance_m: float
    ) -> None:
        self._surroundings = surroundings
        self._foresight = foresight
        self._clearance_m = clearance_m
        self._least = self._home = np.full(surroundings.pairs, clearance_m)
        self._on_the_way = self._in_the_end = self._least
        self._position = self._velocity = np.empty(0)

    def look(self, seen: Observation) -> None:
        """Takes note of where the arm is: what it is told next is judged from there."""
        first = not len(self._position)
        self._position, self._velocity = seen.position, seen.velocity
        now = self._distances(seen.position)
        reached = np.minimum(now, self._clearance_m)
        self._home = reached if first else np.maximum(self._home, reached)
        self._least = reached if first else np.maximum(self._least, reached)
        self._on_the_way = np.minimum(self._least, now) - _NOISE_M
        self._in_the_end = np.minimum(self._least - _NOISE_M, now + _AWAY_M)

    def loss(self, seen: Observation) -> Loss | None:
        """Returns what came too near in spite of all; None where nothing did.

        It is said once: from then on that may stay as near, so that it can be led away.
        """
        now = self._distances(seen.position)
        lost = self._least - now
        pair = int(np.argmax(lost))
        if not len(self._position) or lost[pair] <= _LOST_M:
            return None
        expected_m, again = self._least[pair], self._least[pair] < self._home[pair] - _NOISE_M
        self.sink(seen)
        words = (
            f"{self._surroundings.named(pair)} are {1e3 * now[pair]:.0f} mm apart, expected at "
            f"least {1e3 * expected_m:.0f} mm: the arm does not do what its model does"
        )
        return Loss(words=words, again=bool(again))

    def sink(self, seen: Observation) -> None:
        """Lets things be as near as they are: what a stop still costs belongs to its loss."""
        self._least = np.minimum(self._least, self._distances(seen.position))

    def reason(self, plan: Plan, load: Load | None = None, slowing: Array | None = None) -> Reason:
        """Returns why a plan is not to be told; nothing where it may be.

        What acts on the joints may be friction, which ends with the motion, or a load, which does
        not: it has to go well with it and without.

        Args:
            plan: To be told.
            load: That the robot does not know of; None for none.
            slowing: As of `Foresight.paths`.
        """
        if reason := self._reason(plan, None, slowing):
            return reason
        return Reason.NONE if load is None else by_load(self._reason(plan, load.torque, slowing))

    def corrected(self, speed: Array, sinking: Array | None = None) -> Array:
        """Returns speeds that come no nearer than there is time for, rad/s, shape (J,).

        Along each distance d, whose rate is g v, they are moved until g v >= -(d - clearance) / T.

        Args:
            speed: Wanted, rad/s, shape (J,).
            sinking: At which the arm goes where it is told 0, rad/s, shape (J,).
        """
        near = self._surroundings.near(self._position)
        rows = self._surroundings.parting()
        left = near.distance - self._least[near.pair]
        lowest = -np.maximum(left, 0.0) / _APPROACH_S
        if sinking is not None:
            lowest = np.maximum(lowest, lowest - rows @ sinking)
        size = np.maximum((rows**2).sum(axis=1), 1e-9)
        speed = speed.copy()
        for _ in range(_CORRECTIONS if len(rows) else 0):
            lack = (lowest - rows @ speed) / np.sqrt(size)
            worst = int(np.argmax(lack))
            if lack[worst] <= 0.0:
                break
            speed += rows[worst] * lack[worst] / np.sqrt(size[worst])
        return speed

    def _reason(self, plan: Plan, torque: Array | None, slowing: Array | None) -> Reason:
        for path in self._foresight.paths(self._position, self._velocity, plan, torque, slowing):
            if reason := self._reason_on(path):
                return reason
        return Reason.NONE

    def _distances(self, position: Array) -> Array:
        """Returns the distance of every pair, m; SEEN_M where it is no less."""
        distances = np.full(self._surroundings.pairs, SEEN_M)
        near = self._surroundings.near(position)
        np.minimum.at(distances, near.pair, near.distance)
        return distances

    def _reason_on(self, path: Array) -> Reason:
        """Returns why a path, shape (N, J), comes too near; nothing where it does not.

        Its end comes first: what comes too near mostly does so there. Of the rest, the next moment
        to be looked at is when a point of the arm can have gone the smallest distance left.
        """
        reason, _ = self._at(path[-1], self._in_the_end)
        steps = np.abs(np.diff(path, axis=0)) @ self._surroundings.reach
        way, moment = np.concatenate([[0.0], np.cumsum(steps)]), 0
        while not reason and moment < len(path) - 1:
            reason, free_m = self._at(path[moment], self._on_the_way)
            beyond = int(np.searchsorted(way, way[moment] + max(free_m, _FINE_M), side="right"))
            moment = max(beyond - 1, moment + 1)
        return reason

    def _at(self, position: Array, allowed: Array) -> tuple[Reason, float]:
        """Returns why the arm may not be somewhere, or how much is left of all distances, m."""
        near = self._surroundings.near(position)
        left = near.distance - allowed[near.pair]
        free_m = float(left.min(initial=SEEN_M - self._clearance_m))
        if free_m >= 0.0:
            return Reason.NONE, free_m
        return self._surroundings.reason(int(near.pair[np.argmin(left)])), free_m
