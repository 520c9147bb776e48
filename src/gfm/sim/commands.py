"""What commands do to a plant: which values its drives take, and when, after delays and lags.

Shape letters: C commands, J joints, K time steps, T instants.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate

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


def commands_at(plant: Plant, segment: Segment, at: Array, *, after: bool) -> Array:
    """Returns the commands in force just before or after given times, shape (T, J).

    After delays and lags.
    """
    columns = [taken.at(at, after=after) for taken in _taken(plant, segment)]
    return np.stack(columns, axis=1)


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

    def at(self, at: Array, *, after: bool) -> Array:
        """Returns what is taken just before or after given times, shape (T,)."""
        if self.lag_s > 0.0:
            return self._lagging(at)
        start = at if after else at - UNCERTAIN_S
        return self.mean(start, start + UNCERTAIN_S)

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
