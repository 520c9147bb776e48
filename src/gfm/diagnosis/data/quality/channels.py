"""What single signals say: channels that stand still, commands that echo, rounding, odd units.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std
from gfm.core.rounding import resolution
from gfm.diagnosis.data.quality.finding import Finding, finding
from gfm.diagnosis.data.signals import correlation, slope, smooth_states

#: Measurements that equal the command, as a share, from which it is an echo; and how exactly.
ECHO, EXACTLY = 0.95, 1e-6
#: How closely two signals must follow each other for their ratio to mean a unit.
FOLLOWS = 0.8


def still(recording: Trajectory) -> list[Finding]:
    """Finds joints whose position or command never changes."""
    signals = (
        ("position never changes", recording.position, "says nothing of its dynamics", True),
        ("command never changes", recording.command, "not excited on purpose", False),
    )
    return [
        finding(recording, what, values[0, j], "", advice, joint=j, doubtful=doubtful)
        for what, values, advice, doubtful in signals
        for j in np.flatnonzero(np.ptp(values, axis=0) == 0.0)
    ]


def rounded(recording: Trajectory) -> list[Finding]:
    """Finds the step to which positions are rounded, where it is no less than their noise."""
    steps = resolution(recording.position)
    noise = noise_std(recording.time_s, recording.position)
    what, advice = "encoder step", "no error below a third of it can be seen"
    return [
        finding(recording, what, 1e3 * steps[j], "mrad", advice, joint=j, doubtful=False)
        for j in np.flatnonzero((steps > 0.0) & (steps > noise))
    ]


def echoed(recording: Trajectory) -> list[Finding]:
    """Finds commands that are the measurements themselves, a measurement earlier or later."""
    measured = {
        CommandKind.POSITION: recording.position,
        CommandKind.VELOCITY: recording.velocity,
        CommandKind.EFFORT: recording.effort,
    }[recording.command_kind]
    if measured is None:
        return []
    command, what = recording.held_command, "command equals measurement"
    advice = "the command looks like an echo of the measurement: record what the robot was told"
    shares = {
        j: max(_equal(command[:, j], measured[:, j], shift) for shift in (-2, -1, 0, 1, 2))
        for j in np.flatnonzero(np.ptp(measured, axis=0) > 100.0 * EXACTLY)
    }
    return [
        finding(recording, what, 100 * share, "%", advice, joint=j)
        for j, share in shares.items()
        if share > ECHO
    ]


def _equal(command: Array, measured: Array, shift: int) -> float:
    """Returns the share of changing measurements that equal the command `shift` rows on."""
    rolled = np.roll(command, shift)[3:-3]
    changing = np.diff(measured)[2:-3] != 0.0
    if changing.sum() < 20:
        return 0.0
    return float((np.abs(rolled - measured[3:-3]) < EXACTLY)[changing].mean())


def odd_velocities(recording: Trajectory) -> list[Finding]:
    """Finds velocities that follow the position's slope at another scale."""
    what = "velocity over the position's slope"
    advice = "1 expected: another unit (rpm is 9.55)? velocities are not used"
    return [
        finding(recording, what, ratio, "", advice, joint=recording.joint_names.index(name))
        for name, ratio in velocity_ratios(recording).items()
        if not 0.5 < ratio < 2.0
    ]


def velocity_ratios(recording: Trajectory) -> dict[str, float]:
    """Returns velocity over d position / dt, by joint, where they follow each other."""
    if recording.velocity is None:
        return {}
    _, speed, _ = smooth_states(recording.time_s, recording.position)
    pairs = zip(recording.joint_names, recording.velocity.T, speed.T, strict=True)
    return {
        name: float(slope(told, seen))
        for name, told, seen in pairs
        if abs(correlation(told, seen)) > FOLLOWS
    }
