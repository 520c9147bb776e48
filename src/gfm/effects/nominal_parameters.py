"""What a model itself says of its joints, where it may say too much, and of its size.

Effects add to a model. Where its own damping, dry friction or motor inertia is larger than the
robot's, less than nothing is to be added, and no less than takes off all that the model says.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np

from gfm.effects import Effect, EffectInstance
from gfm.effects.effect import find_motor_side

#: Share of its motors' inertia that a model keeps: what is light cannot be simulated without.
KEPT = 0.05

#: Where a joint says how much it has of an effect.
_SAYS: Mapping[str, str] = {
    "coulomb_friction": "frictionloss",
    "viscous_friction": "damping",
    "armature": "armature",
}


def least_amounts(
    specs: Collection[mujoco.MjSpec], effect: Effect, joints: Sequence[str]
) -> dict[str, float]:
    """Returns amounts, less than none, that take off all that every model says on some joints."""
    if effect.name not in _SAYS:
        return {}
    kept = KEPT if effect.name == "armature" else 0.0
    most = (1.0 - kept) * min(_said(spec, effect.name, joints[0]) for spec in specs)
    return {effect.parameters[0].name: -most} if most > 0.0 else {}


def most_amounts(specs: Collection[mujoco.MjSpec], effect: Effect) -> dict[str, float]:
    """Returns the largest sizes of amounts that a model's own size allows for, m.

    What a robot carries is no farther from its last link than the robot is large: a gram two metres
    out is a rotor's inertia, which has no weight. How large it is: the longest side of its box.
    """
    if effect.name != "payload":
        return {}
    size = 2.0 * max(float(spec.copy().compile().stat.extent) for spec in specs)
    return dict.fromkeys(("com_x", "com_y", "com_z"), size)


def covers(spec: mujoco.MjSpec, instance: EffectInstance) -> bool:
    """Returns whether a model has as much of an effect as `instance` takes off."""
    name = instance.effect.name
    if name not in _SAYS or not instance.takes_off:
        return False
    (taken,) = instance.values.values()
    return _said(spec, name, instance.joints[0]) + taken >= 0.0


def _said(spec: mujoco.MjSpec, name: str, joint: str) -> float:
    """Returns how much of an effect a model says that a joint has.

    Of a damping that is a polynomial, the first coefficient.
    """
    return float(np.ravel(getattr(find_motor_side(spec, joint), _SAYS[name]))[0])


def said_already(
    specs: Collection[mujoco.MjSpec], given: Sequence[EffectInstance], instance: EffectInstance
) -> float | None:
    """Returns how much of an effect's first amount a model has already; None where it is no sum.

    Args:
        specs: The model by the kind of command.
        given: Effects of the model that they cannot say.
        instance: The effect, and where.
    """
    if instance.effect.name not in _SAYS:
        return None
    said = _said(next(iter(specs)), instance.effect.name, instance.joints[0])
    first = instance.effect.parameters[0].name
    beside = (float(e.values[first]) for e in given if e.key == instance.key and not e.in_model)
    return float(said + sum(beside))
