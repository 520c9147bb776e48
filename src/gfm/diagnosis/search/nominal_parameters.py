"""What a model itself says of its joints: it may say too much.

Effects add to a model. Where its own damping, dry friction or motor inertia is larger than the
robot's, less than nothing is to be added. Of one joint that is a candidate like any other. Of all
of them together, what the model has is taken out, fitted as if it were missing, and told as what is
to be added; more than it says is not looked for there: effects do that.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place
from gfm.effects import EffectInstance, Key, find_effect
from gfm.effects.effect import find_motor_side

#: Share of its motors' inertia that a model keeps: what is light cannot be simulated without.
KEPT = 0.05
#: Share of what a model says of a joint up to which it need not be right: nobody knows it better.
SLIGHT = 0.05

#: Where a joint says how much it has of an effect.
_SAYS: Mapping[str, str] = {
    "coulomb_friction": "frictionloss",
    "viscous_friction": "damping",
    "armature": "armature",
}


def without_own(
    problem: Problem, keys: Collection[Key] | None = None
) -> tuple[Problem, tuple[EffectInstance, ...]]:
    """Returns the problem with models that say next to nothing of their joints, and what they said.

    Args:
        problem: With models that do.
        keys: Effects and places of what is taken out; everything where they are not given.
    """
    specs = {kind: spec.copy() for kind, spec in problem.specs.items()}
    own: dict[Key, EffectInstance] = {}
    for spec in specs.values():
        for name, field in _SAYS.items():
            effect = find_effect(name)
            for joint in problem.joints:
                key = (name, (joint,))
                if keys is not None and key not in keys:
                    continue
                said = _take_out(find_motor_side(spec, joint), field)
                if said > 0.0:
                    amount = {effect.parameters[0].name: said}
                    own[key] = EffectInstance(
                        effect=effect, joints=(joint,), values=amount, most=amount
                    )
    return replace(problem, specs=specs), tuple(own.values())


def with_room(problem: Problem, place: Place) -> Place:
    """Returns a candidate that may take off what every model of a problem says there."""
    name = _SAYS.get(place.effect.name)
    if name is None:
        return place
    sides = [find_motor_side(spec, place.joints[0]) for spec in problem.specs.values()]
    says = min(_spare(side, name) for side in sides)
    return replace(place, least={place.effect.parameters[0].name: -says}) if says > 0.0 else place


def covers(spec: mujoco.MjSpec, instance: EffectInstance) -> bool:
    """Returns whether a model has as much of an effect as `instance` takes off."""
    field = _SAYS.get(instance.effect.name)
    if field is None or not instance.takes_off:
        return False
    (taken,) = instance.values.values()
    said = _said(find_motor_side(spec, instance.joints[0]), field)[0]
    return bool(said + taken >= 0.0)


def slight(specs: Collection[mujoco.MjSpec], instance: EffectInstance) -> bool:
    """Returns whether an effect changes only slightly what models say of a joint."""
    field = _SAYS.get(instance.effect.name)
    if field is None or not specs:
        return False
    (change,) = instance.values.values()
    said = [_said(find_motor_side(spec, instance.joints[0]), field)[0] for spec in specs]
    return bool(abs(change) < SLIGHT * min(said))


def _said(joint: mujoco.MjsJoint, field: str) -> Array:
    """Returns what a joint says of itself: one number, or the coefficients of a polynomial."""
    return np.ravel(getattr(joint, field)).astype(float)


def _spare(joint: mujoco.MjsJoint, field: str) -> float:
    """Returns how much can be taken out of what a joint says of itself."""
    return float((1.0 - _kept(field)) * _said(joint, field)[0])


def _take_out(joint: mujoco.MjsJoint, field: str) -> float:
    """Takes that out, and returns how much it is."""
    taken, kept = _spare(joint, field), _kept(field) * _said(joint, field)
    setattr(joint, field, kept if len(kept) > 1 else float(kept[0]))
    return taken


def _kept(field: str) -> float:
    return KEPT if field == "armature" else 0.0


def with_own(
    effects: Sequence[EffectInstance], own: Sequence[EffectInstance]
) -> tuple[EffectInstance, ...]:
    """Returns effects of the model as those of one that says nothing, what it says among them.

    What took something off is not looked for beyond what the model says.
    """
    said = {e.key: e for e in own}
    mine = []
    for e in effects:
        by = said.pop(e.key, None)
        most = by.values if by is not None and e.takes_off else {}
        mine.append(e if by is None else replace(_changed(e, by, 1.0), most=most, least={}))
    return (*mine, *said.values())


def beside_own(
    effects: Sequence[EffectInstance], own: Sequence[EffectInstance]
) -> tuple[EffectInstance, ...]:
    """Returns effects of a model that says nothing as those to be added to what it does say."""
    said = {e.key: e for e in own}
    return tuple(
        replace(_changed(e, said[e.key], -1.0), most={}) if e.key in said else e for e in effects
    )


def _changed(instance: EffectInstance, by: EffectInstance, sign: float) -> EffectInstance:
    values = {name: value + sign * by.values[name] for name, value in instance.values.items()}
    return replace(instance, values=values)


def said_already(
    specs: Collection[mujoco.MjSpec], given: Sequence[EffectInstance], instance: EffectInstance
) -> float | None:
    """Returns how much of an effect's first amount a model has already; None where it is no sum.

    Args:
        specs: The model by the kind of command.
        given: Effects of the model that they cannot say.
        instance: The effect, and where.
    """
    field = _SAYS.get(instance.effect.name)
    if field is None:
        return None
    said = float(_said(find_motor_side(next(iter(specs)), instance.joints[0]), field)[0])
    first = instance.effect.parameters[0].name
    beside = (e.values[first] for e in given if e.key == instance.key and not e.in_model)
    return said + sum(beside)
