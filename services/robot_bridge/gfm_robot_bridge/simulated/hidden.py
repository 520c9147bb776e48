"""What the simulated robot has beyond its nominal model: drawn from a seed, sealed in a file.

Names and laws are those of the diagnosis contract; the code is not. Amounts are visible above the
sensors' noise, and not so large that the arm could not be driven.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np

from gfm.core import ConfigError, UnknownNameError
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES

#: Torque amounts are drawn for the four large joints; the three wrist joints have this share of
#: them, for their drives have 9 N m against 40 and 80.
_WRIST_SHARE = 0.4
_LARGE = 4
#: Joints that carry weight in every pose that is driven.
_LOADED = (1, 3)
#: Effects whose joints need not be named.
_OF_THE_WHOLE = ("payload", "gravity_direction", "command_delay")
#: The joint about the vertical axis: no weight presses on its play, and it makes no difference on
#: which side of a coupling gravity is compensated.
_UNLOADED = 0


@dataclass(frozen=True, kw_only=True)
class HiddenEffect:
    """One effect.

    Attributes:
        effect: Its name in the diagnosis contract.
        joints: Indices of the joints that have it; empty for the whole arm.
        parameters: Values in SI units by name.
    """

    effect: str
    joints: tuple[int, ...]
    parameters: Mapping[str, float]


class GivenEffect(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One effect as settings name it, with its amounts.

    Attributes:
        effect: Its name.
        joints: Names of the joints that have it; empty where it is not of single joints.
        parameters: Values in SI units by name: all that the effect has.
    """

    effect: str
    parameters: dict[str, float]
    joints: tuple[str, ...] = ()


#: Units of the parameters, by name.
UNITS = {
    "torque": "N m",
    "coefficient": "",
    "static_excess": "N m",
    "stribeck_velocity": "rad/s",
    "difference": "N m",
    "viscous": "N m s/rad",
    "stiffness": "N m/rad",
    "rest_angle": "rad",
    "mass": "kg",
    "com_x": "m",
    "com_y": "m",
    "com_z": "m",
    "tilt_x": "rad",
    "tilt_y": "rad",
    "inertia": "kg m^2",
    "scale": "1",
    "delay": "s",
    "time_constant": "s",
    "limit": "N m",
    "amplitude": "N m",
    "per_revolution": "1",
    "phase": "rad",
    "gap": "rad",
    "offset": "rad",
    "x": "m",
    "y": "m",
    "z": "m",
}
_COEFFICIENT_UNITS = {
    "viscous_friction": "N m s/rad",
    "quadratic_drag": "N m s^2/rad^2",
    "load_dependent_friction": "1",
    "object_friction": "1",
}


def unit(effect: str, parameter: str) -> str:
    """Returns the unit of one parameter of one effect."""
    return UNITS[parameter] or _COEFFICIENT_UNITS[effect]


class _Dice:
    """Random amounts of sensible size."""

    def __init__(self, rng: np.random.Generator, pose: Array) -> None:
        self._rng = rng
        self.pose = pose

    def joint(self, among: Sequence[int] | None = None) -> int:
        """Returns a joint."""
        return int(self._rng.choice(len(self.pose) if among is None else list(among)))

    def between(self, low: float, high: float) -> float:
        """Returns a number in a range."""
        return float(self._rng.uniform(low, high))

    def either_sign(self, low: float, high: float) -> float:
        """Returns a number whose size is in a range."""
        return self.between(low, high) * float(self._rng.choice((-1.0, 1.0)))

    def torque(self, joint: int, low: float, high: float) -> float:
        """Returns an amount of torque (or of something that makes torque) that suits a joint."""
        return self.between(low, high) * (1.0 if joint < _LARGE else _WRIST_SHARE)


def draw(name: str, seed: int, pose: Array) -> tuple[HiddenEffect, ...]:
    """Returns what a robot has hidden, the same for the same arguments.

    Args:
        name: An effect, several joined by `+`, `random` for any one of the arm, or `none`.
        seed: Of the draw.
        pose: About which the arm is driven, rad, shape (J,).

    Returns:
        Each effect, followed by those without which it does not occur (excess friction at low
        speed comes on top of a level).
    """
    check_choice(name)
    if name == "none":
        return ()
    rng = np.random.default_rng([seed, 0x5EA1ED])
    # Drawn in any case, so that a name and `random` give the same amounts for a seed.
    drawn = str(rng.choice(sorted(_DRAWS)))
    dice = _Dice(rng, pose)
    chosen = [drawn if one == "random" else one for one in name.split("+")]
    return tuple(effect for one in chosen for effect in (_DRAWS | _OBJECT_DRAWS)[one](dice))


