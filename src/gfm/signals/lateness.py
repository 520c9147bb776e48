"""By how much the joints move later than they should: as commanded, or as a model predicts.

What can be told apart, and what cannot:

- Against the *command*, a joint's lateness is its dead time plus the lag of its servo and load: an
  upper bound of any delay, not a delay. Only a commanded torque, compared with a measured one, has
  nothing in between.
- Against a model's *prediction* the lag that the model knows is taken out. What is left is dead
  time, plus whatever lag the model is wrong about: to first order in frequency both are the same
  shift, and only a fit of both to fast motions tells them apart.
- A delay on the way to the robot, one on the way back, and an offset between the clocks of commands
  and measurements add up, and only their sum shows. It is what all joints share (`common_s`).
- What is left joint by joint (`own_s`) belongs to the joints. Where it falls, or rises, evenly
  along their order, the joints are read (or written) one after the other under one stamp
  (`per_joint_s`). Servos and loads differ along an arm as well, so this is only claimed against a
  prediction.

Shape letters: T measurements, J joints, B blocks.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.signal import savgol_filter
from scipy.stats import linregress, median_abs_deviation

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.signals.smoothing import SMOOTHING_S, evenly

#: Length of the segments whose lateness is measured one by one, s.
BLOCK_S = 3.0
#: Least and greatest lateness that is looked for, s. Effects come after their cause: what comes
#: before shows stamps that are wrong.
EARLIEST_S, LATEST_S = -0.1, 0.5
#: Least number of blocks, and least correlation of speeds at the best shift, that say anything.
LEAST_BLOCKS, ALIKE = 2, 0.8
#: Torques are compared by their fast changes (slow ones differ by more than time: a controller of
#: the current, friction in its estimate), which leave more noise. Smoothed over, s; correlation.
SHARP_S, SHARP_ALIKE = 0.01, 0.5
#: A line along the joints must have so many, explain so much of their differences, have a slope so
#: many of its errors from zero, and be of a size that reading a joint takes, s.
LEAST_JOINTS, EXPLAINS, ERRORS, PER_JOINT_S = 4, 0.8, 4.0, (2e-4, 8e-3)


@dataclass(frozen=True, kw_only=True)
class Delays:
    """The lateness of every joint against one reference.

    Attributes:
        joints: In the order of the arrays.
        reference: "command" or "prediction".
        seconds: Median over the blocks, NaN where too few say anything, shape (J,).
        spread_s: Standard deviation over the blocks (robust), shape (J,).
        blocks: How many blocks say something, shape (J,).
    """

    joints: tuple[str, ...]
    reference: str
    seconds: Array
    spread_s: Array
    blocks: Array

    @property
    def error_s(self) -> Array:
        """Standard error of `seconds`, shape (J,)."""
        return np.asarray(1.25 * self.spread_s / np.sqrt(np.maximum(self.blocks, 1)))

    @property
    def common_s(self) -> float:
        """What the joints share: their median; NaN where nothing is known."""
        known = self.seconds[np.isfinite(self.seconds)]
        return float(np.median(known)) if len(known) else float("nan")

    @property
    def own_s(self) -> Array:
        """What is left of each joint's lateness without the common part, shape (J,)."""
        return np.asarray(self.seconds - self.common_s)

    @property
    def per_joint_s(self) -> float | None:
        """How lateness changes from one joint to the next, where it does so evenly; else None."""
        known = np.flatnonzero(np.isfinite(self.seconds))
        if self.reference != "prediction" or len(known) < LEAST_JOINTS:
            return None
        line = linregress(known, self.seconds[known])
        own = float(np.median(self.error_s[known])) / (np.std(known) * np.sqrt(len(known)))
        even = line.rvalue**2 > EXPLAINS and abs(line.slope) > ERRORS * (line.stderr + own)
        low, high = PER_JOINT_S
        return float(line.slope) if even and low < abs(line.slope) < high else None


def delays(recordings: Sequence[Trajectory], predictions: Sequence[Array] | None = None) -> Delays:
    """Returns by how much later every joint moves than commanded, or than predicted.

    Args:
        recordings: Of one robot. A recording with a drive that is off says nothing of its joint.
        predictions: For each recording the positions that a model predicts at its measurements,
            rad, shape (T, J), NaN where there are none; without any, commands are taken.
    """
    told: Sequence[Array | None] = predictions or [None] * len(recordings)
    pairs, joints = list(zip(recordings, told, strict=True)), recordings[0].joint_names
    found = [[late for pair in pairs for late in _of_joint(*pair, j)] for j in range(len(joints))]
    enough = [late if len(late) >= LEAST_BLOCKS else [np.nan] for late in found]
    return Delays(
        joints=joints,
        reference="command" if predictions is None else "prediction",
        seconds=np.array([np.median(late) for late in enough]),
        spread_s=np.array([median_abs_deviation(late, scale="normal") for late in enough]),
        blocks=np.array([len(late) for late in found]),
    )


