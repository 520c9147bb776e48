"""Motions that make a robot show what its model lacks: smooth, within limits, different in kind.

Every joint rests, creeps, moves fast and reverses in them. Held-out motions are of another kind
than training motions, so that a correction cannot get by with having seen them.

Shape letters: N control periods, J joints.
"""

from __future__ import annotations

import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.excitation.motion import JointRanges, Motion, Purpose, Shape, minimum_jerk

#: Longest part of a motion that is a rest at either end, s.
_REST_S = 0.4
#: Held-out motions keep to this share of the ranges: what is beyond has not been seen.
_HELDOUT_SHARE = 0.8


def waypoint_moves(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns moves of all joints through random waypoints, with rests between them."""
    offset = np.zeros((len(time_s), len(ranges.center)))
    here, start = np.zeros_like(ranges.center), _REST_S
    end = time_s[-1] - _REST_S
    while True:
        target = ranges.half_width * rng.uniform(-1.0, 1.0, len(here)) * rng.uniform(0.5, 1.0)
        duration = _shortest(ranges, target - here) * rng.uniform(1.0, 1.6)
        rest = rng.uniform(0.1, 0.5)
        if start + duration + rest + _shortest(ranges, target) > end:
            _add_move(offset, time_s, here, -here, start, end - start)
            return offset
        _add_move(offset, time_s, here, target - here, start, duration)
        here, start = target, start + duration + rest


def slow_reversals(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns back and forth of each joint at its own pace: creeping at first, then faster."""
    moving = _inside(time_s)
    offset = np.zeros((len(time_s), len(ranges.center)))
    for joint in range(len(ranges.center)):
        slow, fast = rng.uniform(0.10, 0.16), rng.uniform(0.5, 0.7)
        turns = np.cumsum(slow + (fast - slow) * moving**2) * (time_s[1] - time_s[0])
        width = _width(ranges, joint, 2 * np.pi * fast) * rng.choice((-1.0, 1.0))
        offset[:, joint] = width * np.sin(2 * np.pi * turns)
    return offset * _envelope(time_s)[:, np.newaxis]


def multisine(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns sums of four sines for each joint, with frequencies of its own."""
    offset = np.zeros((len(time_s), len(ranges.center)))
    for joint in range(len(ranges.center)):
        hertz = np.array([0.11, 0.23, 0.37, 0.71]) * rng.uniform(0.85, 1.15, 4)
        phase = rng.uniform(0.0, 2 * np.pi, 4)
        waves = np.sin(2 * np.pi * hertz * time_s[:, np.newaxis] + phase) / np.sqrt(hertz)
        offset[:, joint] = waves.sum(axis=1)
    offset *= _envelope(time_s)[:, np.newaxis]
    speed = np.abs(np.diff(offset, axis=0)).max(axis=0) / (time_s[1] - time_s[0])
    width = np.abs(offset).max(axis=0)
    return np.asarray(
        offset * np.minimum(_HELDOUT_SHARE * ranges.half_width / width, ranges.speed / speed)
    )


def motions(
    ranges: JointRanges, *, seed: int, period_s: float = 0.02, duration_s: float = 12.0
) -> tuple[Motion, ...]:
    """Returns six training and four held-out motions, half of them in each mode.

    Args:
        ranges: Where they may go.
        seed: Of the random waypoints and frequencies.
        period_s: Between two commands.
        duration_s: Of each.
    """
    time_s = np.arange(0.0, duration_s, period_s)
    made: list[Motion] = []
    for number, (purpose, kind, label, shape) in enumerate(_PROGRAMME):
        rng = np.random.default_rng([seed, number])
        made.append(
            Motion(
                name=f"{purpose}_{number:02d}_{kind}_{label}",
                purpose=purpose,
                kind=kind,
                joint_names=ranges.joint_names,
                period_s=period_s,
                position=ranges.center + shape(ranges, time_s, rng),
            )
        )
    return tuple(made)


_PROGRAMME: tuple[tuple[Purpose, CommandKind, str, Shape], ...] = (
    (Purpose.TRAINING, CommandKind.POSITION, "waypoints", waypoint_moves),
    (Purpose.TRAINING, CommandKind.POSITION, "waypoints", waypoint_moves),
    (Purpose.TRAINING, CommandKind.POSITION, "reversals", slow_reversals),
    (Purpose.TRAINING, CommandKind.VELOCITY, "waypoints", waypoint_moves),
    (Purpose.TRAINING, CommandKind.VELOCITY, "waypoints", waypoint_moves),
    (Purpose.TRAINING, CommandKind.VELOCITY, "reversals", slow_reversals),
    (Purpose.HELDOUT, CommandKind.POSITION, "multisine", multisine),
    (Purpose.HELDOUT, CommandKind.POSITION, "multisine", multisine),
    (Purpose.HELDOUT, CommandKind.VELOCITY, "multisine", multisine),
    (Purpose.HELDOUT, CommandKind.VELOCITY, "multisine", multisine),
)

#: Peak over mean speed of a minimum-jerk move.
_PEAK = 1.875


def _shortest(ranges: JointRanges, way: Array) -> float:
    """Returns the least time that a minimum-jerk move of all joints together takes, s."""
    return float((_PEAK * np.abs(way) / ranges.speed).max())


def _add_move(
    offset: Array, time_s: Array, here: Array, way: Array, start: float, duration: float
) -> None:
    """Writes a move from `here`, and the rest at its end, into `offset`."""
    after = time_s >= start
    share = minimum_jerk((time_s[after] - start) / duration)
    offset[after] = here + share[:, np.newaxis] * way


def _inside(time_s: Array) -> Array:
    """Returns how much of the motion between the rests has passed, 0 to 1, shape (N,)."""
    return np.asarray(np.clip((time_s - _REST_S) / (time_s[-1] - 2 * _REST_S), 0.0, 1.0))


def _envelope(time_s: Array) -> Array:
    """Returns 0 during the rests, 1 between them, and a smooth second from one to the other."""
    rise = minimum_jerk(time_s - _REST_S)
    return np.asarray(rise * minimum_jerk(time_s[-1] - _REST_S - time_s))


def _width(ranges: JointRanges, joint: int, radians_s: float) -> float:
    """Returns the largest amplitude that keeps a sine within range and speed."""
    return float(min(ranges.half_width[joint], ranges.speed[joint] / radians_s))