def given(effects: Sequence[GivenEffect]) -> tuple[HiddenEffect, ...]:
    """Returns the effects that settings name.

    Raises:
        UnknownNameError: there is no such effect or joint.
        ConfigError: an effect has other joints or parameters, or an amount is not finite.
    """
    return tuple(_given(one) for one in effects)


def _given(one: GivenEffect) -> HiddenEffect:
    known = _DRAWS | _OBJECT_DRAWS
    if one.effect not in known:
        raise UnknownNameError("hidden effect", one.effect, known)
    drawn = known[one.effect](_Dice(np.random.default_rng(0), np.zeros(len(JOINT_NAMES))))
    like = next(effect for effect in drawn if effect.effect == one.effect)
    if set(one.parameters) != set(like.parameters):
        raise ConfigError(
            f"hidden {one.effect} has {', '.join(sorted(one.parameters)) or 'no parameters'}, "
            f"expected {', '.join(sorted(like.parameters))}"
        )
    for name, value in one.parameters.items():
        if not math.isfinite(value):
            raise ConfigError(f"hidden {one.effect} has {name} {value}, expected a finite number")
    return HiddenEffect(
        effect=one.effect, joints=_joints(one, like), parameters=dict(one.parameters)
    )


def _joints(one: GivenEffect, like: HiddenEffect) -> tuple[int, ...]:
    for joint in one.joints:
        if joint not in JOINT_NAMES:
            raise UnknownNameError("joint", joint, JOINT_NAMES)
    if one.effect in _OF_THE_WHOLE and not one.joints:
        return like.joints
    if len(one.joints) != len(like.joints):
        raise ConfigError(
            f"hidden {one.effect} is on joints {', '.join(one.joints) or 'none'}, "
            f"expected {len(like.joints)} of {', '.join(JOINT_NAMES)}"
        )
    return tuple(JOINT_NAMES.index(joint) for joint in one.joints)


def check_choice(name: str) -> None:
    """Raises UnknownNameError for what cannot be hidden."""
    known = [*_DRAWS, *_OBJECT_DRAWS, "random"]
    for one in name.split("+"):
        if one not in known and name != "none":
            raise UnknownNameError("hidden effect", one, [*known, "none"])


def needs_object(effect_names: Iterable[str]) -> bool:
    """Returns whether one of the effects is in the object or the tool that pushes it."""
    return any(name in _OBJECT_DRAWS for name in effect_names)


def names() -> tuple[str, ...]:
    """Returns every effect that an arm can hide."""
    return tuple(_DRAWS)


def object_names() -> tuple[str, ...]:
    """Returns every effect that an object, or the tool that pushes it, can hide."""
    return tuple(_OBJECT_DRAWS)


def _one(effect: str, joint: int, **parameters: float) -> HiddenEffect:
    return HiddenEffect(effect=effect, joints=(joint,), parameters=parameters)


def _level(dice: _Dice, joint: int, low: float, high: float) -> HiddenEffect:
    return _one("coulomb_friction", joint, torque=dice.torque(joint, low, high))


def _coulomb(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_level(dice, dice.joint(), 1.5, 4.5),)


