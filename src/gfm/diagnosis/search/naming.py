"""Names of effects, also of what recordings cannot tell apart: one law under two names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.diagnosis.inference.fitting import Fit, free_parameters
from gfm.effects import EffectInstance, effect_library

Ranked = TypeVar("Ranked")
OFFSET, ASYMMETRY = "torque_offset", "asymmetric_friction"
#: Effects that are dry friction themselves.
DRY = ("coulomb_friction", "stribeck_friction", "load_dependent_friction")


def fitly_named(fit: Fit, specs: Mapping[CommandKind, mujoco.MjSpec]) -> Fit:
    """Returns the fit with constant torques called asymmetric friction where that is likelier.

    A constant torque on a joint with dry friction that is larger is a friction that differs with
    the direction: both are the same torque, moving and at rest. Without such a friction, or larger
    than it, it cannot be friction.
    """
    effects = list(fit.effects)
    jacobian = fit.jacobian.copy()
    columns = free_parameters(fit.effects)
    for i, instance in enumerate(effects):
        if instance.effect.name != OFFSET:
            continue
        if abs(instance.values["torque"]) < _dry_friction(instance.joints[0], fit.effects, specs):
            effects[i] = twin_of(instance)
            jacobian[:, columns.index((i, "torque"))] *= -0.5
    return replace(fit, effects=tuple(effects), jacobian=jacobian)


def _dry_friction(
    joint: str, effects: Sequence[EffectInstance], specs: Mapping[CommandKind, mujoco.MjSpec]
) -> float:
    """Returns the level of dry friction on a joint, without end where it changes, N m."""
    level = float(next(iter(specs.values())).joint(joint).frictionloss)
    for instance in effects:
        if instance.joints == (joint,) and instance.effect.name in DRY:
            level += instance.values.get("torque", np.inf)
    return level


def twin_of(instance: EffectInstance) -> EffectInstance:
    """Returns the same torque under its other name."""
    library = effect_library()
    if instance.effect.name == OFFSET:
        values = {"difference": -2.0 * instance.values["torque"]}
        return EffectInstance(effect=library[ASYMMETRY], joints=instance.joints, values=values)
    values = {"torque": -0.5 * instance.values["difference"]}
    return EffectInstance(effect=library[OFFSET], joints=instance.joints, values=values)


def twins(effects: Sequence[EffectInstance]) -> list[tuple[EffectInstance, EffectInstance]]:
    """Returns the other name of each of `effects` that has one, with the effect itself."""
    return [(twin_of(e), e) for e in effects if e.effect.name in (OFFSET, ASYMMETRY)]


def first_of_each(ranked: Iterable[Ranked], key: Callable[[Ranked], object]) -> list[Ranked]:
    """Returns the first of each key in order: of several starts of one candidate, the best."""
    first: dict[object, Ranked] = {}
    for one in ranked:
        first.setdefault(key(one), one)
    return list(first.values())


def describe(instance: EffectInstance) -> str:
    """Returns an effect and its place in words."""
    where = f" on {', '.join(instance.joints)}" if instance.joints else ""
    return f"{instance.effect.name.replace('_', ' ')}{where}"
