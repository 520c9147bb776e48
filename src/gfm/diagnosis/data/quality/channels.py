"""What single signals say: channels that are dead or stand still, commands that echo, rounding.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.core.rounding import resolution
from gfm.diagnosis.data.noise import noise_std
from gfm.diagnosis.data.quality.finding import Finding, Objection, finding

#: A command that moves by so much while the joint does not: more than any dry friction holds
#: against a servo that works, rad.
STUCK_RAD = 0.2
#: Less noise than this is none: a simulation's, rad.
LEAST_NOISE_RAD = 1e-7
#: Measurements that equal the command, as a share, from which it is an echo; and how exactly.
ECHO, EXACTLY = 0.95, 1e-6


def stuck_position(recording: Trajectory) -> Objection | None:
    """Objects to a joint whose position never changes while its command demands a motion."""
    if recording.command_kind is CommandKind.EFFORT:
        return None
    demanded = np.where(recording.gains > 0.0, _demanded_motion(recording), 0.0)
    still = np.ptp(recording.position, axis=0) == 0.0
    for j in np.flatnonzero(still & (demanded > STUCK_RAD)):
        return Objection(
            where=f"position of {recording.joint_names[j]}",
            problem=f"never changes while the command demands {demanded[j]:.3g} rad of motion",
            expected="measurements (is the joint locked, or the channel dead?)",
        )
    return None


def _demanded_motion(recording: Trajectory) -> Array:
    """Returns how far the commands would move each joint: peak to peak, rad, shape (J,)."""
    if recording.command_kind is CommandKind.POSITION:
        return np.asarray(np.ptp(recording.held_command, axis=0))
    steps = recording.held_command[:-1] * np.diff(recording.time_s)[:, None]
    return np.asarray(np.ptp(np.cumsum(steps, axis=0), axis=0))


def stuck_effort(recording: Trajectory) -> Objection | None:
    """Objects to efforts that are the same number throughout: many drivers fill in zeros."""
    effort = recording.effort
    if effort is None or np.ptp(effort, axis=0).any():
        return None
    moves = np.ptp(recording.position, axis=0).any()
    silent = recording.command_kind is CommandKind.EFFORT and not recording.command.any()
    if not moves or not recording.gains.any() or silent:
        return None
    return Objection(
        where="effort",
        problem=f"is {effort[0, 0] + 0.0:.3g} throughout on every joint while the robot moves",
        expected="measured torques, or an empty field where nothing measures them",
    )


def dead_positions(recordings: Sequence[Trajectory]) -> tuple[int, Objection] | None:
    """Objects to a position without any noise on a robot whose encoders have noise.

    A joint that rests shows its noise. One that shows none, in a recording whose commands move it,
    was not measured: told by the same joint elsewhere, or by all other joints there.

    Returns:
        Which of the recordings, and why; None where all are alive.
    """
    alive = np.array([_alive(recording.time_s, recording.position) for recording in recordings])
    for i, recording in enumerate(recordings):
        told = np.ptp(recording.command, axis=0) > 0.0
        for j in np.flatnonzero(told & (np.ptp(recording.position, axis=0) == 0.0)):
            others = np.delete(alive[i], j)
            if alive[:, j].any() or (len(others) and others.all()):
                return i, Objection(
                    where=f"position of {recording.joint_names[j]}",
                    problem="never changes, not even by the noise that it or all others have",
                    expected="measurements (is the channel dead?)",
                )
    return None


def _alive(time_s: Array, position: Array) -> Array:
    """Returns which columns have noise that rounding does not hide, shape (J,)."""
    noise = noise_std(time_s, position)
    return np.asarray(noise > np.maximum(resolution(position), LEAST_NOISE_RAD))


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