def _viscous(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    return (_one("viscous_friction", j, coefficient=dice.torque(j, 4.0, 12.0)),)


def _quadratic(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    return (_one("quadratic_drag", j, coefficient=dice.torque(j, 6.0, 15.0)),)


def _stribeck(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    excess, speed = dice.torque(j, 1.5, 3.5), dice.between(0.04, 0.12)
    extra = _one("stribeck_friction", j, static_excess=excess, stribeck_velocity=speed)
    return extra, _level(dice, j, 1.0, 2.0)


def _asymmetric(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    level = _level(dice, j, 2.0, 4.0)
    share = dice.either_sign(0.5, 1.0)
    return _one("asymmetric_friction", j, difference=share * level.parameters["torque"]), level


def _load_dependent(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint(_LOADED)
    return (_one("load_dependent_friction", j, coefficient=dice.between(0.1, 0.25)),)


def _coupled(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint(range(len(dice.pose) - 1))
    viscous = dice.torque(j + 1, 5.0, 12.0)
    both = {"viscous": viscous}
    return (HiddenEffect(effect="coupled_friction", joints=(j, j + 1), parameters=both),)


def _spring(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    rest = float(dice.pose[j]) + dice.either_sign(0.05, 0.3)
    return (_one("joint_spring", j, stiffness=dice.torque(j, 8.0, 20.0), rest_angle=rest),)


def _payload(dice: _Dice) -> tuple[HiddenEffect, ...]:
    com = {axis: dice.either_sign(0.01, 0.04) for axis in ("com_x", "com_y")}
    com["com_z"] = dice.between(0.05, 0.12)
    return (_one("payload", len(dice.pose) - 1, mass=dice.between(0.8, 2.0), **com),)


def _gravity(dice: _Dice) -> tuple[HiddenEffect, ...]:
    tilts = {axis: dice.either_sign(0.03, 0.08) for axis in ("tilt_x", "tilt_y")}
    return (HiddenEffect(effect="gravity_direction", joints=(), parameters=tilts),)


def _armature(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    return (_one("armature", j, inertia=dice.torque(j, 1.0, 2.0)),)


def _gain(dice: _Dice) -> tuple[HiddenEffect, ...]:
    scale = dice.between(0.5, 0.7) if dice.between(0.0, 1.0) < 0.5 else dice.between(1.5, 1.9)
    return (_one("actuator_gain", dice.joint(), scale=scale),)


def _delay(dice: _Dice) -> tuple[HiddenEffect, ...]:
    everyone = tuple(range(len(dice.pose)))
    amount = {"delay": dice.between(0.015, 0.05)}
    return (HiddenEffect(effect="command_delay", joints=everyone, parameters=amount),)


def _lag(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_one("actuator_lag", dice.joint(), time_constant=dice.between(0.03, 0.1)),)


def _saturation(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    return (_one("torque_saturation", j, limit=dice.torque(j, 3.0, 5.0)),)


def _offset(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    sign = dice.either_sign(1.0, 1.0)
    return (_one("torque_offset", j, torque=sign * dice.torque(j, 1.5, 4.0)),)


def _cogging(dice: _Dice) -> tuple[HiddenEffect, ...]:
    j = dice.joint()
    return (
        _one(
            "cogging_torque",
            j,
            amplitude=dice.torque(j, 1.5, 3.5),
            per_revolution=float(round(dice.between(8.0, 24.0))),
            phase=dice.between(-np.pi, np.pi),
        ),
    )


def _backlash(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_one("backlash", _UNLOADED, gap=dice.between(0.01, 0.03)),)


def _elasticity(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_one("joint_elasticity", _UNLOADED, stiffness=dice.between(300.0, 900.0)),)


def _encoder(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_one("encoder_offset", dice.joint(_LOADED), offset=dice.either_sign(0.05, 0.12)),)


def _object_friction(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_of_object("object_friction", coefficient=dice.between(0.15, 0.35)),)


def _object_mass(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_of_object("object_mass", mass=dice.between(0.1, 0.3)),)


def _object_com(dice: _Dice) -> tuple[HiddenEffect, ...]:
    aside = {axis: dice.either_sign(0.008, 0.02) for axis in ("x", "y")}
    return (_of_object("object_com", **aside, z=0.0),)


def _tool_offset(dice: _Dice) -> tuple[HiddenEffect, ...]:
    return (_of_object("tool_offset", **{a: dice.either_sign(0.005, 0.015) for a in ("x", "y")}),)


def _of_object(effect: str, **parameters: float) -> HiddenEffect:
    return HiddenEffect(effect=effect, joints=(), parameters=parameters)


_OBJECT_DRAWS: dict[str, Callable[[_Dice], tuple[HiddenEffect, ...]]] = {
    "object_friction": _object_friction,
    "object_mass": _object_mass,
    "object_com": _object_com,
    "tool_offset": _tool_offset,
}
_DRAWS: dict[str, Callable[[_Dice], tuple[HiddenEffect, ...]]] = {
    "coulomb_friction": _coulomb,
    "viscous_friction": _viscous,
    "quadratic_drag": _quadratic,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "load_dependent_friction": _load_dependent,
    "coupled_friction": _coupled,
    "joint_spring": _spring,
    "payload": _payload,
    "gravity_direction": _gravity,
    "armature": _armature,
    "actuator_gain": _gain,
    "command_delay": _delay,
    "actuator_lag": _lag,
    "torque_saturation": _saturation,
    "torque_offset": _offset,
    "cogging_torque": _cogging,
    "backlash": _backlash,
    "joint_elasticity": _elasticity,
    "encoder_offset": _encoder,
}
