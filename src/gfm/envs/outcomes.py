"""How episodes of a task end, and how often well.

Shape letters: N instances, n of them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from enum import IntEnum
from typing import final

import numpy as np
from numpy.typing import NDArray

#: 0.5 s at 20 Hz (the paper).
HOLD_STEPS = 10
_RECENT = 200


class Outcome(IntEnum):
    """How an episode stands."""

    RUNNING = 0
    REACHED = 1
    OUT_OF_TIME = 2
    TOOL_LEFT_WORKSPACE = 3
    OBJECT_LEFT_BASKET = 4
    DIVERGED = 5
    PROTECTIVE_STOP = 6


@final
class Outcomes:
    """The outcomes of N instances.

    Attributes:
        now: Of the current episodes, members of `Outcome`, shape (N,).
    """

    def __init__(self, num_envs: int) -> None:
        self.now: NDArray[np.int64] = np.zeros(num_envs, np.int64)
        self._held = np.zeros(num_envs, np.int64)
        self._successes: deque[bool] = deque(maxlen=_RECENT)

    def start(self, ids: NDArray[np.intp]) -> None:
        """Begins new episodes in the instances `ids`, shape (n,)."""
        self.now[ids] = Outcome.RUNNING
        self._held[ids] = 0

    def judge(
        self, reached: NDArray[np.bool_], failure: NDArray[np.int64], ended: NDArray[np.bool_]
    ) -> None:
        """Takes in one step; the goal counts once it was held, whatever comes later.

        Args:
            reached: Where the goal is reached at this moment, shape (N,).
            failure: What went wrong, RUNNING where nothing did, shape (N,).
            ended: Where the episode is over, shape (N,).
        """
        self._held = np.where(reached, self._held + 1, 0)
        self.now = np.where(self.now == Outcome.RUNNING, failure, self.now)
        held = (self.now == Outcome.RUNNING) & (self._held >= HOLD_STEPS)
        self.now[held] = Outcome.REACHED
        self.now[ended & (self.now == Outcome.RUNNING)] = Outcome.OUT_OF_TIME
        self._successes.extend((self.now[ended] == Outcome.REACHED).tolist())

    def gauges(self) -> Mapping[str, float]:
        """Returns the share of recent episodes that succeeded, where there were any."""
        return {"success_rate": float(np.mean(self._successes))} if self._successes else {}
