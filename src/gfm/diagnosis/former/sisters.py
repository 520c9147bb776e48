"""One kind of effect on several joints: what one lacks, its sisters often lack, too.

Looked for on the other joints where it was found on one; on all of them at once where an effect of
the whole robot was found, which explains more than it does on any one; and at the end in the place
of such an effect.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gfm.diagnosis.former.adequate import FAR_LESS, is_enough
from gfm.diagnosis.inference.fitting import (
    FITTING_S,
    LEAST_GAIN,
    ROUGH,
    Fit,
    amounts,
    at_bound,
    fit,
    free_parameters,
    orthonormal,
)
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.naming import describe, first_of_each
from gfm.diagnosis.search.screening import Screened, is_whole
from gfm.effects import EffectInstance, Scope

#: Share of the best gain on its joint from which an effect found on another joint is
#: looked for on this one, too.
LIKELY = 0.3
#: Mean squared residual of a joint, in units of the noise, from which on that is done, and the
#: share of it that must be explained there.
ALSO_FROM, ALSO_GAIN = 2.0, 0.2
#: Kinds of effects that are tried on every joint at once, and the sum of their gains from which on
#: that is done, as a share of what an effect of the whole robot explains.
MOST_KINDS, AS_MUCH = 2, 0.8


def on_other_joints(
    problem: Problem,
    screened: Sequence[Screened],
    accepted: Fit,
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Returns the fit with its newest effect also on the other joints on which it explains enough.

    Enough is a share of what is left on the joint itself: its misfit may be small beside others'.
    """
    newest = accepted.effects[-1]
    left = problem.joint_costs(accepted.residual)
    likely = [
        c.instance
        for c in screened
        if c.instance.effect.scope is Scope.JOINT
        and c.instance.effect.name == newest.effect.name
        and c.instance.key not in {e.key for e in accepted.effects}
        and left[problem.joints.index(c.instance.joints[0])] > ALSO_FROM
        and c.gain > LIKELY * _best_gain_on(c.instance.joints[0], screened)
    ]
    sisters = first_of_each(likely, lambda e: e.key)
    while sisters:
        report(f"fitting {newest.effect.name.replace('_', ' ')} on {len(sisters)} more joints")
        part = problem.subset(problem.sample(FITTING_S))
        both = fit(part, (*accepted.effects, *sisters), tolerance=ROUGH)
        found = both.effects[len(accepted.effects) :]
        earned = [e for e in found if not at_bound(e) and _earns(part, both, e)]
        if len(earned) == len(sisters):
            return fit(problem, both.effects)
        sisters = earned
    return accepted


def _best_gain_on(joint: str, screened: Sequence[Screened]) -> float:
    return max(c.gain for c in screened if c.instance.joints == (joint,))


def _earns(problem: Problem, fitted: Fit, instance: EffectInstance) -> bool:
    """Returns whether an effect explains enough, to first order, of what is left on its joint."""
    index = fitted.effects.index(instance)
    own = np.array([i == index for i, _ in free_parameters(fitted.effects)])
    others = orthonormal(fitted.jacobian[:, ~own])
    change = fitted.jacobian[:, own] @ amounts([instance])
    change -= others @ (others.T @ change)
    joint = problem.joints.index(instance.joints[0])
    gained = problem.joint_costs(change)[joint]
    left = problem.joint_costs(fitted.residual)[joint]
    return bool(gained > ALSO_GAIN * (gained + left))


def on_every_joint(
    problem: Problem,
    screened: Sequence[Screened],
    accepted: Fit,
    before: Fit,
    nominal: float,
    report: Callable[[str], None] = lambda _: None,
) -> Fit | None:
    """Returns a fit of one kind of effect on each joint, instead of one of the whole robot.

    Or beside it, where that leaves far less. On one joint it never explains as much. None where a
    round found nothing of the whole robot, where what it found leaves nothing on most joints, or
    where no kind promises as much.
    """
    if not is_whole(accepted.effects[-1].effect):
        return None
    if np.median(problem.joint_costs(accepted.residual)) <= ALSO_FROM:
        return None
    explained = 1.0 - accepted.cost / before.cost
    kinds = [
        [c.instance for c in kind]
        for kind in _kinds(screened)[:MOST_KINDS]
        if sum(c.gain for c in kind) > AS_MUCH * explained
    ]
    best: Fit | None = None
    for base in (before, accepted):
        fits = [_fit_kind(problem, base, kind, report) for kind in kinds]
        least = min(fits, key=lambda f: f.cost, default=None)
        if least is not None and (best is None or least.cost < FAR_LESS * best.cost):
            best = least
        if best is None or is_enough(problem, best, nominal):
            break
    return best


def _fit_kind(
    problem: Problem, base: Fit, kind: Sequence[EffectInstance], report: Callable[[str], None]
) -> Fit:
    report(f"fitting {kind[0].effect.name.replace('_', ' ')} on {len(kind)} joints")
    return fit(problem, (*base.effects, *kind), tolerance=ROUGH)


def _kinds(screened: Sequence[Screened]) -> list[list[Screened]]:
    """Returns the candidates of one joint by kind, each once, the kind of most gain first.

    Without what takes long to simulate, and several times as long on several joints.
    """
    kinds: dict[str, list[Screened]] = {}
    for c in first_of_each(screened, lambda c: c.instance.key):
        effect = c.instance.effect
        if effect.scope is Scope.JOINT and not (effect.costly or effect.separates_motor):
            kinds.setdefault(effect.name, []).append(c)
    several = [kind for kind in kinds.values() if len(kind) > 1]
    return sorted(several, key=lambda kind: -sum(c.gain for c in kind))


def sisters_instead(
    problem: Problem,
    accepted: Fit,
    candidates: Sequence[Place],
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Returns the fit with effects on all joints instead of one of the whole robot, if that is it.

    Where every servo is too weak, a payload that was found first makes up for most of them, and
    leaves too little on the others. So what was found on several joints is put on the rest of them
    in its place, with as many parameters at most. It has to leave less.
    """
    for whole in [e for e in accepted.effects if is_whole(e.effect)]:
        others = [e for e in accepted.effects if e is not whole]
        for sisters in _sisters(others, candidates):
            if len(sisters) > len(whole.effect.parameters):
                continue
            report(f"fitting {describe(sisters[0])} and its like instead of {describe(whole)}")
            instead = fit(problem, (*others, *sisters))
            if instead.cost < (1.0 - LEAST_GAIN) * accepted.cost:
                return instead
    return accepted


def _sisters(
    effects: Sequence[EffectInstance], candidates: Sequence[Place]
) -> list[list[EffectInstance]]:
    """Returns what has one parameter and is there on several joints, on each of the others.

    As much of it as on those. Without motors apart from their links, which take long to simulate.
    """
    kinds: dict[str, list[EffectInstance]] = {}
    for e in effects:
        apart = e.effect.separates_motor
        if e.effect.scope is Scope.JOINT and len(e.effect.parameters) == 1 and not apart:
            kinds.setdefault(e.effect.name, []).append(e)
    sisters = []
    for alike in (kind for kind in kinds.values() if len(kind) > 1):
        there = {e.key for e in alike}
        (amount,) = (parameter.name for parameter in alike[0].effect.parameters)
        typical = float(np.median([e.values[amount] for e in alike]))
        sisters.append(
            [
                EffectInstance(
                    effect=place.effect,
                    joints=place.joints,
                    values={amount: typical},
                    least=place.least,
                )
                for place in candidates
                if place.effect.name == alike[0].effect.name and place.key not in there
            ]
        )
    return [one for one in sisters if one]
