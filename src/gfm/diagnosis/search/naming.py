"""Names of effects, also of what recordings cannot tell apart: one law under two names.

A constant torque is one, where friction could be it. A delay is another: it moves positions,
efforts, or both, against the commands (`gfm.effects.effect.Shift`). What is not seen of that in
given recordings, nothing tells apart there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import free_parameters
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import Effect, EffectInstance, effect_library, find_effect

Ranked = TypeVar("Ranked")
OFFSET, ASYMMETRY = "torque_offset", "asymmetric_friction"
#: Effects that are dry friction themselves.
DRY = ("coulomb_friction", "stribeck_friction", "load_dependent_friction")
#: Shifts that differ by less are the same, s.
SAME_S = 1e-9


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
    if instance.effect.name == OFFSET:
        other, values = ASYMMETRY, {"difference": -2.0 * instance.values["torque"]}
    else:
        other, values = OFFSET, {"torque": -0.5 * instance.values["difference"]}
    return EffectInstance(effect=find_effect(other), joints=instance.joints, values=values)


def twins(*effects: EffectInstance) -> list[EffectInstance]:
    """Returns the same torque under its other name, of those of `effects` that have one."""
    return [twin_of(e) for e in effects if e.effect.name in (OFFSET, ASYMMETRY)]


def first_of_each(ranked: Iterable[Ranked], key: Callable[[Ranked], object]) -> list[Ranked]:
    """Returns the first of each key in order: of several starts of one candidate, the best."""
    return [alike[0] for alike in grouped(ranked, key)]


def grouped(some: Iterable[Ranked], key: Callable[[Ranked], object]) -> list[list[Ranked]]:
    """Returns those of each key together, in order."""
    groups: dict[object, list[Ranked]] = {}
    for one in some:
        groups.setdefault(key(one), []).append(one)
    return list(groups.values())


def describe(instance: EffectInstance) -> str:
    """Returns an effect and its place in words."""
    return placed_in_words(*instance.key)


def placed_in_words(effect: str, joints: Sequence[str]) -> str:
    """Returns the name of an effect and its joints in words."""
    where = f" on {', '.join(joints)}" if joints else ""
    return f"{effect.replace('_', ' ')}{where}"


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What there is in recordings that tells delays apart.

    Attributes:
        has_efforts: Whether drive torques were measured.
        has_feedback: Whether servos follow the commands; commanded torques feel no motion.
        command_period_s: Of commanded torques, where efforts show the command before that of their
            own stamp, else zero: it is measured a moment earlier, or later by less than a period.
    """

    has_efforts: bool
    has_feedback: bool = True
    command_period_s: float = 0.0


def recorded(problem: Problem) -> Recorded:
    """Returns what there is in the recordings of a problem that tells delays apart.

    Beside which command efforts were taken is that of the problem, see `timed`.
    """
    feedback = any(s.kind is not CommandKind.EFFORT for s in problem.segments)
    periods = [
        float(np.median(np.diff(s.command_time_s)))
        for s in problem.segments
        if s.same_stamp_s > 0.0 and len(s.command_time_s) > 1
    ]
    beside = len(periods) == len(problem.segments) and problem.in_force.ahead_s < 0.0
    alike = beside and not feedback and problem.has_efforts
    return Recorded(
        has_efforts=problem.has_efforts,
        has_feedback=feedback,
        command_period_s=min(periods) if alike else 0.0,
    )


def equals_of(instance: EffectInstance, seen: Recorded) -> tuple[EffectInstance, ...]:
    """Returns the other names, with their amounts, of a delay that recordings show just so.

    None of what is no delay, of what is a law of its own there (a servo whose feedback is late),
    and of what does not show at all.
    """
    moved = _moved(instance, seen)
    if moved is None or not moved.any():
        return ()
    others = [one for one in effect_library().values() if one.name != instance.effect.name]
    named = [_named(other, instance.joints, moved, seen) for other in others]
    return tuple(one for one in named if one is not None)


def looked_for(effects: Iterable[Effect], seen: Recorded) -> list[Effect]:
    """Returns the effects without those delays that are other names of some before them.

    And without those that do not show. Whatever their amounts: one whose smaller amounts only are
    those of another stays.
    """
    kept: list[Effect] = []
    for effect in effects:
        ends = [(one, _moved(one, seen)) for one in _extremes(effect)]
        if ends and all(moved is not None for _, moved in ends):
            shows = any(np.any(moved) for _, moved in ends)
            equal = ({e.effect for e in equals_of(one, seen)} for one, _ in ends)
            if not shows or all(names & set(kept) for names in equal):
                continue
        kept.append(effect)
    return kept


def _moved(instance: EffectInstance, seen: Recorded) -> Array | None:
    """Returns by how much positions and efforts are seen to move against commands, s, (2,).

    None of what is no delay there.
    """
    shift = instance.effect.shift
    if shift is None or (shift.feedback and seen.has_feedback):
        return None
    amount = float(instance.values[instance.effect.parameters[0].name])
    efforts = shift.efforts * amount if seen.has_efforts else 0.0
    unseen = 0.0 <= efforts < seen.command_period_s
    return np.array([shift.positions * amount, 0.0 if unseen else efforts])


def _named(
    other: Effect, joints: tuple[str, ...], moved: Array, seen: Recorded
) -> EffectInstance | None:
    """Returns the delay that moves as much under another name; None where it cannot."""
    if other.shift is None:
        return None
    amount = float(moved[0] if other.shift.positions else moved[1])
    one = EffectInstance(effect=other, joints=joints, values={other.parameters[0].name: amount})
    there = _moved(one, seen)
    alike = there is not None and np.abs(there - moved).max() < SAME_S
    return one if alike and other.admissible(one.values) else None


def _extremes(effect: Effect) -> list[EffectInstance]:
    """Returns a delay at its bounds, where that is something."""
    first = effect.parameters[0]
    ends = [value for value in (first.lower, first.upper) if value != 0.0]
    return [EffectInstance(effect=effect, joints=(), values={first.name: end}) for end in ends]
