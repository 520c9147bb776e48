"""What robots have beyond their nominal models, in arrays over many robots.

The laws are those of the vocabulary, written down a second time: nothing is shared with what is
judged by them.

Shape letters: B robots, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from known_truth.robots import Array, Robot

#: By how much the flanks that stop free play give way under a joint's usual torque, rad.
_FLANK_RAD = 2e-5


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """An effect that a robot has and its model lacks.

    Attributes:
        effect: Its name.
        joints: On which it acts, by number.
        parameters: Its amounts, by name, SI.
    """

    effect: str
    joints: tuple[int, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)


#: Where effects on one joint put their parameters.
_PLACES: Mapping[str, Mapping[str, str]] = {
    "coulomb_friction": {"torque": "level"},
    "viscous_friction": {"coefficient": "viscous"},
    "quadratic_drag": {"coefficient": "quadratic"},
    "stribeck_friction": {"static_excess": "excess", "stribeck_velocity": "fading"},
    "asymmetric_friction": {"difference": "difference"},
    "load_dependent_friction": {"coefficient": "load"},
    "joint_spring": {"stiffness": "spring", "rest_angle": "spring_rest"},
    "armature": {"inertia": "armature"},
    "actuator_gain": {"scale": "scale"},
    "command_delay": {"delay": "delay"},
    "actuator_lag": {"time_constant": "lag"},
    "torque_saturation": {"limit": "limit"},
    "torque_offset": {"torque": "offset"},
    "cogging_torque": {"amplitude": "cogging", "per_revolution": "order", "phase": "phase"},
    "encoder_offset": {"offset": "encoder"},
    "drive_loss": {"coefficient": "loss"},
    "drive_dead_zone": {"torque": "dead"},
}


@dataclass(kw_only=True, eq=False)
class Amounts:
    """Amounts of every effect, on every joint of every robot; most are nought.

    Attributes are named after what they are; those that are no torques: `scale` of the drive (1 is
    nominal), `limit` of its torque (infinite), `loss` of it for every N m, `dead` what it takes to
    give anything, `fading` the Stribeck velocity, `separated` the joint whose motor is a side of
    its own (-1 for none).
    """

    level: Array
    excess: Array
    fading: Array
    difference: Array
    load: Array
    viscous: Array
    quadratic: Array
    spring: Array
    spring_rest: Array
    armature: Array
    scale: Array
    delay: Array
    lag: Array
    limit: Array
    offset: Array
    cogging: Array
    order: Array
    phase: Array
    encoder: Array
    loss: Array
    dead: Array
    coupled: Array
    gravity: Array
    payload: list[tuple[int, float, Array]]
    separated: NDArray[np.intp]
    gap: Array
    elastic: Array


def amounts(hidden: Sequence[Sequence[Hidden]], robots: Sequence[Robot]) -> Amounts:
    """Returns the amounts of what each robot hides."""
    count, joints = len(hidden), len(robots[0].joints)
    fields = {name for places in _PLACES.values() for name in places.values()}
    made = Amounts(
        **{name: np.zeros((count, joints)) for name in fields},
        coupled=np.zeros((count, joints, joints)),
        gravity=np.tile([0.0, 0.0, -9.81], (count, 1)),
        payload=[],
        separated=np.full(count, -1, dtype=np.intp),
        gap=np.zeros(count),
        elastic=np.zeros(count),
    )
    made.scale[:], made.limit[:], made.fading[:] = 1.0, np.inf, 1.0
    for robot, effects in enumerate(hidden):
        for effect in effects:
            _hide(made, robot, effect)
    for i, built in enumerate(robots):
        if made.gap[i]:
            made.elastic[i] = built.torque[made.separated[i]] / _FLANK_RAD
    return made


def _hide(made: Amounts, robot: int, hidden: Hidden) -> None:
    values = hidden.parameters
    match hidden.effect:
        case "coupled_friction":
            one, other = hidden.joints
            made.coupled[robot, [one, other], [one, other]] += values["viscous"]
            made.coupled[robot, [one, other], [other, one]] -= values["viscous"]
        case "payload":
            com = np.array([values["com_x"], values["com_y"], values["com_z"]])
            made.payload.append((robot, values["mass"], com))
        case "gravity_direction":
            made.gravity[robot] = _tilted(values["tilt_x"], values["tilt_y"])
        case "backlash":
            made.separated[robot], made.gap[robot] = hidden.joints[0], values["gap"]
        case "joint_elasticity":
            made.separated[robot], made.elastic[robot] = hidden.joints[0], values["stiffness"]
        case name:
            for parameter, place in _PLACES[name].items():
                getattr(made, place)[robot, list(hidden.joints)] = values[parameter]


def _tilted(tilt_x: float, tilt_y: float) -> Array:
    """Returns gravity in the frame of a base that is tilted, m/s^2, shape (3,)."""
    level = np.cos(tilt_x)
    return 9.81 * np.array([-level * np.sin(tilt_y), np.sin(tilt_x), -level * np.cos(tilt_y)])
