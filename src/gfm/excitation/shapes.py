"""Shapes that each make a few effects visible: rest, slow and fast reversals, sweeps, bursts.

Every shape begins and ends at rest in the centre of its ranges, and keeps to them.

Shape letters: N control periods, J joints, K postures.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import qmc

from gfm.core.checks import Array
from gfm.excitation.motion import JointRanges, minimum_jerk

#: Rest at either end, s.
REST_S = 0.4
#: Speeds of the friction ladder: shares of the allowed speed.
RUNGS = (0.03, 0.1, 0.3, 1.0)
_HOLD_S, _BURST_S = 0.8, 1.5
#: Fewer postures are no variety.
_LEAST_POSTURES = 3
#: Reversals under load: so often, each so long, so fast.
_TURNS, _TURN_S, _TURN_SHARE = 2, 1.2, 0.15
#: Share of the ranges in which bursts take place, and largest part of them that a burst takes.
_BURST_ROOM, _BURST_SHARE = 0.6, 0.4
#: A sweep is slow: at most this share of the allowed speed.
_SWEEP_SHARE = 0.5
#: A step is as long as a joint goes at full speed in this time; the next comes after, s.
_STEP_S, _STEP_EVERY_S = 0.1, (0.7, 1.1)


def holds(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns moves through postures all over the ranges, with a rest in each."""
    posture, starts, durations = _visit(ranges, time_s, rng, stay_s=_HOLD_S, share=1.0)
    return within(ranges, time_s, _moves(time_s, posture, starts, durations))


