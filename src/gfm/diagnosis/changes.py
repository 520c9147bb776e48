"""What changed: the sets of recordings compared, after each was diagnosed by itself.

Shape letters: K sets, oldest first.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.found import Found
from gfm.diagnosis.inference.amounts import free_parameters
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.output.changes import Changes, SetAmount, sentence_on_changes
from gfm.diagnosis.output.claims import credible
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.diagnosis.search.naming import twin_of
from gfm.diagnosis.search.sets import OverSets, Sets
from gfm.effects import EffectInstance, Key
from gfm.effects.nominal_parameters import said_already

#: Standard errors of an interval that covers 95 %.
COVERS = 1.96
#: The effect of which one is nothing.
GAIN = "actuator_gain"


def what_changed(found: Sequence[Found], report: Callable[[str], None]) -> Changes:
    """Returns which amounts differ between sets of recordings.

    Args:
        found: In each set by itself, oldest first, two at least.
        report: Told what is happening, in words.
    """
    report("comparing the sets")
    results = [one.result for one in found if one.result is not None]
    effects = _found_last([_usual(e) for one in results for e in one.fit.effects])
    sure = {_usual(e).key for one in results for e in credible(one)}
    told: list[SetAmount] = []
    if effects:
        sets = _fitted_to_each(found, tuple(effects.values()))
        over = sets.simplest(sets.apart(), report)
        for i, effect in enumerate(sets.effects):
            told += _amounts(sets, over, i, credible=effect.key in sure)
    return Changes(
        sentence=sentence_on_changes(told),
        sets=tuple(tuple(run.name for run in one.recordings) for one in found),
        amounts=tuple(told),
    )


def _found_last(every: Sequence[EffectInstance]) -> dict[Key, EffectInstance]:
    """Returns each effect as it was found last; of two ways to take a motor off its link that one.

    Args:
        every: Of all sets, oldest first.
    """
    told = dict[Key, EffectInstance]()
    for one in every:
        apart = [e for e in told.values() if e.effect.separates_motor and e.joints == one.joints]
        for before in apart if one.effect.separates_motor else ():
            del told[before.key]
        told[one.key] = one
    return told


def _usual(instance: EffectInstance) -> EffectInstance:
    """Returns a law under the one of its names by which it is looked for."""
    return twin_of(instance) if instance.effect.twin else instance


def _fitted_to_each(found: Sequence[Found], effects: Sequence[EffectInstance]) -> Sets:
    """Returns effects fitted to each set, from where they were found there, or else last."""
    problems, fits = [], []
    for one in found:
        own = {e.key: e for e in map(_usual, one.result.fit.effects if one.result else ())}
        begun = [_begun(own.get(e.key, e), e) for e in effects]
        problem = with_suitable_steps(one.long, begun)
        problem = problem.settled(fit(problem, begun).effects).robust(begun)
        problems.append(problem)
        fits.append(fit(problem, begun))
    newest = fits[-1].effects
    fits = [replace(f, effects=tuple(map(_turned, f.effects, newest))) for f in fits]
    return Sets(problems=tuple(problems), fits=tuple(fits))


def _begun(instance: EffectInstance, newest: EffectInstance) -> EffectInstance:
    """Returns an effect with those amounts of the newest one that no fit changes."""
    fixed = {name: newest.values[name] for name in instance.effect.fixed}
    return replace(instance, values={**instance.values, **fixed})


def _turned(instance: EffectInstance, newest: EffectInstance) -> EffectInstance:
    """Returns an effect with angles within half a turn of the newest, where that is the same."""
    whole = 2.0 * np.pi
    near = {
        n: v - whole * round((v - newest.values[n]) / whole) for n, v in instance.values.items()
    }
    back = instance.effect.canonical(near)
    same = all(np.isclose(back[name], value) for name, value in instance.values.items())
    return replace(instance, values=near) if same else instance


def _amounts(sets: Sets, over: OverSets, index: int, *, credible: bool) -> list[SetAmount]:
    """Returns the amounts of one effect; those that no fit changes are known as they are."""
    instance, model = sets.effects[index], sets.problems[-1]
    none, already = 0.0, said_already(model.specs.values(), model.given, instance)
    if instance.effect.name == GAIN:
        none, already = 1.0, 0.0
    seen = sets.seen(over, index, none)
    free = [name for i, name in free_parameters(sets.effects) if i == index]
    values, errors = (dict(zip(free, rows.T, strict=True)) for rows in sets.alone(over, index))
    told = []
    for parameter in instance.effect.parameters:
        name = parameter.name
        own = values.get(name, np.full(len(seen), instance.values[name]))
        apart = errors.get(name, np.zeros(len(seen)))
        mean, error, spread = random_effects(own, apart)
        reach = COVERS * float(np.hypot(error, spread))
        if not np.isfinite(reach):  # no set shows it
            reach = 0.0
        possible = instance.least.get(name, parameter.lower), parameter.upper
        told.append(
            SetAmount(
                *instance.key,
                parameter=name,
                unit=parameter.unit,
                course=over.courses[index],
                values=tuple(map(float, own)),
                errors=tuple(map(float, apart)),
                seen=seen,
                already=already,
                mean=mean,
                spread=spread,
                low=float(np.clip(mean - reach, *possible)),
                high=float(np.clip(mean + reach, *possible)),
                credible=credible,
            )
        )
    return told


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
    between = 0.0
    if len(values) > 1:
        weights = 1.0 / variances
        total = weights.sum()
        apart = float(weights @ (values - weights @ values / total) ** 2) - (len(values) - 1)
        between = max(apart / float(total - weights @ weights / total), 0.0)
    weights = 1.0 / (variances + between)
    mean = float(weights @ values / weights.sum())
    return mean, float(weights.sum() ** -0.5), between**0.5
