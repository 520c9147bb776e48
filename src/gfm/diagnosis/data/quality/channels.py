"""What single signals say: channels that stand still, commands that echo, rounding, odd units.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std
from gfm.core.rounding import resolution
from gfm.diagnosis.data.quality.finding import Finding, findings
from gfm.diagnosis.data.signals import correlation, slope, smooth_states

#: Measurements that equal the command, as a share, from which it is an echo; and how exactly.
ECHO, EXACTLY = 0.95, 1e-6
#: How closely two signals must follow each other for their ratio to mean a unit.
FOLLOWS = 0.8


def still(recording: Trajectory) -> list[Finding]:
    """Finds joints whose position or command never changes."""
    position, command = (
        {j: values[0, j] for j in np.flatnonzero(np.ptp(values, axis=0) == 0.0).tolist()}
        for values in (recording.position, recording.command)
    )
    silent, idle = "says nothing of its dynamics", "not excited on purpose"
    return [
        *findings(recording, "position never changes", position, "", silent),
        *findings(recording, "command never changes", command, "", idle, doubtful=False),
    ]


def rounded(recording: Trajectory) -> list[Finding]:
    """Finds the step to which positions are rounded, where it is no less than their noise."""
    steps = resolution(recording.position)
    noise = noise_std(recording.time_s, recording.position)
    seen = np.flatnonzero((steps > 0.0) & (steps > noise)).tolist()
    coarse = {j: 1e3 * steps[j] for j in seen}
    advice = "no error below a third of it can be seen"
    return findings(recording, "encoder step", coarse, "mrad", advice, doubtful=False)


def echoed(recording: Trajectory) -> list[Finding]:
    """Finds commands that are the measurements themselves, a measurement earlier or later."""
    measured = {
        CommandKind.POSITION: recording.position,
        CommandKind.VELOCITY: recording.velocity,
        CommandKind.EFFORT: recording.effort,
    }[recording.command_kind]
    if measured is None:
        return []
    command = recording.held_command
    shares = {
        j: max(_equal(command[:, j], measured[:, j], shift) for shift in (-2, -1, 0, 1, 2))
        for j in np.flatnonzero(np.ptp(measured, axis=0) > 100.0 * EXACTLY).tolist()
    }
    echoes = {j: 100 * share for j, share in shares.items() if share > ECHO}
    advice = "the command looks like an echo of the measurement: record what the robot was told"
    return findings(recording, "command equals measurement", echoes, "%", advice)


def _equal(command: Array, measured: Array, shift: int) -> float:
    """Returns the share of changing measurements that equal the command `shift` rows on."""
    rolled = np.roll(command, shift)[3:-3]
    changing = np.diff(measured)[2:-3] != 0.0
    if changing.sum() < 20:
        return 0.0
    return float((np.abs(rolled - measured[3:-3]) < EXACTLY)[changing].mean())


def odd_velocities(recording: Trajectory) -> list[Finding]:
    """Finds velocities that follow the position's slope at another scale."""
    odd = {
        recording.joint_names.index(name): ratio
        for name, ratio in velocity_ratios(recording).items()
        if not 0.5 < ratio < 2.0
    }
    advice = "1 expected: another unit (rpm is 9.55)? velocities are not used"
    return findings(recording, "velocity over the position's slope", odd, "", advice)


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
