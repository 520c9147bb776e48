"""What commands do to a plant: which values its drives take, and when, after delays and lags.

Shape letters: C commands, J joints, K time steps, T instants.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.effects.delays import MOST_S
from gfm.sim.plant import Plant
from gfm.sim.segment import Segment

#: How long before a segment commands are looked at: delays and lags remember them, s.
HISTORY_S = 0.6
#: How long after it: their clock may be behind that of the measurements, s.
AHEAD_S = MOST_S
#: Time over which commands are averaged at an instant, s: predictions are smooth in a delay, and no
#: drive tells when it takes a command more exactly.
UNCERTAIN_S = 5e-4
#: How exactly stamps are told apart, s.
EXACT_S = 5e-5


class InForce(NamedTuple):
    """Under which commands efforts are measured, of those of nearly the same stamp.

    Attributes:
        ahead_s: Up to how much later than an effort such a command may be stamped, s; negative: so
            much earlier it has to be. Infinite: all of them, or none.
        within_s: Time over which commands are averaged there, s.
    """

    ahead_s: float = -np.inf
    within_s: float = UNCERTAIN_S


BEFORE, AFTER = InForce(), InForce(ahead_s=np.inf)


def stepping_commands(plant: Plant, segment: Segment, steps: int) -> Array:
    """Returns the mean command of every time step after delays and lags, shape (K, J).

    A command that changes within a time step counts by its share of it, so that predictions are
    smooth in a delay.
    """
    grid = plant.model.opt.timestep * np.arange(steps + 1)
    integrals = np.stack([taken.integral(grid) for taken in _taken(plant, segment)], axis=1)
    return np.asarray(np.diff(integrals, axis=0) / plant.model.opt.timestep)


def commands_between(plant: Plant, recording: Trajectory, start: Array, end: Array) -> Array:
    """Returns the mean commands from each start to its end after delays and lags, shape (T, J)."""
    columns = [taken.mean(start, end) for taken in _taken(plant, recording)]
    return np.stack(columns, axis=1)


def commands_at(plant: Plant, segment: Segment, at: Array, in_force: InForce) -> Array:
    """Returns the commands under which efforts are measured at given times, shape (T, J).

    After delays and lags.
    """
    ahead_s, within_s = in_force
    apart_s = float(np.clip(ahead_s, -segment.same_stamp_s, segment.same_stamp_s))
    beyond_s = 0.5 * within_s * np.sign(ahead_s - apart_s)
    columns = [taken.at(at + apart_s, beyond_s, within_s) for taken in _taken(plant, segment)]
    return np.stack(columns, axis=1)


def since_commands(plant: Plant, segment: Segment, at: Array) -> Array:
    """Returns how long after the nearest command times are, s, shape (T, J); negative: before it.

    After delays.
    """
    columns = [taken.since(at) for taken in _taken(plant, segment)]
    return np.stack(columns, axis=1)


def best_in_force(since_s: Array, before: Array, after: Array) -> InForce:
    """Returns under which commands efforts are measured that have nearly their stamp.

    Stamps that jitter may tell it apart from one effort to the next.

    Args:
        since_s: How long after its command each effort is stamped, s, shape (N,).
        before: How far off a prediction is under the command before that, shape (N,).
        after: The same under the command itself, shape (N,).
    """
    order = np.argsort(since_s)
    apart = np.diff(since_s[order], prepend=-np.inf, append=np.inf)
    missed = np.cumsum(np.append(0.0, (before - after)[order]))
    last = len(order) - int(np.argmin(np.where(apart > EXACT_S, missed, np.inf)[::-1]))
    if not 0 < last < len(order):
        return AFTER if last < len(order) else BEFORE
    middle_s = float(since_s[order][last - 1 : last + 1].mean())
    return InForce(ahead_s=-middle_s, within_s=min(float(apart[last]), UNCERTAIN_S))


def _taken(plant: Plant, commanded: Segment | Trajectory) -> Iterator[_Taken]:
    """Yields what the drive of each joint takes."""
    for j, name in enumerate(plant.joints):
        here = [e for e in plant.effects if name in e.joints and not e.in_model]
        time_s = commanded.command_time_s
        for instance in here:
            time_s = instance.effect.retime(time_s, instance.values)
        lag_s = sum(e.effect.lag_s(e.values) for e in here)
        yield _Taken(time_s=time_s, value=commanded.command[:, j], lag_s=lag_s)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Taken:
    """Commands that are held from each time to the next, and a first-order lag behind them.

    Attributes:
        time_s: Before the first, its value is held, shape (C,).
        value: shape (C,).
        lag_s: Time constant; none at zero.
    """

    time_s: Array
    value: Array
    lag_s: float

    def mean(self, start: Array, end: Array) -> Array:
        """Returns the mean from each start to its end, shape (T,)."""
        return np.asarray((self.integral(end) - self.integral(start)) / (end - start))

    def at(self, at: Array, beyond_s: float, within_s: float) -> Array:
        """Returns what is taken at given times, or that much beyond them, shape (T,)."""
        if self.lag_s > 0.0:
            return self._lagging(at)
        start = at + beyond_s - 0.5 * within_s
        return self.mean(start, start + within_s)

    def since(self, at: Array) -> Array:
        """Returns how long after the nearest command times are, s, shape (T,)."""
        i = self._in_force(at)
        since, still = at - self.time_s[i], np.append(self.time_s, np.inf)[i + 1] - at
        return np.where(still < since, -still, since)

    def integral(self, at: Array) -> Array:
        """Returns the integral over time up to given times, shape (T,)."""
        i = self._in_force(at)
        whole = np.concatenate([[0.0], np.cumsum(self.value[:-1] * np.diff(self.time_s))])
        held = whole[i] + self.value[i] * (at - self.time_s[i])
        # lag y' = u - y: the integral of y is that of u less what is still to come.
        return np.asarray(held - self.lag_s * self._lagging(at) if self.lag_s > 0.0 else held)

    def _lagging(self, at: Array) -> Array:
        """Returns the lag's answer at given times, shape (T,)."""
        decays = np.exp(-np.diff(self.time_s) / self.lag_s)
        held = zip(self.value[:-1], decays, strict=True)
        levels = accumulate(held, lambda y, h: h[0] + (y - h[0]) * h[1], initial=self.value[0])
        i = self._in_force(at)
        left = (np.array(list(levels)) - self.value)[i]
        since = np.maximum(at - self.time_s[i], 0.0)
        return np.asarray(self.value[i] + left * np.exp(-since / self.lag_s))

    def _in_force(self, at: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.time_s, at, side="right") - 1, 0, None)
