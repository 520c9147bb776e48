"""What a model says of a recording: whether efforts can be its torques, and where limits are.

A robot runs into limits where speeds and efforts have flat tops, and at the ends of joint ranges.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std
from gfm.core.rounding import resolution
from gfm.signals.finding import Finding, findings
from gfm.signals.smoothing import correlation, smooth_states
from gfm.signals.torques import TorqueView, torque_view
from gfm.sim.plant import Plant

#: Share of the measurements that must lie in a plateau, and how much fuller than the next level
#: it must be: a sine's top is 2.4 times as full, a triangle's as full.
PLATEAU, FULLER = 0.01, 8.0
#: How far from zero a plateau must be, in its thicknesses: joints rest.
FROM_ZERO = 5.0
#: What counts as the extreme, in percent, and how far beyond it a signal may go, in thicknesses:
#: filters overshoot at the ends of a plateau.
EXTREME, OVERSHOOT = 98.0, 4.0
#: How thick a plateau may be, as a share of the signal's whole span.
WIDEST = 0.1
#: Share of the demand's whole spread that it must still have where the signal is flat.
DEMAND_GOES_ON = 0.15
#: How much more than a speed commands must ask for, for the drive to be what limits it.
MORE = 1.2
#: A joint is at its limit when it is so close to it, as a share of the range.
AT_LIMIT = 1e-3
#: What a flat top means.
AT_ITS_LIMIT = "the drive is at a limit there: record with smaller commands as well"
#: Correlation that only the other sign explains.
OPPOSITE = -0.6


def views_of(recording: Trajectory, plant: Plant) -> tuple[TorqueView, TorqueView]:
    """Returns what the model says of a recording's torques, whatever its efforts say.

    Under the commands of the same stamps, and under those before.
    """
    alone = replace(recording, effort=None)
    half_ns = int(np.median(np.diff(recording.stamp_ns))) // 2
    # A view has the mean command of half a period before and after a stamp.
    after, before = (
        torque_view(plant, replace(alone, command_stamp_ns=alone.command_stamp_ns + later_ns))
        for later_ns in (-half_ns, half_ns)
    )
    return after, before


def doubtful_efforts(recording: Trajectory, view: TorqueView) -> list[Finding]:
    """Finds efforts that run against what the motion needs, in recordings that are not refused."""
    if recording.effort is None or not recording.gains.any():
        return []
    pairs = zip(recording.effort.T, view.needed.T, strict=True)
    alike = {j: correlation(*pair) for j, pair in enumerate(pairs)}
    against = {j: one for j, one in alike.items() if one < OPPOSITE}
    advice = "is its sign or its gravity compensation not the model's?"
    return findings(recording, "correlation of effort and needed torque", against, "", advice)


def cut_off_efforts(recording: Trajectory, effort: Array, drive: Array) -> list[Finding]:
    """Finds efforts that stay at their extreme while the drive is asked for more.

    A plateau alone is no saturation: dry friction makes plateaus. Where the demand still varies by
    a good part of its spread, it is one.

    Args:
        recording: The recording.
        effort: Measured, N m, shape (T, J).
        drive: What the model's actuators would do, N m, shape (T, J).
    """
    tops = _flat_tops(recording, effort, drive)
    return findings(recording, "effort has a flat top at", tops, "N m", AT_ITS_LIMIT)


def cut_off_speeds(recording: Trajectory) -> list[Finding]:
    """Finds speeds that stay at their extreme while commands ask for more, and errors grow."""
    if recording.command_kind is CommandKind.EFFORT:
        return []
    _, speed, _ = smooth_states(recording.time_s, recording.position)
    command = asked = recording.held_command
    if recording.command_kind is CommandKind.POSITION:
        _, asked, _ = smooth_states(recording.time_s, command)
        command = command - recording.position
    # Where commands ask for no speeds beyond a flat top, they have it themselves.
    tops = {
        j: top
        for j, top in _flat_tops(recording, speed, command).items()
        if (np.abs(asked[:, j]) > MORE * abs(top)).mean() > PLATEAU
    }
    return findings(recording, "speed has a flat top at", tops, "rad/s", AT_ITS_LIMIT)


def _flat_tops(recording: Trajectory, signal: Array, demand: Array) -> dict[int, float]:
    """Returns the extremes at which signals are cut off, by joint."""
    noise, step = noise_std(recording.time_s, signal), resolution(signal)
    width = np.maximum(np.maximum(6.0 * noise, step), 0.02 * np.ptp(signal, axis=0))
    tops = {j: _plateau(signal[:, j], demand[:, j], width[j]) for j in range(signal.shape[1])}
    return {j: top for j, top in tops.items() if top is not None}


def _plateau(signal: Array, demand: Array, width: float) -> float | None:
    """Returns the extreme at which a signal is cut off, or None; noise of `width` may hide it."""
    spread = _spread(demand)
    if width > WIDEST * np.ptp(signal):
        return None
    for sign in (1.0, -1.0):
        depth = np.percentile(sign * signal, EXTREME) - sign * signal
        top, next_level = np.abs(depth) < width, (depth >= width) & (depth < 2.0 * width)
        if not (top.mean() > PLATEAU and top.sum() > FULLER * max(next_level.sum(), 1)):
            continue
        moving = np.abs(np.median(signal[top])) > FROM_ZERO * width
        flat = moving and -depth.min() < OVERSHOOT * width
        if flat and _spread(demand[top]) > DEMAND_GOES_ON * spread > 0.0:
            return float(np.median(signal[top]))
    return None


def _spread(values: Array) -> float:
    """Returns between what bounds 90 % of some values lie."""
    return float(np.ptp(np.percentile(values, [5.0, 95.0])))


def at_range_limit(recording: Trajectory, plant: Plant) -> list[Finding]:
    """Finds joints that lie at, or beyond, a limit of their range in the model."""
    model, q = plant.model, recording.position
    joints = [model.joint(name).id for name in recording.joint_names]
    low, high = model.jnt_range[joints].T
    margin = AT_LIMIT * (high - low)
    shares = ((q < low + margin) | (q > high - margin)).mean(axis=0)
    there = np.flatnonzero((model.jnt_limited[joints] > 0) & (shares > PLATEAU)).tolist()
    advice = "at a limit of its range in the model: an end stop acts, not the drive alone"
    return findings(recording, "time spent", {j: 100.0 * shares[j] for j in there}, "%", advice)
