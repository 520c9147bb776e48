"""What changed: the sets of recordings compared, after each was diagnosed by itself.

Shape letters: K sets, oldest first.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import fit, free_parameters
from gfm.diagnosis.output.changes import Changes, SetAmount, sentence_on_changes
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.diagnosis.search.naming import twin_of
from gfm.diagnosis.search.nominal_parameters import said_already
from gfm.diagnosis.search.sets import OverSets, Sets
from gfm.effects import EffectInstance, Parameter

#: Standard errors of an interval that covers 95 %.
COVERS = 1.96
#: The effect of which one is nothing.
GAIN = "actuator_gain"


@dataclass(frozen=True, kw_only=True, eq=False)
class Found:
    """What one set says by itself.

    Attributes:
        names: Of its recordings.
        problem: To which amounts were fitted.
        effects: All that was found.
        credible: Those that are more likely right than wrong.
    """

    names: tuple[str, ...]
    problem: Problem
    effects: Sequence[EffectInstance]
    credible: Sequence[EffectInstance]


def what_changed(
    found: Sequence[Found],
    specs: Collection[mujoco.MjSpec],
    given: Sequence[EffectInstance],
    report: Callable[[str], None],
) -> Changes:
    """Returns which amounts differ between sets of recordings.

    Args:
        found: In each set by itself, oldest first, two at least.
        specs: The nominal model by the kind of command.
        given: Effects of it that they cannot say.
        report: Told what is happening, in words.
    """
    report("comparing the sets")
    effects = _of_all_sets(found)
    names = tuple(one.names for one in found)
    if not effects:
        return Changes(sentence=sentence_on_changes(()), sets=names, amounts=())
    sets = _fitted_to_each(found, effects)
    over = sets.simplest(sets.apart(), report)
    credible = {_usual(e).key for one in found for e in one.credible}
    told = tuple(
        replace(amount, already=_already(effect, specs, given), credible=effect.key in credible)
        for i, effect in enumerate(sets.effects)
        for amount in _amounts(sets, over, i)
    )
    return Changes(sentence=sentence_on_changes(told), sets=names, amounts=told)


def _usual(instance: EffectInstance) -> EffectInstance:
    """Returns a law under the one of its names by which it is looked for."""
    return twin_of(instance) if instance.effect.twin else instance


def _of_all_sets(found: Sequence[Found]) -> tuple[EffectInstance, ...]:
    """Returns the effects of all sets, each as it was found last."""
    newest = {e.key: e for one in found for e in map(_usual, one.effects)}
    return tuple(newest.values())


def _fitted_to_each(found: Sequence[Found], effects: Sequence[EffectInstance]) -> Sets:
    """Returns effects fitted to each set, from where they were found there, or else last."""
    problems, fits = [], []
    for one in found:
        own = {e.key: e for e in map(_usual, one.effects)}
        begun = [_begun(own.get(e.key, e), e) for e in effects]
        problem = with_suitable_steps(one.problem, begun)
        problem = problem.settled(fit(problem, begun).effects).robust(begun)
        problems.append(problem)
        fits.append(fit(problem, begun))
    unwrapped = [_turned(fitted.effects, fits[-1].effects) for fitted in fits]
    fits = [replace(one, effects=own) for one, own in zip(fits, unwrapped, strict=True)]
    return Sets(problems=tuple(problems), fits=tuple(fits))


def _turned(
    effects: Sequence[EffectInstance], newest: Sequence[EffectInstance]
) -> tuple[EffectInstance, ...]:
    """Returns effects with angles within half a turn of others', where that is the same."""
    turned = []
    for one, other in zip(effects, newest, strict=True):
        near = {
            name: value - 2.0 * np.pi * round((value - other.values[name]) / (2.0 * np.pi))
            for name, value in one.values.items()
        }
        back = one.effect.canonical(near)
        same = all(np.isclose(back[name], value) for name, value in one.values.items())
        turned.append(replace(one, values=near) if same else one)
    return tuple(turned)


def _begun(instance: EffectInstance, newest: EffectInstance) -> EffectInstance:
    """Returns an effect with those amounts of the newest one that no fit changes."""
    fixed = {name: newest.values[name] for name in instance.effect.fixed}
    return replace(instance, values={**instance.values, **fixed})


def _amounts(sets: Sets, over: OverSets, index: int) -> list[SetAmount]:
    """Returns the amounts of one effect; those that no fit changes are known as they are."""
    instance = sets.effects[index]
    seen = sets.seen(over, index, 1.0 if instance.effect.name == GAIN else 0.0)
    free = [name for i, name in free_parameters(sets.effects) if i == index]
    values, errors = (dict(zip(free, rows.T, strict=True)) for rows in sets.alone(over, index))
    told = []
    for parameter in instance.effect.parameters:
        name = parameter.name
        own = values.get(name, np.full(len(seen), instance.values[name]))
        apart = errors.get(name, np.zeros(len(seen)))
        mean, error, spread = random_effects(own, apart)
        low, high = _possible(instance, parameter, mean, COVERS * float(np.hypot(error, spread)))
        told.append(
            SetAmount(
                effect=instance.effect.name,
                joints=instance.joints,
                parameter=name,
                unit=parameter.unit,
                course=over.courses[index],
                values=tuple(map(float, own)),
                errors=tuple(map(float, apart)),
                seen=seen,
                already=None,
                mean=mean,
                spread=spread,
                low=low,
                high=high,
                credible=False,
            )
        )
    return told


def _possible(
    instance: EffectInstance, parameter: Parameter, mean: float, reach: float
) -> tuple[float, float]:
    """Returns a range within what is possible; the amount itself where no set shows it."""
    if not np.isfinite(reach):
        return mean, mean
    least = instance.least.get(parameter.name, parameter.lower)
    most = parameter.upper
    return float(np.clip(mean - reach, least, most)), float(np.clip(mean + reach, least, most))


def random_effects(values: Array, errors: Array) -> tuple[float, float, float]:
    """Returns mean, its standard error, and the spread from set to set (DerSimonian, Laird 1986).

    Sets that do not show an amount, with an infinite error, say nothing.

    Args:
        values: In each set, shape (K,).
        errors: Their standard errors, shape (K,).
    """
    shown = np.isfinite(errors)
    if not shown.any():
        return float(values.mean()), float("inf"), 0.0
    values, variances = values[shown], np.maximum(errors[shown], 1e-12) ** 2
    weights = 1.0 / variances
    total = weights.sum()
    apart = float(weights @ (values - weights @ values / total) ** 2) - (len(values) - 1)
    between = 0.0
    if len(values) > 1:
        between = max(apart / float(total - weights @ weights / total), 0.0)
    weights = 1.0 / (variances + between)
    mean = float(weights @ values / weights.sum())
    return mean, float(weights.sum() ** -0.5), between**0.5


def _already(
    instance: EffectInstance,
    specs: Collection[mujoco.MjSpec],
    given: Sequence[EffectInstance],
) -> float | None:
    return 0.0 if instance.effect.name == GAIN else said_already(specs, given, instance)