def friction_ladder(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns back and forth at constant speeds, from creeping to full speed.

    Joints take the speeds in orders of their own: their velocities are not proportional.
    """
    slot_s = (time_s[-1] - 2 * REST_S) / len(RUNGS)
    offset = np.zeros((len(time_s), len(ranges.center)))
    for joint, (half_width, speed) in enumerate(zip(ranges.half_width, ranges.speed, strict=True)):
        for slot, share in enumerate(rng.permutation(RUNGS)):
            path = share * speed * slot_s
            turns = math.ceil(path / (4.0 * half_width))
            amplitude = rng.choice((-1.0, 1.0)) * path / (4.0 * turns)
            share_passed = (time_s - REST_S - slot * slot_s) / slot_s
            offset[:, joint] += amplitude * _triangle(turns * share_passed, turns)
    return within(ranges, time_s, rounded(offset, _braking_s(ranges), time_s))


def load_reversals(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns slow reversals in postures all over the ranges: under different loads."""
    stay_s = _TURNS * _TURN_S
    amplitude = _TURN_SHARE * ranges.speed * _TURN_S / 4.0
    amplitude = np.minimum(amplitude, 0.2 * ranges.half_width)
    share = 1.0 - amplitude / ranges.half_width
    posture, starts, durations = _visit(ranges, time_s, rng, stay_s=stay_s, share=share)
    turns = np.zeros_like(time_s)
    for arrival in (starts + durations)[:-1]:
        turns += _triangle((time_s - arrival) / _TURN_S, _TURNS)
    signs = rng.choice((-1.0, 1.0), len(amplitude))
    around = rounded(turns[:, np.newaxis] * signs * amplitude, _braking_s(ranges), time_s)
    return within(ranges, time_s, around + _moves(time_s, posture, starts, durations))


def sweep(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns one slow trip of every joint to both ends of its range."""
    whole_s = time_s[-1] - 2 * REST_S
    reach = np.minimum(ranges.half_width, _SWEEP_SHARE * ranges.speed * whole_s / 4.0)
    reach = reach * rng.choice((-1.0, 1.0), len(reach))
    path = _triangle((time_s - REST_S) / whole_s, 1)[:, np.newaxis] * reach
    return within(ranges, time_s, rounded(path, _braking_s(ranges), time_s))


def steps(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns steps between three levels, each joint at times of its own, as fast as allowed."""
    size = np.minimum(_STEP_S * ranges.speed, ranges.half_width)
    offset = np.zeros((len(time_s), len(size)))
    last_s = time_s[-1] - REST_S - 1.0
    for joint in range(len(size)):
        level, at_s = 0, REST_S + rng.uniform(*_STEP_EVERY_S)
        while at_s < last_s:
            level = int(rng.choice([one for one in (-1, 0, 1) if one != level]))
            offset[time_s >= at_s, joint] = level * size[joint]
            at_s += rng.uniform(*_STEP_EVERY_S)
    offset[time_s >= last_s] = 0.0
    ramp_s = 2.0 * size / ranges.speed
    return within(
        ranges, time_s, rounded(rounded(offset, ramp_s, time_s), 0.5 * _braking_s(ranges), time_s)
    )


def bursts(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns bursts at the largest accelerations and speeds, in several postures."""
    posture, starts, durations = _visit(ranges, time_s, rng, stay_s=_BURST_S, share=_BURST_ROOM)
    amplitude = np.minimum(ranges.speed**2 / ranges.acceleration, _BURST_SHARE * ranges.half_width)
    radians_s = np.minimum(
        ranges.speed / amplitude, np.sqrt(ranges.acceleration / amplitude)
    ) * rng.uniform(0.9, 1.0, len(amplitude))
    offset = _moves(time_s, posture, starts, durations)
    for arrival in (starts + durations)[:-1]:
        since = time_s - arrival
        fade = minimum_jerk(since / 0.3) * minimum_jerk((_BURST_S - since) / 0.3)
        offset += fade[:, np.newaxis] * amplitude * np.sin(radians_s * since[:, np.newaxis])
    return within(ranges, time_s, offset)


def wander(ranges: JointRanges, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns moves through random postures, fast and less fast, with short rests between them."""
    posture: list[Array] = []
    starts, durations = [], []
    here, at_s, room = np.zeros_like(ranges.center), REST_S, ranges.half_width
    while True:
        target = room * rng.uniform(-1.0, 1.0, len(here))
        duration_s = move_s(ranges, target - here) * rng.uniform(1.0, 1.6)
        rest_s = rng.uniform(0.1, 0.5)
        if at_s + duration_s + rest_s + move_s(ranges, target) > time_s[-1] - REST_S:
            if len(posture) >= _LEAST_POSTURES or room.max() < 1e-3:
                break
            room = 0.8 * room
            continue
        posture.append(target)
        starts.append(at_s)
        durations.append(duration_s)
        here, at_s = target, at_s + duration_s + rest_s
    home = np.array([*posture, 0.0 * here])
    starts.append(at_s)
    durations.append(max(move_s(ranges, here), 1e-3))
    return within(ranges, time_s, _moves(time_s, home, np.array(starts), np.array(durations)))


def within(ranges: JointRanges, time_s: Array, offset: Array) -> Array:
    """Returns offsets made smaller, joint by joint, until range, speed and acceleration are kept.

    Args:
        ranges: To keep to.
        time_s: Evenly spaced, shape (N,).
        offset: Beginning and ending at 0, shape (N, J).
    """
    period_s = time_s[1] - time_s[0]
    speed = np.diff(offset, axis=0) / period_s
    acceleration = np.diff(speed, axis=0) / period_s
    shares = [
        np.abs(values).max(axis=0) / allowed
        for values, allowed in (
            (offset, ranges.half_width),
            (speed, ranges.speed),
            (acceleration, ranges.acceleration),
        )
    ]
    return np.asarray(offset / np.maximum(np.max(shares, axis=0), 1.0))


def rounded(offset: Array, window_s: Array, time_s: Array) -> Array:
    """Returns moving averages: no larger, no faster, and corners take the time of the window.

    Args:
        offset: Constant at either end, shape (N, J).
        window_s: For each joint, shape (J,).
        time_s: Evenly spaced, shape (N,).
    """
    smooth = np.empty_like(offset)
    for joint, half in enumerate(np.rint(0.5 * window_s / (time_s[1] - time_s[0])).astype(int)):
        kernel = np.full(2 * half + 1, 1.0 / (2 * half + 1))
        smooth[:, joint] = np.convolve(np.pad(offset[:, joint], half, "edge"), kernel, "valid")
    return smooth


def move_s(ranges: JointRanges, way: Array) -> float:
    """Returns the least time in which a minimum-jerk move of all joints keeps to the limits, s."""
    far = np.abs(way)
    # Peak speed and acceleration of a minimum-jerk move over 1 in 1 s: 15/8 and 10/sqrt(3).
    fast, hard = 1.875 * far / ranges.speed, np.sqrt(5.7736 * far / ranges.acceleration)
    return float(np.maximum(fast, hard).max(initial=0.0))


def _visit(
    ranges: JointRanges,
    time_s: Array,
    rng: np.random.Generator,
    *,
    stay_s: float,
    share: Array | float,
) -> tuple[Array, Array, Array]:
    """Returns postures to visit, ending with the centre, and when and how long one goes there.

    The postures are a shifted Halton sequence: however many there is time for, they are spread
    evenly.

    Returns:
        Offsets of shape (K, J); start and duration of the move to each, s, shape (K,).
    """
    spread = qmc.Halton(len(ranges.center), scramble=False).random(1 + int(time_s[-1] / stay_s))
    spread = 2.0 * ((spread + rng.uniform(size=len(ranges.center))) % 1.0) - 1.0
    whole_s = time_s[-1] - 2 * REST_S
    room = ranges.half_width * share
    tour, durations = _longest_tour(ranges, room * spread, stay_s, whole_s)
    # Where the ways are too long for the time, postures lie closer together.
    while len(tour) <= _LEAST_POSTURES and room.max() > 1e-3:
        room = 0.8 * room
        tour, durations = _longest_tour(ranges, room * spread, stay_s, whole_s)
    ends = REST_S + np.cumsum(durations + stay_s)
    return tour, np.array([REST_S, *ends[:-1]]), durations


def _longest_tour(
    ranges: JointRanges, postures: Array, stay_s: float, whole_s: float
) -> tuple[Array, Array]:
    """Returns a tour through as many of the first postures as there is time for, (K + 1, J).

    And how long the move to each takes, s, shape (K + 1,).
    """
    found = np.zeros((1, postures.shape[1])), np.full(1, 1e-3)
    for count in range(1, len(postures) + 1):
        tour = _tour(ranges, postures[:count])
        moves_s = np.array([move_s(ranges, way) for way in np.diff(tour, axis=0, prepend=0.0)])
        if moves_s.sum() + count * stay_s > whole_s:
            break
        found = tour, np.maximum(moves_s, 1e-3)
    return found


def _tour(ranges: JointRanges, postures: Array) -> Array:
    """Returns postures in an order of short ways from one to the next, then the centre, (K + 1, J).

    Always the nearest of those that are left.
    """
    left = list(postures)
    tour: list[Array] = []
    here = np.zeros(postures.shape[1])
    while left:
        ways_s = [move_s(ranges, one - here) for one in left]
        here = left.pop(int(np.argmin(ways_s)))
        tour.append(here)
    return np.array([*tour, 0.0 * here])


def _moves(time_s: Array, posture: Array, starts: Array, durations: Array) -> Array:
    """Returns minimum-jerk moves from the centre to one posture after the other."""
    way = np.diff(posture, axis=0, prepend=0.0 * posture[:1])
    share = minimum_jerk((time_s[:, np.newaxis] - starts) / durations)
    return np.asarray(share @ way)


def _triangle(turns: Array, count: int) -> Array:
    """Returns a triangle wave between -1 and 1 for `count` turns, 0 before and after."""
    wave = 1.0 - 4.0 * np.abs((turns + 0.25) % 1.0 - 0.5)
    return np.asarray(np.where((turns >= 0.0) & (turns <= count), wave, 0.0))


def _braking_s(ranges: JointRanges) -> Array:
    """Returns how long a reversal at full speed takes each joint, s, shape (J,)."""
    return np.asarray(2.0 * ranges.speed / ranges.acceleration)
