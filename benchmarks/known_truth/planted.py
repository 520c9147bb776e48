"""Torques that nothing has a name for: what every real joint has beyond its laws.

A smooth random function of position, speed and slow time (random Fourier features; Rahimi and Recht
2007), less its projection on what the usual laws say of one joint, and the ripple of a good gear.

Shape letters: B robots, J joints, F features, L usual laws, S samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self, final

import numpy as np

from known_truth.robots import Array, Robot

_FEATURES = 24
#: Over what the function changes: half the range, the usual largest speed, and time, s.
_LENGTHS = (0.5, 0.6, 10.0)
#: From one recording to the next, in slow time, s.
_PAUSE_S = 30.0
#: By which the projection is found, and over how much slow time.
_SAMPLES, _SPAN_S = 4000, 240.0
#: Of a good gear: torque in units of the usual one, and periods per turn of the joint.
_RIPPLE, _TEETH = 0.002, (60, 160)


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Planted:
    """sum_f weight cos(by_place q + by_speed v + by_time t + phase), less the usual laws of q, v.

    Attributes:
        weight: N m, shape (J, F).
        by_place: 1/rad, shape (J, F).
        by_speed: s/rad, shape (J, F).
        by_time: 1/s, shape (J, F).
        phase: rad, shape (J, F).
        usual: Amounts of the usual laws to take off, N m, shape (J, L).
        rest: Middle of all motions, rad, shape (J,).
        reach: Half the range of motions, rad, shape (J,).
        speed: Usual largest speed, rad/s, shape (J,).

    Of many robots side by side, with a leading B.
    """

    weight: Array
    by_place: Array
    by_speed: Array
    by_time: Array
    phase: Array
    usual: Array
    rest: Array
    reach: Array
    speed: Array

    def torque(self, time_s: float, q: Array, v: Array) -> Array:
        """Returns the torques at positions and speeds of shape (..., J), N m, shape (..., J)."""
        angle = self.by_place * q[..., None] + self.by_speed * v[..., None]
        angle += self.by_time * time_s + self.phase
        laws = usual_laws((q - self.rest) / self.reach, v / self.speed)
        return np.asarray(
            np.sum(self.weight * np.cos(angle), axis=-1) - np.sum(self.usual * laws, axis=-1)
        )

    def scaled(self, factor: Array) -> Planted:
        """Returns the torques times a factor per joint, shape (J,)."""
        by = factor[:, None]
        return replace(self, weight=by * self.weight, usual=by * self.usual)

    def in_recording(self, number: int) -> Planted:
        """Returns the torques in another recording: slow time has gone on."""
        return replace(self, phase=self.phase + self.by_time * (number * _PAUSE_S))

    def beside(self, other: Self) -> Planted:
        """Returns these torques and those of another on the same robot."""
        names = ("weight", "by_place", "by_speed", "by_time", "phase")
        features = {
            name: np.concatenate([getattr(self, name), getattr(other, name)], axis=1)
            for name in names
        }
        return replace(self, usual=self.usual + other.usual, **features)


def usual_laws(place: Array, speed: Array) -> Array:
    """Returns what laws of one joint are made of, shape (..., J, L).

    A constant torque, springs, gravity to second order, viscous, dry and quadratic friction.

    Args:
        place: Position from the middle, in half ranges, shape (..., J).
        speed: In units of the usual largest, shape (..., J).
    """
    laws = (np.ones_like(place), place, place**2, speed, np.tanh(4.0 * speed), speed * abs(speed))
    return np.stack(laws, axis=-1)


def discrepancy(robot: Robot, rng: np.random.Generator) -> Planted:
    """Returns a random function whose RMS is the usual torque of each joint."""
    joints = len(robot.joints)
    shape = (joints, _FEATURES)
    by_place, by_speed, by_time = (rng.standard_normal(shape) / length for length in _LENGTHS)
    drawn = Planted(
        weight=np.full(shape, np.sqrt(2.0 / _FEATURES)),
        by_place=by_place / robot.reach[:, None],
        by_speed=by_speed / robot.speed[:, None],
        by_time=by_time,
        phase=rng.uniform(0.0, 2.0 * np.pi, shape) - by_place * (robot.rest / robot.reach)[:, None],
        usual=np.zeros((joints, 6)),
        rest=robot.rest,
        reach=robot.reach,
        speed=robot.speed,
    )
    return _unusual(drawn, rng).scaled(robot.torque)


def _unusual(drawn: Planted, rng: np.random.Generator) -> Planted:
    """Returns what the usual laws cannot say of it, with an RMS of 1 on every joint."""
    joints = len(drawn.rest)
    place, speed = rng.uniform(-1.0, 1.0, (2, _SAMPLES, joints))
    times_s = rng.uniform(0.0, _SPAN_S, _SAMPLES)
    q, v = drawn.rest + drawn.reach * place, drawn.speed * speed
    torque = np.stack([drawn.torque(*at) for at in zip(times_s, q, v, strict=True)])
    laws = usual_laws(place, speed)
    usual = [np.linalg.lstsq(laws[:, j], torque[:, j])[0] for j in range(joints)]
    left = torque - np.einsum("sjl,jl->sj", laws, np.stack(usual))
    return replace(drawn, usual=np.stack(usual)).scaled(1.0 / np.sqrt(np.mean(left**2, axis=0)))


def ripple(robot: Robot, rng: np.random.Generator) -> Planted:
    """Returns the ripple of a good gear: its teeth, and half as much twice as often."""
    joints = len(robot.joints)
    teeth = rng.integers(*_TEETH, joints)[:, None] * np.array([1.0, 2.0])
    nothing = np.zeros((joints, 2))
    return Planted(
        weight=_RIPPLE * robot.torque[:, None] * np.array([1.0, 0.5]),
        by_place=teeth,
        by_speed=nothing,
        by_time=nothing,
        phase=rng.uniform(0.0, 2.0 * np.pi, (joints, 2)),
        usual=np.zeros((joints, 6)),
        rest=robot.rest,
        reach=robot.reach,
        speed=robot.speed,
    )


def side_by_side(planted: Sequence[Planted | None]) -> Planted | None:
    """Returns the torques of many robots of one build; None where none has any."""
    there = [one for one in planted if one is not None]
    if not there:
        return None
    nothing = there[0].scaled(np.zeros(len(there[0].rest)))
    each = [one or nothing for one in planted]
    return Planted(
        **{
            name: np.stack([getattr(one, name) for one in each])
            for name in Planted.__dataclass_fields__
        }
    )
