"""What recordings have seen of each joint: simple statistics of how it moved.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.excitation.shapes import rounded

#: Over this time positions are averaged before they are differenced, s: coarse encoders (4096
#: steps a turn, read at 50 Hz) would show no slow motion, and so do velocities made from them.
_SMOOTHING_S = 0.2
#: Commands are looked at once in this time, s: steps stay steps, streams become smooth.
_COMMAND_S = 0.05
#: A joint moves that is faster than this share of its top speed, and than this, rad/s.
_MOVING_SHARE, _CREEPING_RAD_S = 0.1, 0.005
#: Slow, middling and fast: up to these shares of the top speed.
_BANDS = (0.2, 0.6)
#: Joints whose velocities are so correlated move as one.
_AS_ONE = 0.98


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """What recordings have seen of one joint.

    Attributes:
        joint: Its name.
        span: From the lowest to the highest position, rad.
        top_speed: 99th percentile, rad/s.
        reversals: Of its motion; noise at rest is none.
        bands_s: Time in which it moves slowly, middling and fast, s.
        backward: Share of the moving time that goes the rarer way, 0 to 0.5.
        motion_hz: Mean frequency of its motion (rms acceleration over rms velocity) in the
            recording in which that is highest.
        command_hz: Mean frequency of its command likewise; 0 where that is constant.
        beside_s: Longest time that it moves and another joint does, not as one, s.
        load_spread: While it moves, 10th to 90th percentile of the magnitude of its drive torque,
            over the latter; None where no torque was recorded.
        load_backward_s: Time in which that torque has the rarer sign, s; None likewise.
        peak_torque: Largest, N m; None likewise.
    """

    joint: str
    span: float
    top_speed: float
    reversals: int
    bands_s: tuple[float, float, float]
    backward: float
    motion_hz: float
    command_hz: float
    beside_s: float
    load_spread: float | None
    load_backward_s: float | None
    peak_torque: float | None


@dataclass(frozen=True, kw_only=True)
class _Signals:
    """All recordings, one after the other: shape (T, J); effort None where any lacks it.

    `period_s` is the time for which each measurement stands, `recording` counts them, shape (T,).
    """

    position: Array
    velocity: Array
    effort: Array | None
    period_s: Array
    recording: NDArray[np.intp]


def sightings(recordings: Sequence[Trajectory]) -> tuple[Sighting, ...]:
    """Returns what recordings, all with the same joints in one order, have seen of each joint."""
    signals = _signals(recordings)
    top = np.percentile(np.abs(signals.velocity), 99.0, axis=0)
    moving = np.abs(signals.velocity) > np.maximum(_MOVING_SHARE * top, _CREEPING_RAD_S)
    command_hz = np.max([_command_hz(one) for one in recordings], axis=0)
    motion_hz = np.max([_motion_hz(one) for one in recordings], axis=0)
    return tuple(
        Sighting(
            joint=name,
            span=float(np.ptp(signals.position[:, j])),
            top_speed=float(top[j]),
            reversals=_reversals(signals, moving[:, j], j),
            bands_s=_bands_s(signals, float(top[j]), j),
            backward=_rarer(signals.velocity[moving[:, j], j], signals.period_s[moving[:, j]])[1],
            motion_hz=float(motion_hz[j]),
            command_hz=float(command_hz[j]),
            beside_s=_beside_s(signals, moving, j),
            load_spread=None if signals.effort is None else _spread(signals.effort, moving, j),
            load_backward_s=None
            if signals.effort is None
            else _rarer(signals.effort[:, j], signals.period_s)[0],
            peak_torque=None if signals.effort is None else _peak(signals.effort[:, j]),
        )
        for j, name in enumerate(recordings[0].joint_names)
    )


def _signals(recordings: Sequence[Trajectory]) -> _Signals:
    efforts = [one.effort for one in recordings if one.effort is not None]
    periods = [np.full(len(one.stamp_ns), one.period_s) for one in recordings]
    numbers = [np.full(len(one.stamp_ns), i, np.intp) for i, one in enumerate(recordings)]
    return _Signals(
        position=np.concatenate([one.position for one in recordings]),
        velocity=np.concatenate([_rate(one.position, one.time_s) for one in recordings]),
        effort=np.concatenate(efforts) if len(efforts) == len(recordings) else None,
        period_s=np.concatenate(periods),
        recording=np.concatenate(numbers),
    )


def _rate(values: Array, time_s: Array) -> Array:
    """Returns the rate of smoothed values, shape (T, J)."""
    window_s = np.full(values.shape[1], _SMOOTHING_S)
    even = np.linspace(time_s[0], time_s[-1], len(time_s))
    return np.asarray(np.gradient(rounded(values, window_s, even), time_s, axis=0))


def _reversals(signals: _Signals, moving: NDArray[np.bool_], joint: int) -> int:
    """Returns how often the joint moves one way and then the other, within a recording."""
    direction = np.sign(signals.velocity[moving, joint])
    return int(np.sum((np.diff(direction) != 0) & (np.diff(signals.recording[moving]) == 0)))


def _bands_s(signals: _Signals, top: float, joint: int) -> tuple[float, float, float]:
    speed = np.abs(signals.velocity[:, joint])
    slow = (speed > _CREEPING_RAD_S) & (speed < _BANDS[0] * top)
    fast = speed >= _BANDS[1] * top
    middling = (speed >= _BANDS[0] * top) & ~fast
    passed = [float(signals.period_s[band].sum()) for band in (slow, middling, fast)]
    return passed[0], passed[1], passed[2]


def _rarer(values: Array, period_s: Array) -> tuple[float, float]:
    """Returns for how long values have the rarer sign, s, and as a share, 0 to 0.5."""
    positive_s, whole_s = float(period_s[values > 0.0].sum()), float(period_s.sum())
    rarer_s = min(positive_s, whole_s - positive_s)
    return rarer_s, rarer_s / max(whole_s, 1e-12)


def _motion_hz(recording: Trajectory) -> Array:
    velocity = _rate(recording.position, recording.time_s)
    return _frequency(velocity, _rate(velocity, recording.time_s))


def _command_hz(recording: Trajectory) -> Array:
    """Returns the rms rate of a command over its rms, as a frequency, shape (J,)."""
    issued_s = recording.command_time_s
    time_s = np.arange(issued_s[0], issued_s[-1] + _COMMAND_S, _COMMAND_S)
    command = recording.command[np.searchsorted(issued_s, time_s, side="right") - 1]
    rates = np.diff(command, axis=0, append=command[-1:]) / _COMMAND_S
    return _frequency(command - command.mean(axis=0), rates)


def _frequency(values: Array, rates: Array) -> Array:
    size = np.sqrt(np.mean(values**2, axis=0))
    rate = np.sqrt(np.mean(rates**2, axis=0))
    return np.asarray(np.where(size > 1e-9, rate / (2 * np.pi * np.maximum(size, 1e-9)), 0.0))


def _beside_s(signals: _Signals, moving: NDArray[np.bool_], joint: int) -> float:
    """Returns the longest time in which a joint and another move, not as one."""
    best_s = 0.0
    for other in range(moving.shape[1]):
        both = moving[:, joint] & moving[:, other]
        one, two = signals.velocity[both, joint], signals.velocity[both, other]
        size = float(np.sqrt((one @ one) * (two @ two)))
        if other != joint and abs(float(one @ two)) < _AS_ONE * size:
            best_s = max(best_s, float(signals.period_s[both].sum()))
    return best_s


def _spread(effort: Array, moving: NDArray[np.bool_], joint: int) -> float:
    if not moving[:, joint].any():
        return 0.0
    low, high = np.percentile(np.abs(effort[moving[:, joint], joint]), [10.0, 90.0])
    return float((high - low) / max(high, 1e-12))


def _peak(effort: Array) -> float:
    return float(np.percentile(np.abs(effort), 99.9))