def _of_joint(recording: Trajectory, prediction: Array | None, joint: int) -> Iterator[float]:
    """Yields the lateness of one joint, block by block, s."""
    torques = prediction is None and recording.command_kind is CommandKind.EFFORT
    measured = recording.effort if torques else recording.position
    if recording.gains[joint] == 0.0 or measured is None:
        return
    columns = [measured[:, joint], *([] if prediction is None else [prediction[:, joint]])]
    if not np.isfinite(columns).all():
        return
    period_s, reference, answer = _pair(recording, joint, columns, torques=torques)
    before, after = _margins(period_s)
    size = max(round(BLOCK_S / period_s), 1)
    for start in range(0, len(answer) - size // 2, size):
        block = answer[start : start + size]
        around = reference[start : start + len(block) + before + after]
        late = _shift(around, block, SHARP_ALIKE if torques else ALIKE)
        if late is not None:
            yield period_s * (before - late)


def _shift(reference: Array, block: Array, least: float) -> float | None:
    """Returns at which row of `reference` a block fits best, between the rows.

    None where no place is better than the ends, or as good as a correlation of `least`.
    """
    windows = np.lib.stride_tricks.sliding_window_view(reference, len(block))
    centred = block - block.mean()
    spread = np.sqrt(np.maximum(windows.var(axis=1) * len(block), 0.0)) * np.linalg.norm(centred)
    if len(windows) < 3 or not spread.min() > 1e-12:
        return None
    alike = windows @ centred / spread
    best = int(alike.argmax())
    if alike[best] < least or best in (0, len(alike) - 1):
        return None
    left, middle, right = alike[best - 1 : best + 2]
    return best + 0.5 * float(left - right) / float(left - 2.0 * middle + right)


def _pair(
    recording: Trajectory, joint: int, columns: Sequence[Array], *, torques: bool
) -> tuple[float, Array, Array]:
    """Returns a sampling period, what a joint should do with margins, and what it does.

    Speeds are compared where positions or speeds are, and changes of torques where torques are.

    Args:
        recording: Whose commands are taken where nothing is predicted.
        joint: Its number.
        columns: What was measured, and what is predicted if that is compared, shape (T,) each.
        torques: Whether that is torques.
    """
    grid, even = evenly(recording.time_s, np.stack(columns, axis=1))
    period_s, order = grid[1] - grid[0], 1
    before, after = _margins(period_s)
    times = grid[0] + period_s * np.arange(-before, len(grid) + after)
    if len(columns) > 1:
        reference = np.interp(times, grid, even[:, 1])
    else:
        reference = _held_means(times, recording.command_time_s, recording.command[:, joint])
        order = 0 if recording.command_kind is CommandKind.VELOCITY else 1
    smooth = partial(_smooth, period_s=period_s, over_s=SHARP_S if torques else SMOOTHING_S)
    return period_s, smooth(reference, order=order), smooth(even[:, 0], order=1)


def _margins(period_s: float) -> tuple[int, int]:
    """Returns how many rows a shift may reach before and after a grid."""
    return round(LATEST_S / period_s), round(-EARLIEST_S / period_s)


def _held_means(times: Array, command_time_s: Array, command: Array) -> Array:
    """Returns the means of held commands over a period around each time, shape as `times`.

    A held command takes effect half of its period later, on average, than a line through its points
    would: this counts it as held.
    """
    half = 0.5 * (times[1] - times[0])
    first = min(float(command_time_s[0]), float(times[0])) - 1.0
    last = max(float(command_time_s[-1]), float(times[-1])) + 1.0
    knots = np.concatenate([[first], command_time_s, [last]])
    held = np.concatenate([[command[0]], command])
    integral = np.concatenate([[0.0], np.cumsum(held * np.diff(knots))])
    ends = np.interp(times + half, knots, integral), np.interp(times - half, knots, integral)
    return np.asarray((ends[0] - ends[1]) / (2.0 * half))


def _smooth(signal: Array, period_s: float, order: int, over_s: float) -> Array:
    """Returns a derivative; both signals are smoothed alike, so that no shift comes from it."""
    window = max(round(over_s / period_s) | 1, 5)
    return np.asarray(savgol_filter(signal, window, 3, deriv=order, delta=period_s))
