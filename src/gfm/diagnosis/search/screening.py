"""Which candidates are worth a fit: their responses to a small amount, against the residual.

Shape letters: N numbers of a residual.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import Fit, orthonormal
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place
from gfm.effects import Effect, EffectInstance, Scales, Scope

T = TypeVar("T")

#: Candidates that are fitted in earnest in each round, places of one effect among them, and values
#: from which the fit of one begins.
SHORTLIST, SHORTLIST_PER_EFFECT, STARTS = 6, 2, 3
#: Gain from which an effect of the whole robot is fitted in any case.
WHOLE_GAIN = 0.2
#: Recorded time on which candidates are screened.
SCREENING_S = 24.0
#: A joint is suspected when its misfit is at least this share of the worst joint's.
SUSPECT_JOINT = 0.02
#: Joints that are suspected in any case.
LEAST_SUSPECTS = 2


@dataclass(frozen=True, kw_only=True)
class Screened:
    """A candidate with the amount that fits best to first order.

    `gain` is the share of the squared residual that it would explain, to first order or, if that is
    more, in a rollout with that amount: far from the truth, first order says little of a law that
    makes joints stick.
    """

    instance: EffectInstance
    gain: float


def suspected(problem: Problem, candidates: Sequence[Place], base: Fit) -> list[Place]:
    """Returns the candidates not yet accepted that touch a joint with something to explain."""
    costs = problem.joint_costs(base.residual) - 1.0
    worst = np.argsort(-costs)
    joints = {
        problem.joints[j]
        for rank, j in enumerate(worst)
        if rank < LEAST_SUSPECTS or costs[j] > SUSPECT_JOINT * costs[worst[0]]
    }
    given = [e for e in problem.given if not e.joints]  # a tilt is no amount to add to another
    taken = {instance.key for instance in (*given, *base.effects)}
    separated = {e.joints for e in base.effects if e.effect.separates_motor} | problem.separated
    return [
        place
        for place in candidates
        if place.key not in taken
        and not (place.effect.separates_motor and place.joints in separated)
        and (place.effect.scope is not Scope.JOINT or place.joints[0] in joints)
        and (place.effect.scope is not Scope.PAIR or set(place.joints) <= joints)
    ]


def screen(
    problem: Problem, candidates: Sequence[Place], scales: Sequence[Scales], base: Fit
) -> list[Screened]:
    """Returns the candidates with their best amounts to first order, best first."""
    sample = problem.sample(SCREENING_S)
    fast, here = problem.subset(sample).coarse(), _rows(problem, sample)
    there = replace(base, jacobian=base.jacobian[here], residual=base.residual[here])
    found = _to_first_order(fast, candidates, scales, there)
    return sorted(_tried(fast, found, there), key=lambda s: -s.gain)


def _to_first_order(
    problem: Problem, candidates: Sequence[Place], scales: Sequence[Scales], base: Fit
) -> list[Screened]:
    """Returns what each candidate explains to first order beside `base`."""
    groups = list(probes(problem, candidates, scales))
    basis = orthonormal(base.jacobian)
    residual = base.residual - basis @ (basis.T @ base.residual)
    best: dict[tuple[object, ...], Screened] = {}
    for place, group, columns in _columns(problem, groups, base.effects):
        found = weigh(place, group, columns - basis @ (basis.T @ columns), residual)
        # A fit cannot go from one valley to another: each is a candidate.
        apart = (*place.effect.fixed, *place.effect.valleys)
        variant = (place.key, *(group[0].values[name] for name in apart))
        if found and (variant not in best or found.gain > best[variant].gain):
            best[variant] = found
    return list(best.values())


def _columns(
    problem: Problem,
    groups: Sequence[tuple[Place, list[EffectInstance]]],
    effects: Sequence[EffectInstance],
) -> Iterator[tuple[Place, list[EffectInstance], Array]]:
    """Yields groups of probes with what each changes beside `effects`, shape (N, probes)."""
    for alike in _on_same_steps(groups, lambda one: one[0].effect):
        sets = [(*effects, instance) for _, group in alike for instance in group]
        still, *moved = problem.residuals([effects, *sets])
        changes = iter(still - m for m in moved)
        for place, group in alike:
            yield place, group, np.stack([next(changes) for _ in group], axis=1)


def _on_same_steps(items: Sequence[T], effect: Callable[[T], Effect]) -> list[list[T]]:
    """Returns together what is simulated on the same time steps, by the effect of each.

    Motors apart from their links have steps of their own, and so has what a candidate that has one
    is compared with.
    """
    both = [[i for i in items if effect(i).separates_motor is apart] for apart in (False, True)]
    return [alike for alike in both if alike]


def _tried(problem: Problem, found: Sequence[Screened], base: Fit) -> list[Screened]:
    """Returns the candidates with what their amounts explain in a rollout, if that is more.

    The effects of `base` make up for it to first order.
    """
    basis = orthonormal(base.jacobian)
    tried = []
    for alike in _on_same_steps(found, lambda one: one.instance.effect):
        sets = [base.effects, *((*base.effects, one.instance) for one in alike)]
        residuals = problem.residuals(sets)
        left = np.sum((residuals - (residuals @ basis) @ basis.T) ** 2, axis=1)
        tried += [
            replace(one, gain=max(one.gain, float(1.0 - after / left[0])))
            for one, after in zip(alike, left[1:], strict=True)
        ]
    return tried


def _rows(problem: Problem, segments: Sequence[int]) -> Array:
    """Returns a mask of the numbers that belong to some segments, shape (N,)."""
    slices = problem.slices()
    mask = np.zeros(slices[-1].stop, dtype=bool)
    for i in segments:
        mask[slices[i]] = True
    return mask


def probes(
    problem: Problem, candidates: Sequence[Place], scales: Sequence[Scales]
) -> Iterator[tuple[Place, list[EffectInstance]]]:
    """Yields candidates with amounts that are tried together, to be weighed, see `weigh`."""
    for place in candidates:
        first = problem.joints.index(place.joints[0]) if place.joints else 0
        for group in place.effect.probes(scales[first]):
            yield (
                place,
                [
                    EffectInstance(effect=place.effect, joints=place.joints, values=values)
                    for values in group
                ],
            )


def weigh(
    place: Place, group: Sequence[EffectInstance], columns: Array, residual: Array
) -> Screened | None:
    """Returns a candidate with the weights of its probes that explain most, or None."""
    amplitudes = np.linalg.lstsq(columns, residual, rcond=1e-6)[0]
    explained = columns @ amplitudes
    gain = 1.0 - float(np.sum((residual - explained) ** 2) / np.sum(residual**2))
    values = place.effect.combine([i.values for i in group], [float(a) for a in amplitudes])
    if values is None and place.least:
        values, gain = _taken_off(place, group[0], float(amplitudes[0])), 0.0
    if values is None or not np.isfinite(gain):
        return None
    instance = EffectInstance(
        effect=place.effect, joints=place.joints, values=values, least=place.least
    )
    return Screened(instance=instance, gain=gain)


def _taken_off(place: Place, probe: EffectInstance, amplitude: float) -> dict[str, float] | None:
    """Returns what takes off as much as explains most, and no more than there is; None for more.

    How much that explains, first order does not tell: half a damping is twice the speed.
    """
    if not amplitude < 0.0:
        return None
    taken = {name: max(amplitude * probe.values[name], most) for name, most in place.least.items()}
    return {**probe.values, **taken}


def shortlist(screened: Sequence[Screened]) -> list[Screened]:
    """Returns the best candidates, not too many of them of one effect.

    Effects of the whole robot come in beside them: with several parameters that act together, they
    look worse to first order than a torque offset on the joint that they load most.
    """
    whole: list[Screened] = []
    for candidate in screened:
        starts = [c.instance.key for c in whole].count(candidate.instance.key)
        if is_whole(candidate.instance.effect) and candidate.gain > WHOLE_GAIN and starts < STARTS:
            whole.append(candidate)
    chosen: list[Screened] = []
    for candidate in screened:
        key = candidate.instance.key
        keys = [c.instance.key for c in chosen]
        places = {k for k in keys if k[0] == key[0]}
        new = len(set(keys)) < SHORTLIST and len(places) < SHORTLIST_PER_EFFECT
        room = keys.count(key) < STARTS if key in places else new
        taken = key in {c.instance.key for c in whole}
        if room and candidate.gain > 0.0 and not taken:
            chosen.append(candidate)
    return sorted([*whole, *chosen], key=lambda c: -c.gain)


def is_whole(effect: Effect) -> bool:
    """Returns whether an effect is of the whole robot, not of one joint or two."""
    return effect.scope in (Scope.ROBOT, Scope.LAST, Scope.OBJECT)
