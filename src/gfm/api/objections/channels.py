"""Channels that were not measured: positions that stand still, efforts that are filled in.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.api.objections.objection import Objection
from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std
from gfm.core.rounding import resolution

#: A command that moves by so much while the joint does not: more than any dry friction holds
#: against a servo that works, rad.
STUCK_RAD = 0.2
#: Less noise than this is none: a simulation's, rad.
LEAST_NOISE_RAD = 1e-7


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
