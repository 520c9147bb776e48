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

#: Over this time positions are averaged before they are differenced, s.
_SMOOTHING_S = 0.05
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
        bands: Shares of the time in which it moves slowly, middling and fast.
        backward: Share of the moving time that goes the rarer way, 0 to 0.5.
        motion_hz: Mean frequency of its motion: rms acceleration over rms velocity.
        command_hz: Mean frequency of its command; 0 where that is constant.
        beside: Largest share of its moving time in which another joint moves, and not as one.
        load_spread: While it moves, 10th to 90th percentile of the magnitude of its drive torque,
            over the latter; None where no torque was recorded.
        load_backward: Share of the time in which that torque has the rarer sign; None likewise.
        peak_torque: Largest, N m; None likewise.
    """

    joint: str
    span: float
    top_speed: float
    reversals: int
    bands: tuple[float, float, float]
    backward: float
    motion_hz: float
    command_hz: float
    beside: float
    load_spread: float | None
    load_backward: float | None
    peak_torque: float | None


@dataclass(frozen=True, kw_only=True)
class _Signals:
    """All recordings, one after the other: shape (T, J); effort None where any lacks it."""

    position: Array
    velocity: Array
    effort: Array | None
    first: NDArray[np.bool_]


def sightings(recordings: Sequence[Trajectory]) -> tuple[Sighting, ...]:
    """Returns what recordings, all with the same joints in one order, have seen of each joint."""
    signals = _signals(recordings)
    top = np.percentile(np.abs(signals.velocity), 99.0, axis=0)
    moving = np.abs(signals.velocity) > np.maximum(_MOVING_SHARE * top, _CREEPING_RAD_S)
    command_hz = _command_hz(recordings)
    motion_hz = _motion_hz(recordings)
    return tuple(
        Sighting(
            joint=name,
            span=float(np.ptp(signals.position[:, j])),
            top_speed=float(top[j]),
            reversals=_reversals(signals, moving[:, j], j),
            bands=_bands(signals.velocity[:, j], float(top[j])),
            backward=_rarer(signals.velocity[moving[:, j], j]),
            motion_hz=float(motion_hz[j]),
            command_hz=float(command_hz[j]),
            beside=_beside(signals.velocity, moving, j),
            load_spread=None if signals.effort is None else _spread(signals.effort, moving, j),
            load_backward=None if signals.effort is None else _rarer(signals.effort[:, j]),
            peak_torque=None if signals.effort is None else _peak(signals.effort[:, j]),
        )
        for j, name in enumerate(recordings[0].joint_names)
    )


def _signals(recordings: Sequence[Trajectory]) -> _Signals:
    efforts = [one.effort for one in recordings if one.effort is not None]
    firsts = [np.arange(len(one.stamp_ns)) == 0 for one in recordings]
    return _Signals(
        position=np.concatenate([one.position for one in recordings]),
        velocity=np.concatenate([_velocity(one) for one in recordings]),
        effort=np.concatenate(efforts) if len(efforts) == len(recordings) else None,
        first=np.concatenate(firsts),
    )


def _velocity(recording: Trajectory) -> Array:
    """Returns the measured velocity, or that of the smoothed positions, rad/s, shape (T, J)."""
    if recording.velocity is not None:
        return recording.velocity
    return _rate(recording.position, recording.time_s)


def _rate(values: Array, time_s: Array) -> Array:
    """Returns the rate of smoothed values, shape (T, J)."""
    window_s = np.full(values.shape[1], _SMOOTHING_S)
    even = np.linspace(time_s[0], time_s[-1], len(time_s))
    return np.asarray(np.gradient(rounded(values, window_s, even), time_s, axis=0))


def _reversals(signals: _Signals, moving: NDArray[np.bool_], joint: int) -> int:
    """Returns how often the joint moves one way and then the other, within a recording."""
    recording = np.cumsum(signals.first)[moving]
    direction = np.sign(signals.velocity[moving, joint])
    return int(np.sum((np.diff(direction) != 0) & (np.diff(recording) == 0)))


def _bands(velocity: Array, top: float) -> tuple[float, float, float]:
    speed = np.abs(velocity)
    share = speed / max(top, 1e-12)
    slow = (speed > _CREEPING_RAD_S) & (share < _BANDS[0])
    middling = (share >= _BANDS[0]) & (share < _BANDS[1])
    return float(slow.mean()), float(middling.mean()), float((share >= _BANDS[1]).mean())


def _rarer(values: Array) -> float:
    """Returns the share of the rarer sign, 0 to 0.5."""
    if not len(values):
        return 0.0
    positive = float((values > 0.0).mean())
    return min(positive, 1.0 - positive)


def _motion_hz(recordings: Sequence[Trajectory]) -> Array:
    """Returns rms acceleration over rms velocity, as a frequency, shape (J,)."""
    velocities = [_velocity(one) for one in recordings]
    rates = [_rate(v, one.time_s) for v, one in zip(velocities, recordings, strict=True)]
    return _frequency(np.concatenate(velocities), np.concatenate(rates))


def _command_hz(recordings: Sequence[Trajectory]) -> Array:
    """Returns the rms rate of the commands over their rms, as a frequency, shape (J,)."""
    values, rates = [], []
    for one in recordings:
        time_s = np.arange(one.command_time_s[0], one.command_time_s[-1], _COMMAND_S)
        if len(time_s) < 2:
            continue
        held = np.searchsorted(one.command_time_s, time_s, side="right") - 1
        command = one.command[held]
        values.append(command - command.mean(axis=0))
        rates.append(np.diff(command, axis=0) / _COMMAND_S)
    if not values:
        return np.zeros(len(recordings[0].joint_names))
    return _frequency(np.concatenate(values), np.concatenate(rates))


def _frequency(values: Array, rates: Array) -> Array:
    size = np.sqrt(np.mean(values**2, axis=0))
    rate = np.sqrt(np.mean(rates**2, axis=0))
    return np.asarray(np.where(size > 1e-9, rate / (2 * np.pi * np.maximum(size, 1e-9)), 0.0))


def _beside(velocity: Array, moving: NDArray[np.bool_], joint: int) -> float:
    """Returns the largest share of a joint's moving time in which another moves, not as one."""
    own, best = moving[:, joint], 0.0
    for other in range(velocity.shape[1]):
        both = own & moving[:, other]
        if other == joint or both.sum() < 3:
            continue
        one, two = velocity[both, joint], velocity[both, other]
        size = float(np.sqrt((one @ one) * (two @ two)))
        if abs(float(one @ two)) < _AS_ONE * size:
            best = max(best, float(both.sum() / own.sum()))
    return best


def _spread(effort: Array, moving: NDArray[np.bool_], joint: int) -> float:
    if not moving[:, joint].any():
        return 0.0
    low, high = np.percentile(np.abs(effort[moving[:, joint], joint]), [10.0, 90.0])
    return float((high - low) / max(high, 1e-12))


def _peak(effort: Array) -> float:
    return float(np.percentile(np.abs(effort), 99.9))
