"""How large effects are drawn: meaningful ranges for a joint of a robot.

A size is drawn in units of what the robot is made for (its usual torques, speeds, ranges) and then
made stronger or weaker until it can be seen in the motion but does not rule it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from known_truth.robots import Array, Robot


@final
@dataclass(frozen=True, kw_only=True)
class Place:
    """A joint of a robot, and what it does nominally.

    Attributes:
        robot: The robot.
        joint: Number of the joint.
        servo: Torque of its servo along nominal motions, N m, shape (T,).
        effort: The same with gravity compensation, N m, shape (T,).
    """

    robot: Robot
    joint: int
    servo: Array
    effort: Array

    @property
    def torque(self) -> float:
        """Usual torque, N m."""
        return float(self.robot.torque[self.joint])

    @property
    def speed(self) -> float:
        """Usual largest speed, rad/s."""
        return float(self.robot.speed[self.joint])

    @property
    def reach(self) -> float:
        """Half the range of motions, rad."""
        return float(self.robot.reach[self.joint])


Draw = Callable[[Place, np.random.Generator, float], dict[str, float]]


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _linear(name: str, low: float, high: float, unit: Callable[[Place], float]) -> Draw:
    """Returns a draw of one parameter that is proportional to the strength."""

    def draw(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
        return {name: strength * float(rng.uniform(low, high)) * unit(place)}

    return draw


def _signed(draw: Draw) -> Draw:
    def either(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
        sign = _sign(rng)
        return {name: sign * value for name, value in draw(place, rng, strength).items()}

    return either


def _with(draw: Draw, **others: Callable[[Place, np.random.Generator], float]) -> Draw:
    """Returns a draw with parameters beside it that do not grow with the strength."""

    def both(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
        return draw(place, rng, strength) | {
            name: float(other(place, rng)) for name, other in others.items()
        }

    return both


def _torque(place: Place) -> float:
    return place.torque


def _gain(_: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
    change = min(strength * rng.uniform(0.1, 0.35), 0.6)
    return {"scale": float(1.0 + _sign(rng) * change)}


def _saturation(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
    share = 1.0 - min(strength * rng.uniform(0.02, 0.08), 0.4)
    return {"limit": float(np.quantile(np.abs(place.servo), share))}


def _elasticity(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
    bend = strength * rng.uniform(0.004, 0.02)
    return {"stiffness": float(np.abs(place.effort).max() / bend)}


def _payload(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
    com = 1.5 * place.robot.com[-1] + rng.uniform(-0.03, 0.03, 3)
    if place.robot.planar:
        com[1] = 0.0
    mass = strength * rng.uniform(0.2, 0.8) * float(place.robot.mass[-1])
    return {"mass": mass} | dict(zip(("com_x", "com_y", "com_z"), com.tolist(), strict=True))


def _soft(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
    return {"torque": float(rng.uniform(1.5, 4.0) * place.torque / strength)}


def _tilt(place: Place, rng: np.random.Generator, strength: float) -> dict[str, float]:
    tilt = strength * rng.uniform(0.02, 0.08, 2) * rng.choice([-1.0, 1.0], 2)
    # A planar arm's own plane stays upright: leaning out of it can hardly be seen.
    return {"tilt_x": 0.0 if place.robot.planar else float(tilt[0]), "tilt_y": float(tilt[1])}


#: Sizes of every effect, those that the vocabulary has no name for last.
DRAWS: Mapping[str, Draw] = {
    "coulomb_friction": _linear("torque", 0.05, 0.25, _torque),
    "viscous_friction": _linear("coefficient", 0.05, 0.25, lambda p: p.torque / p.speed),
    "quadratic_drag": _linear("coefficient", 0.1, 0.4, lambda p: p.torque / p.speed**2),
    "stribeck_friction": _with(
        _linear("static_excess", 0.08, 0.3, _torque),
        stribeck_velocity=lambda p, rng: rng.uniform(0.02, 0.08) * p.speed,
    ),
    "asymmetric_friction": _signed(_linear("difference", 0.05, 0.2, _torque)),
    "load_dependent_friction": _linear("coefficient", 0.04, 0.15, lambda _: 1.0),
    "coupled_friction": _linear("viscous", 0.1, 0.4, lambda p: p.torque / p.speed),
    "joint_spring": _with(
        _linear("stiffness", 0.1, 0.4, lambda p: p.torque / p.reach),
        rest_angle=lambda p, rng: p.robot.rest[p.joint] + rng.uniform(-1.0, 1.0) * p.reach,
    ),
    "payload": _payload,
    "gravity_direction": _tilt,
    "armature": _linear("inertia", 0.5, 2.0, lambda p: float(p.robot.armature[p.joint])),
    "actuator_gain": _gain,
    "command_delay": _linear("delay", 0.004, 0.02, lambda _: 1.0),
    "actuator_lag": _linear("time_constant", 0.005, 0.03, lambda _: 1.0),
    "torque_saturation": _saturation,
    "torque_offset": _signed(_linear("torque", 0.05, 0.2, _torque)),
    "cogging_torque": _with(
        _linear("amplitude", 0.04, 0.2, _torque),
        per_revolution=lambda _, rng: rng.choice([4, 6, 7, 8, 12, 14, 20]),
        phase=lambda _, rng: rng.uniform(-np.pi, np.pi),
    ),
    "backlash": _linear("gap", 0.004, 0.02, lambda _: 1.0),
    "joint_elasticity": _elasticity,
    "encoder_offset": _signed(_linear("offset", 0.01, 0.06, lambda _: 1.0)),
    "drive_loss": _linear("coefficient", 0.1, 0.4, lambda p: 1.0 / p.torque),
    "drive_dead_zone": _linear("torque", 0.03, 0.1, _torque),
    "cubic_spring": _with(
        _linear("stiffness", 0.3, 0.8, lambda p: p.torque / p.reach**3),
        rest=lambda p, _: p.robot.rest[p.joint],
    ),
    "hysteretic_spring": _with(
        _linear("torque", 0.1, 0.3, _torque),
        yields_at=lambda p, rng: rng.uniform(0.05, 0.2) * p.reach,
    ),
    "cable_stop": _with(
        _linear("stiffness", 0.6, 1.5, lambda p: p.torque / p.reach),
        taut_at=lambda p, rng: p.robot.rest[p.joint] + rng.uniform(0.0, 0.35) * p.reach,
    ),
    "torque_ripple": _with(
        _linear("amplitude", 0.05, 0.2, _torque),
        frequency_hz=lambda _, rng: rng.uniform(0.7, 3.0),
    ),
    "tap": _with(
        _linear("torque", 0.2, 0.8, _torque),
        at_s=lambda _, rng: rng.uniform(1.5, 3.5),
        for_s=lambda _, rng: rng.uniform(0.05, 0.3),
    ),
    "position_friction": _with(
        _linear("torque", 0.08, 0.25, _torque), order=lambda _, rng: rng.uniform(2.0, 5.0)
    ),
    "root_friction": _linear("coefficient", 0.08, 0.25, lambda p: p.torque / np.sqrt(p.speed)),
    "fading_drive": _with(
        _linear("loss", 0.15, 0.3, lambda _: 1.0), time_s=lambda _, rng: rng.uniform(3.0, 8.0)
    ),
    "voltage_limit": _with(
        _linear("stall", 1.2, 1.8, _torque), fastest=lambda p, rng: rng.uniform(1.0, 1.5) * p.speed
    ),
    "command_steps": _linear("step", 0.02, 0.06, lambda p: p.reach),
    "fading_friction": _with(
        _linear("coefficient", 0.1, 0.4, lambda p: p.torque / p.speed),
        time_s=lambda _, rng: rng.uniform(2.0, 6.0),
    ),
    "detent": _with(
        _linear("torque", 0.1, 0.4, _torque),
        at=lambda p, rng: p.robot.rest[p.joint] + rng.uniform(-0.5, 0.5) * p.reach,
        width=lambda p, rng: rng.uniform(0.1, 0.3) * p.reach,
    ),
    "wind": _with(
        _linear("coefficient", 0.1, 0.4, lambda p: p.torque / p.speed**2),
        speed=lambda p, rng: _sign(rng) * rng.uniform(0.2, 0.8) * p.speed,
    ),
    "soft_drive": _soft,
    "uneven_drive": _signed(_linear("difference", 0.1, 0.4, lambda _: 1.0)),
    "slipping_payload": _with(_payload, at_s=lambda _, rng: rng.uniform(3.0, 5.0)),
}
