"""Which candidates are worth a fit: their responses to a small amount, against the residual.

Shape letters: N numbers of a residual.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import Fit, times_each, without
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.residuals.outliers import bounded, slopes, unbounded
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis
from gfm.effects import Effect, EffectInstance, Scope

S = TypeVar("S", Place, EffectInstance)
T = TypeVar("T")


class Screened(NamedTuple):
    """A candidate with the amount that fits best to first order.

    `gain` is by how much it would predict better, to first order or, if that is more, in a rollout
    with that amount: far from the truth, first order says little of a law that makes joints stick.
    """

    instance: EffectInstance
    gain: Difference


def open_to(
    before: Hypothesis, candidates: Sequence[Place], open_joints: Collection[str]
) -> list[Place]:
    """Returns the candidates not yet there that touch a joint with something to explain."""
    problem, joints = before.problem, set(open_joints)
    given = [e for e in problem.given if not e.joints]  # a tilt is no amount to add to another
    taken = {instance.key for instance in (*given, *before.effects)}
    return [
        place
        for place in candidates
        if place.key not in taken
        and goes_beside(before, place)
        and (place.effect.scope is not Scope.JOINT or place.joints[0] in joints)
        and (place.effect.scope is not Scope.PAIR or set(place.joints) <= joints)
    ]


def goes_beside(before: Hypothesis, one: Place | EffectInstance) -> bool:
    """Returns whether an effect can be added: a motor is taken apart from its link only once."""
    apart = {e.joints for e in before.effects if e.effect.separates_motor}
    return not (one.effect.separates_motor and one.joints in apart | before.problem.separated)


def screen(before: Hypothesis, candidates: Sequence[Place], sample_s: float) -> list[Screened]:
    """Returns candidates with their best amounts to first order, on `sample_s` s, best first."""
    sample = before.problem.sample(sample_s, left=before.fit.residual)
    part = before.problem.subset(sample)
    base = rows_of(before, sample)
    basis = np.linalg.qr(base.jacobian)[0]
    start = replace(base, residual=without(base.residual, basis))
    responses = _responses(part, candidates, base, basis)
    here = Hypothesis(problem=part, fit=start, nominal=before.nominal)
    # An amount is that of all parts: left out, a few segments would be told by one or two.
    found = [
        Screened(one, -here.over(replace(base, residual=left)))
        for one, left in _tried(part, responses, base, basis)
    ]
    return sorted(found, key=lambda s: -s.gain.nats)


def rows_of(before: Hypothesis, segments: Sequence[int]) -> Fit:
    """Returns the fit of a hypothesis on some segments only."""
    slices, fit = before.problem.slices(), before.fit
    rows = np.r_[tuple(slices[i] for i in segments)]
    return replace(fit, jacobian=fit.jacobian[rows], residual=fit.residual[rows])


def _responses(
    problem: SegmentedProblem, candidates: Sequence[Place], base: Fit, basis: Array
) -> list[tuple[EffectInstance, Array]]:
    """Returns candidates in their best amounts, their valleys apart, and what that explains.

    To first order, of the residual beside `base`, for which `basis` makes up, shape (N,).
    """
    groups = [(place, group) for place in candidates for group in place.probes]
    residual = without(base.residual, basis)
    weights = slopes(base.residual, problem.limits())[:, None]
    best: dict[tuple[object, ...], tuple[float, EffectInstance, Array]] = {}
    for place, group, changes in changes_of(problem.coarse(), groups, base.effects):
        weighed = weigh(place, group, without(weights * changes, basis), residual)
        if weighed is None:
            continue
        instance, explained = weighed
        left = float(np.sum((residual - explained) ** 2))
        # A fit cannot go from one valley to another: each is a candidate.
        apart = (*place.effect.fixed, *place.effect.valleys)
        variant = (place.key, *(group[0].values[name] for name in apart))
        if variant not in best or left < best[variant][0]:
            best[variant] = left, instance, explained
    return [(instance, explained) for _, instance, explained in best.values()]


def changes_of(
    problem: SegmentedProblem,
    groups: Sequence[tuple[Place, list[EffectInstance]]],
    effects: Sequence[EffectInstance],
) -> Iterator[tuple[Place, list[EffectInstance], Array]]:
    """Yields groups of probes with what each changes beside `effects`, shape (N, probes)."""
    for alike in _on_same_steps(groups):
        sets = [(*effects, instance) for _, group in alike for instance in group]
        still, *moved = problem.residuals([effects, *sets])
        changes = iter(still - m for m in moved)
        for place, group in alike:
            yield place, group, np.stack([next(changes) for _ in group], axis=1)


def _on_same_steps(items: Sequence[tuple[S, T]]) -> list[list[tuple[S, T]]]:
    """Returns together what is simulated on the same time steps, by the effect of each.

    Motors apart from their links have steps of their own, and so has what a candidate that has one
    is compared with.
    """
    both = [[i for i in items if i[0].effect.separates_motor is apart] for apart in (False, True)]
    return [alike for alike in both if alike]


def _tried(
    problem: SegmentedProblem,
    found: Sequence[tuple[EffectInstance, Array]],
    base: Fit,
    basis: Array,
) -> Iterator[tuple[EffectInstance, Array]]:
    """Yields candidates with what they leave: to first order, or by a rollout if that is less.

    Of the rollout, the share that fits best: where the first order says too much, less of it may
    explain all. The effects of `base` make up for it to first order, by `basis`.
    """
    fast, limits = problem.coarse(), problem.limits()
    full = unbounded(base.residual, limits)
    for alike in _on_same_steps(found):
        sets = [base.effects, *((*base.effects, instance) for instance, _ in alike)]
        before, *after = fast.residuals(sets)
        for (instance, explained), rolled in zip(alike, after, strict=True):
            # What fast integration alone changes is no gain of a candidate.
            moved = rolled - before
            best = -float(moved @ full) / max(float(moved @ moved), 1e-12)
            lefts = [without(bounded(full + x * moved, limits), basis) for x in (1.0, best)]
            yield instance, min(*lefts, base.residual - explained, key=np.linalg.norm)


def weigh(
    place: Place, group: Sequence[EffectInstance], columns: Array, residual: Array
) -> tuple[EffectInstance, Array] | None:
    """Returns a candidate with the weights of its probes that explain most, and what they explain.

    None where the effect has no such amounts.
    """
    amplitudes = times_each(columns, residual)
    explained = columns @ amplitudes
    values = place.effect.combine([i.values for i in group], [float(a) for a in amplitudes])
    if values is None and place.least:
        values = _taken_off(place, group[0], float(amplitudes[0]))
        explained = np.zeros_like(residual)  # half a damping is twice the speed: a rollout tells
    if values is None or not np.isfinite(explained).all():
        return None
    return place.instance(values), np.asarray(explained)


def _taken_off(place: Place, probe: EffectInstance, amplitude: float) -> dict[str, float] | None:
    """Returns what takes off as much as explains most, and no more than there is; None for more."""
    if not amplitude < 0.0:
        return None
    taken = {name: max(amplitude * probe.values[name], most) for name, most in place.least.items()}
    return {**probe.values, **taken}


def is_whole(effect: Effect) -> bool:
    """Returns whether an effect is of the whole robot, not of one joint or two."""
    return effect.scope in (Scope.ROBOT, Scope.LAST, Scope.OBJECT)
