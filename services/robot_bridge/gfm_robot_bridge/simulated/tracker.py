"""The simulated cameras: where the object is, thirty times a second, late and with noise."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np

from gfm.core.checks import Array


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """How well the object is tracked.

    Attributes:
        period_ns: Between two looks.
        latency_ns: From a look until its pose is known.
        place_noise: Standard deviation of each coordinate, m.
        turn_noise: Of the rotation about each axis, rad.
        lost: Share of the looks in which it is not found.
    """

    period_ns: int = 33_333_333
    latency_ns: int = 50_000_000
    place_noise: float = 1e-3
    turn_noise: float = 1e-2
    lost: float = 0.02


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """A pose as it was told: m and quaternion w x y z, shape (7,), at a robot's time."""

    stamp_ns: int
    pose: Array


@final
class Tracker:
    """Looks at the object when it is due, and tells what is known by now.

    Args:
        tracking: How well.
        rng: Of noise and of what is lost.

    Attributes:
        next_ns: When it looks again.
    """

    def __init__(self, tracking: Tracking, rng: np.random.Generator) -> None:
        self.next_ns = 0
        self._tracking = tracking
        self._rng = rng
        self._under_way: deque[Tracked] = deque()
        self._known: Tracked | None = None

    def look(self, pose: Array) -> None:
        """Looks at the object now: at `next_ns`.

        Args:
            pose: Where it is, m and quaternion w x y z, shape (7,).
        """
        tracking, noise = self._tracking, self._rng.standard_normal(6)
        if self._rng.random() >= tracking.lost:
            told = pose.copy()
            told[:3] += tracking.place_noise * noise[:3]
            mujoco.mju_quatIntegrate(told[3:], tracking.turn_noise * noise[3:], 1.0)
            self._under_way.append(Tracked(stamp_ns=self.next_ns, pose=told))
        self.next_ns += tracking.period_ns

    def known(self, now_ns: int) -> Tracked | None:
        """Returns the newest pose that is known at a time; None before the first."""
        while self._under_way and self._under_way[0].stamp_ns + self._tracking.latency_ns <= now_ns:
            self._known = self._under_way.popleft()
        return self._known
