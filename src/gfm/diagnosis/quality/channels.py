"""What single signals say: resolution, flat tops, channels that stand still, commands that echo.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.quality.finding import Finding, Objection, held_command
from gfm.diagnosis.signals import evenly, noise_std, resolution, smooth_states
from gfm.sim.plant import Plant

#: A command that moves by so much while the joint does not: more than any dry friction holds
#: against a servo that works, rad.
STUCK_RAD = 0.2
#: Less noise than this is none: a simulation's, rad.
LEAST_NOISE_RAD = 1e-7
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
#: Measurements that equal the command, as a share, from which it is an echo; and how exactly.
ECHO, EXACTLY = 0.95, 1e-6


def stuck_position(recording: Trajectory) -> Objection | None:
    """Objects to a joint whose position never changes while its command demands a motion."""
    if recording.command_kind is CommandKind.EFFORT:
        return None
    demanded = _demanded_motion(recording)
    for j, name in enumerate(recording.joint_names):
        driven = recording.servo_gain.get(name, 1.0) > 0.0
        still = float(np.ptp(recording.position[:, j])) == 0.0
        if driven and still and demanded[j] > STUCK_RAD:
            return Objection(
                where=f"position of {name}",
                problem=f"never changes while the command demands {demanded[j]:.3g} rad of motion",
                expected="measurements (is the joint locked, or the channel dead?)",
            )
    return None


def _demanded_motion(recording: Trajectory) -> Array:
    """Returns how far the commands would move each joint: peak to peak, rad, shape (J,)."""
    if recording.command_kind is CommandKind.POSITION:
        return np.asarray(np.ptp(held_command(recording), axis=0))
    steps = held_command(recording)[:-1] * np.diff(recording.time_s)[:, None]
    return np.asarray(np.ptp(np.cumsum(steps, axis=0), axis=0))


def stuck_effort(recording: Trajectory) -> Objection | None:
    """Objects to efforts that are the same number throughout: many drivers fill in zeros."""
    effort = recording.effort
    if effort is None or np.ptp(effort, axis=0).any():
        return None
    moves = np.ptp(recording.position, axis=0).any()
    on = any(recording.servo_gain.get(name, 1.0) > 0.0 for name in recording.joint_names)
    silent = recording.command_kind is CommandKind.EFFORT and not recording.command.any()
    if not moves or not on or silent:
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
    alive = np.array([_alive(recording.position) for recording in recordings])
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


def _alive(position: Array) -> Array:
    """Returns which columns have noise that rounding does not hide, shape (J,)."""
    return np.asarray(noise_std(position) > np.maximum(resolution(position), LEAST_NOISE_RAD))


def still(recording: Trajectory) -> list[Finding]:
    """Finds joints whose position or command never changes."""
    signals = (
        ("position never changes", recording.position, "says nothing of its dynamics", True),
        ("command never changes", recording.command, "not excited on purpose", False),
    )
    return [
        _finding(recording, int(j), what, values[0, j], "", advice, doubtful=doubtful)
        for what, values, advice, doubtful in signals
        for j in np.flatnonzero(np.ptp(values, axis=0) == 0.0)
    ]


def rounded(recording: Trajectory) -> list[Finding]:
    """Finds the step to which positions are rounded, where it is no less than their noise."""
    steps = resolution(recording.position)
    noise = noise_std(evenly(recording.time_s, recording.position)[1])
    advice = "no error below a third of it can be seen"
    return [
        _finding(recording, int(j), "encoder step", 1e3 * steps[j], "mrad", advice, doubtful=False)
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
    command = held_command(recording)
    advice = "the command looks like an echo of the measurement: record what the robot was told"
    found = []
    for j in np.flatnonzero(np.ptp(measured, axis=0) > 100.0 * EXACTLY):
        share = max(_equal(command[:, j], measured[:, j], shift) for shift in (-2, -1, 0, 1, 2))
        if share > ECHO:
            found.append(
                _finding(recording, int(j), "command equals measurement", 100 * share, "%", advice)
            )
    return found


def _equal(command: Array, measured: Array, shift: int) -> float:
    """Returns the share of changing measurements that equal the command `shift` rows on."""
    rolled = np.roll(command, shift)[3:-3]
    changing = np.diff(measured)[2:-3] != 0.0
    if changing.sum() < 20:
        return 0.0
    return float((np.abs(rolled - measured[3:-3]) < EXACTLY)[changing].mean())


def cut_off_efforts(recording: Trajectory, effort: Array, drive: Array) -> list[Finding]:
    """Finds efforts that stay at their extreme while the drive is asked for more.

    A plateau alone is no saturation: dry friction makes plateaus. Where the demand still varies by
    a good part of its spread, it is one.

    Args:
        recording: The recording.
        effort: Measured, N m, shape (T, J).
        drive: What the model's actuators would do, N m, shape (T, J).
    """
    return _flat_tops(recording, "effort has a flat top at", "N m", effort, drive)


def cut_off_speeds(recording: Trajectory) -> list[Finding]:
    """Finds speeds that stay at their extreme while commands ask for more, and errors grow."""
    if recording.command_kind is CommandKind.EFFORT:
        return []
    _, speed, _ = smooth_states(recording.time_s, recording.position)
    command, asked = held_command(recording), held_command(recording)
    if recording.command_kind is CommandKind.POSITION:
        _, asked, _ = smooth_states(recording.time_s, command)
        command = command - recording.position
    tops = _flat_tops(recording, "speed has a flat top at", "rad/s", speed, command)
    return [top for top in tops if _more_asked(asked, recording, top)]


def _more_asked(asked: Array, recording: Trajectory, top: Finding) -> bool:
    """Returns whether commands ask for speeds beyond a flat top: else they have it themselves."""
    column = np.abs(asked[:, [name == top.joint for name in recording.joint_names]])
    return bool((column > MORE * abs(top.value)).mean() > PLATEAU)


def _flat_tops(
    recording: Trajectory, what: str, unit: str, signal: Array, demand: Array
) -> list[Finding]:
    noise, step = noise_std(evenly(recording.time_s, signal)[1]), resolution(signal)
    width = np.maximum(np.maximum(6.0 * noise, step), 0.02 * np.ptp(signal, axis=0))
    advice = "the drive is at a limit there: record with smaller commands as well"
    tops = [_plateau(signal[:, j], demand[:, j], width[j]) for j in range(signal.shape[1])]
    return [
        _finding(recording, j, what, top, unit, advice)
        for j, top in enumerate(tops)
        if top is not None
    ]


def _plateau(signal: Array, demand: Array, width: float) -> float | None:
    """Returns the extreme at which a signal is cut off, or None; noise of `width` may hide it."""
    spread = _spread(demand)
    if width > WIDEST * np.ptp(signal):
        return None
    for sign in (1.0, -1.0):
        depth = np.percentile(sign * signal, EXTREME) - sign * signal
        top, next_level = np.abs(depth) < width, (depth >= width) & (depth < 2.0 * width)
        full = top.mean() > PLATEAU and top.sum() > FULLER * max(next_level.sum(), 1)
        moving = np.abs(np.median(signal[top])) > FROM_ZERO * width
        if (
            full
            and moving
            and -depth.min() < OVERSHOOT * width
            and _spread(demand[top]) > DEMAND_GOES_ON * spread > 0.0
        ):
            return float(np.median(signal[top]))
    return None


def _spread(values: Array) -> float:
    """Returns between what bounds 90 % of some values lie."""
    low, high = np.percentile(values, [5.0, 95.0])
    return float(high - low)


def at_range_limit(recording: Trajectory, plant: Plant) -> list[Finding]:
    """Finds joints that lie at, or beyond, a limit of their range in the model."""
    found = []
    for j, name in enumerate(recording.joint_names):
        joint = plant.model.joint(name).id
        if not plant.model.jnt_limited[joint]:
            continue
        low, high = plant.model.jnt_range[joint]
        margin = AT_LIMIT * (high - low)
        q = recording.position[:, j]
        share = float(((q < low + margin) | (q > high - margin)).mean())
        if share > PLATEAU:
            advice = "at a limit of its range in the model: an end stop acts, not the drive alone"
            found.append(_finding(recording, j, "time spent", 100.0 * share, "%", advice))
    return found


def _finding(
    recording: Trajectory,
    joint: int,
    what: str,
    value: float,
    unit: str,
    consequence: str,
    *,
    doubtful: bool = True,
) -> Finding:
    return Finding(
        recording=recording.name,
        joint=recording.joint_names[joint],
        what=what,
        value=float(value),
        unit=unit,
        consequence=consequence,
        doubtful=doubtful,
    )
