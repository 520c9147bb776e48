"""Motions that a robot is asked for: positions over time, from rest.

Shape letters: S times, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from known_truth.robots import Array, Robot

#: Time over which oscillations begin, s.
_RISE_S = 1.0
#: Slow speeds of the ladder, as shares of the robot's typical largest speed.
_RUNGS = (0.03, 0.1, 0.3)


def waypoints(robot: Robot, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns smooth moves between poses, with rests."""
    return _moves(robot, time_s, rng, reach=1.0, rests_s=(0.15, 0.6), pace=(0.35, 0.9))


def reaches(robot: Robot, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns short quick moves that follow each other at once."""
    return _moves(robot, time_s, rng, reach=0.6, rests_s=(0.0, 0.1), pace=(0.6, 1.1))


def multisine(robot: Robot, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns sums of four oscillations per joint, 0.1 to 1.4 Hz."""
    columns = []
    for reach, speed in zip(robot.reach, robot.speed, strict=True):
        frequency = np.exp(rng.uniform(np.log(0.1), np.log(1.4), 4))
        size = rng.uniform(0.5, 1.0, 4) / np.sqrt(frequency)
        phase = rng.uniform(0.0, 2 * np.pi, 4)
        waves = size * np.sin(2 * np.pi * frequency * time_s[:, None] + phase)
        wave = (waves - size * np.sin(phase)).sum(axis=1)
        most = min(reach / np.abs(wave).max(), 0.9 * speed / _fastest(wave, time_s))
        columns.append(most * wave)
    return np.asarray(robot.rest + _rising(time_s) * np.stack(columns, axis=1))


def chirp(robot: Robot, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns oscillations that become faster and smaller, 0.15 to 1.2 Hz."""
    columns = []
    span_s = float(time_s[-1])
    for reach, speed in zip(robot.reach, robot.speed, strict=True):
        slow, fast = 0.15 * rng.uniform(0.8, 1.3), 1.2 * rng.uniform(0.7, 1.2)
        rate = np.log(fast / slow) / span_s
        turns = slow / rate * (np.exp(rate * time_s) - 1.0)
        frequency = slow * np.exp(rate * time_s)
        size = np.minimum(0.8 * reach, 0.9 * speed / (2 * np.pi * frequency))
        columns.append(rng.choice([-1.0, 1.0]) * size * np.sin(2 * np.pi * turns))
    return np.asarray(robot.rest + _rising(time_s) * np.stack(columns, axis=1))


def ladder(robot: Robot, time_s: Array, rng: np.random.Generator) -> Array:
    """Returns there-and-back motion at a few constant speeds, the slowest first."""
    columns = []
    for reach, speed in zip(robot.reach, robot.speed, strict=True):
        rungs = np.array(_RUNGS) * speed * rng.uniform(0.8, 1.25)
        knots, places = [0.0], [0.0]
        end_s = float(time_s[-1])
        for rung, share in zip(rungs, (0.4, 0.7, 1.0), strict=True):
            side = rng.choice([-1.0, 1.0])
            while knots[-1] < share * end_s:
                span = min(0.8 * reach, rung * rng.uniform(0.8, 1.6))
                knots.append(knots[-1] + abs(side * span - places[-1]) / rung)
                places.append(side * span)
                side = -side
        columns.append(np.interp(time_s, knots, places))
    return robot.rest + np.stack(columns, axis=1)


def _moves(
    robot: Robot,
    time_s: Array,
    rng: np.random.Generator,
    *,
    reach: float,
    rests_s: tuple[float, float],
    pace: tuple[float, float],
) -> Array:
    """Returns minimum-jerk moves between random places, every joint on its own."""
    columns = []
    for most, speed in zip(robot.reach, robot.speed, strict=True):
        begins, path = 0.3, np.zeros(len(time_s))
        at = 0.0
        while begins < time_s[-1]:
            to = reach * most * rng.uniform(-1.0, 1.0)
            span_s = max(1.875 * abs(to - at) / (rng.uniform(*pace) * speed), 0.15)
            share = np.clip((time_s - begins) / span_s, 0.0, 1.0)
            path += (to - at) * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
            at, begins = to, begins + span_s + rng.uniform(*rests_s)
        columns.append(path)
    return robot.rest + np.stack(columns, axis=1)


def _fastest(wave: Array, time_s: Array) -> float:
    return float(np.abs(np.diff(wave)).max() / np.diff(time_s).max())


def _rising(time_s: Array) -> Array:
    """Returns a factor that goes smoothly from 0 to 1, shape (S, 1)."""
    share = np.clip(time_s / _RISE_S, 0.0, 1.0)
    return np.asarray(share**2 * (3.0 - 2.0 * share))[:, None]


MOTIONS: Mapping[str, Callable[[Robot, Array, np.random.Generator], Array]] = {
    "waypoints": waypoints,
    "reaches": reaches,
    "multisine": multisine,
    "chirp": chirp,
    "ladder": ladder,
}
