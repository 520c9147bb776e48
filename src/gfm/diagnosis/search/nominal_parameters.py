"""What a model itself says of its joints: it may say too much.

Effects add to a model. Where its own damping, dry friction or motor inertia is larger than the
robot's, less than nothing is to be added, and no less than takes off all that the model says.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import mujoco
import numpy as np

from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place
from gfm.effects import EffectInstance
from gfm.effects.effect import find_motor_side

#: Share of its motors' inertia that a model keeps: what is light cannot be simulated without.
KEPT = 0.05

#: Where a joint says how much it has of an effect.
_SAYS: Mapping[str, str] = {
    "coulomb_friction": "frictionloss",
    "viscous_friction": "damping",
    "armature": "armature",
}


def with_room(problem: Problem, place: Place) -> Place:
    """Returns a candidate that may take off what every model of a problem says there."""
    name = place.effect.name
    if name not in _SAYS:
        return place
    kept = KEPT if name == "armature" else 0.0
    says = min(_said(spec, name, place.joints[0]) for spec in problem.specs.values())
    most = (1.0 - kept) * says
    return replace(place, least={place.effect.parameters[0].name: -most}) if most > 0.0 else place


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
