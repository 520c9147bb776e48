"""The torques of the hidden effects at one instant.

An effect sits on one joint or two, and Python is faster with a few floats than NumPy with small
arrays: laws read and write single elements.

Shape letters: J joints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import final

import numpy as np

from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.simulated.hidden import HiddenEffect

#: Adds its torque: (position, velocity, torque to add to), each of shape (J,).
Law = Callable[[Array, Array, Array], None]

#: Bristles bend this far before they slide: less than an encoder sees.
_BEND_RAD = 1e-5
#: Their stiffness is limited by the time step, their damping is near critical for 1 kg m^2.
_STIFFEST = 3e5
_DAMPING_RATIO = 0.7


def smooth_laws(effects: Sequence[HiddenEffect]) -> list[Law]:
    """Returns the laws that are functions of position and velocity alone."""
    return [_SMOOTH[effect.effect](effect) for effect in effects if effect.effect in _SMOOTH]


def _viscous(effect: HiddenEffect) -> Law:
    joint, coefficient = effect.joints[0], effect.parameters["coefficient"]

    def add(_q: Array, v: Array, torque: Array) -> None:
        torque[joint] -= coefficient * v[joint]

    return add


def _quadratic(effect: HiddenEffect) -> Law:
    joint, coefficient = effect.joints[0], effect.parameters["coefficient"]

    def add(_q: Array, v: Array, torque: Array) -> None:
        torque[joint] -= coefficient * v[joint] * abs(v[joint])

    return add


def _coupled(effect: HiddenEffect) -> Law:
    (one, other), viscous = effect.joints, effect.parameters["viscous"]

    def add(_q: Array, v: Array, torque: Array) -> None:
        drag = viscous * (v[one] - v[other])
        torque[one] -= drag
        torque[other] += drag

    return add


def _spring(effect: HiddenEffect) -> Law:
    joint, stiffness = effect.joints[0], effect.parameters["stiffness"]
    rest = effect.parameters["rest_angle"]

    def add(q: Array, _v: Array, torque: Array) -> None:
        torque[joint] -= stiffness * (q[joint] - rest)

    return add


def _offset(effect: HiddenEffect) -> Law:
    joint, constant = effect.joints[0], effect.parameters["torque"]

    def add(_q: Array, _v: Array, torque: Array) -> None:
        torque[joint] += constant

    return add


def _cogging(effect: HiddenEffect) -> Law:
    joint, amplitude = effect.joints[0], effect.parameters["amplitude"]
    count, phase = effect.parameters["per_revolution"], effect.parameters["phase"]

    def add(q: Array, _v: Array, torque: Array) -> None:
        torque[joint] += amplitude * math.sin(count * q[joint] + phase)

    return add


_SMOOTH: dict[str, Callable[[HiddenEffect], Law]] = {
    "viscous_friction": _viscous,
    "quadratic_drag": _quadratic,
    "coupled_friction": _coupled,
    "joint_spring": _spring,
    "torque_offset": _offset,
    "cogging_torque": _cogging,
}


@final
class DryFriction:
    """Dry friction of one joint: it opposes motion up to a level, and holds at rest for good.

    A bristle of finite stiffness is anchored where the joint last slid. Its force is what keeps
    the joint there, until it exceeds the level: then the anchor is dragged along. Unlike a
    smoothed sign this sticks without creeping, and unlike LuGre's bristles it does not drift when
    shaken below the level.
    """

    def __init__(self, joint: int, effects: Sequence[HiddenEffect], position: float) -> None:
        values = {key: value for effect in effects for key, value in effect.parameters.items()}
        self.joint = joint
        self._level = values.get("torque", 0.0)
        self._excess = values.get("static_excess", 0.0)
        self._stribeck_velocity = values.get("stribeck_velocity", 1.0)
        self._half_difference = values.get("difference", 0.0) / 2
        self._load = values.get("coefficient", 0.0)
        self._anchor = position
        reference = self._level + self._excess + 10.0 * self._load
        self._stiffness = min(reference / _BEND_RAD, _STIFFEST)
        self._damping = 2.0 * _DAMPING_RATIO * math.sqrt(self._stiffness)

    def torque(self, q: float, v: float, drive: float) -> float:
        """Returns the torque on the joint: rad, rad/s and N m in, N m out."""
        low, high = self._bounds(v, drive)
        bristle = self._stiffness * (q - self._anchor) + self._damping * v
        return -min(max(bristle, low), high)

    def slide(self, q: float, v: float, drive: float) -> None:
        """Drags the anchor along to where the bristle can hold; once after every time step."""
        low, high = self._bounds(v, drive)
        earliest, latest = q - high / self._stiffness, q - low / self._stiffness
        self._anchor = min(max(self._anchor, earliest), latest)

    def _bounds(self, v: float, drive: float) -> tuple[float, float]:
        """Returns the friction against negative motion (<= 0) and against positive motion."""
        level = self._level + self._load * abs(drive)
        if self._excess:
            level += self._excess * math.exp(-((v / self._stribeck_velocity) ** 2))
        against_negative = max(level - self._half_difference, 0.0)
        return -against_negative, max(level + self._half_difference, 0.0)


_DRY = ("coulomb_friction", "stribeck_friction", "asymmetric_friction", "load_dependent_friction")


def dry_frictions(effects: Sequence[HiddenEffect], position: Array) -> list[DryFriction]:
    """Returns one element for every joint that has dry friction of any kind."""
    dry = [effect for effect in effects if effect.effect in _DRY]
    joints = sorted({effect.joints[0] for effect in dry})
    return [
        DryFriction(joint, [e for e in dry if e.joints[0] == joint], float(position[joint]))
        for joint in joints
    ]


@final
class JointForces:
    """What acts on the joints beside their drives.

    Args:
        effects: What the arm hides.
        position: Where it begins, rad, shape (J,).

    Attributes:
        slides: Whether `slide` has to be called after every time step.
    """

    def __init__(self, effects: Sequence[HiddenEffect], position: Array) -> None:
        self._laws = smooth_laws(effects)
        self._frictions = dry_frictions(effects, position)
        self.slides = bool(self._frictions)

    def add(self, q: Array, v: Array, drive: Array, torque: Array) -> None:
        """Adds the torques to `torque`, N m; all arrays begin with the joints, shape (J,).

        Args:
            q: rad.
            v: rad/s.
            drive: Torque of the drives, N m.
            torque: N m, changed in place.
        """
        for law in self._laws:
            law(q, v, torque)
        for friction in self._frictions:
            j = friction.joint
            torque[j] += friction.torque(float(q[j]), float(v[j]), float(drive[j]))

    def slide(self, q: Array, v: Array, drive: Array) -> None:
        """Drags what holds the joints at rest along to where it can hold."""
        for friction in self._frictions:
            j = friction.joint
            friction.slide(float(q[j]), float(v[j]), float(drive[j]))


def encoder_offset(effects: Sequence[HiddenEffect]) -> Array:
    """Returns reported minus true position, rad, shape (J,)."""
    offset = np.zeros(len(JOINT_NAMES))
    for effect in effects:
        if effect.effect == "encoder_offset":
            offset[effect.joints[0]] = effect.parameters["offset"]
    return offset
