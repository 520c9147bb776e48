"""Actuators for the joints of a model that has none, by a rule: "position:kp=50,kv=1"."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Self

import mujoco

from gfm.core import CommandKind, ConfigError
from gfm.sim.layout import SCALAR
from gfm.sim.still import moved_by_actuators

#: What a rule may name, by the word it begins with.
_NUMBERS = {
    "position": (CommandKind.POSITION, ("kp", "kv")),
    "velocity": (CommandKind.VELOCITY, ("kv",)),
    "torque": (CommandKind.EFFORT, ()),
}
#: How rules look, for messages and help.
FORMS = "position:kp=50,kv=1, velocity:kv=5 or torque"


@dataclass(frozen=True, kw_only=True)
class ActuatorRule:
    """What joints without an actuator get.

    Attributes:
        kind: Of commands.
        numbers: "kp", N m/rad, and "kv", N m s/rad, as far as the kind has them; a position servo
            may do without the second.
    """

    kind: CommandKind
    numbers: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def read(cls, text: str) -> Self:
        """Returns the rule that a text states.

        Raises:
            ConfigError: it states none.
        """
        word, _, rest = text.partition(":")
        kind, names = _NUMBERS.get(word, (None, ()))
        numbers = {}
        for part in filter(None, rest.split(",")):
            name, _, value = part.partition("=")
            numbers[name.strip()] = _number(value)
        right = all(name in names and 0.0 < one < math.inf for name, one in numbers.items())
        if kind is None or not right or any(name not in numbers for name in names[:1]):
            raise ConfigError(f"actuators {text!r}: expected {FORMS}, numbers above 0")
        return cls(kind=kind, numbers=numbers)

    @property
    def words(self) -> str:
        """The rule as it is stated."""
        word = next(word for word, (kind, _) in _NUMBERS.items() if kind is self.kind)
        numbers = ",".join(f"{name}={value:g}" for name, value in self.numbers.items())
        return f"{word}:{numbers}" if numbers else word


def _number(text: str) -> float:
    """Returns the number, or NaN for what is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def with_actuators(spec: mujoco.MjSpec, rule: ActuatorRule) -> list[str]:
    """Gives every hinge and slide that nothing moves yet an actuator; returns what was done.

    A joint that follows another one (a mimic joint, a finger on a tendon) has its mover already.
    """
    moved = moved_by_actuators(spec)
    joints = [j.name for j in spec.joints if j.type in SCALAR and j.name not in moved]
    for name in joints:
        drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        _set(drive, rule)
    return [f"actuators added, {rule.words}: {', '.join(joints) or 'none was missing'}"]


def _set(drive: mujoco.MjsActuator, rule: ActuatorRule) -> None:
    match rule.kind:
        case CommandKind.POSITION:
            drive.set_to_position(**rule.numbers)
        case CommandKind.VELOCITY:
            drive.set_to_velocity(**rule.numbers)
        case CommandKind.EFFORT:
            drive.set_to_motor()
