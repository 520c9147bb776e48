"""What acts now and then only: a surface that the robot runs onto, a limit that it reaches.

It explains next to nothing of everything, where what is outlying hardly counts, and nearly all of
a few stretches. So those that stay far off after the search are looked at by themselves, with what
was found held as it is. A candidate is judged by the stretches that it changes: it has to explain
most of what is left there, also in those that it was not fitted to, and must not harm the rest.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.former.attribution import (
    MOST_TESTED,
    MUCH,
    OBVIOUS,
    InStretches,
    Round,
    fit_best,
    polished,
    without_superfluous,
)
from gfm.diagnosis.inference.fitting import (
    FITTING_S,
    LEAST_GAIN,
    ROUGH,
    Fit,
    at_bound,
    fit,
    nothing,
)
from gfm.diagnosis.residuals.outliers import OUTLYING
from gfm.diagnosis.residuals.problem import Problem, settled, with_state_basis
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.naming import describe
from gfm.diagnosis.search.screening import Screened, screen, suspected
from gfm.effects import EffectInstance, Scales

#: Stretches that must stay far off, and be explained: fewer are an accident.
LEAST_STRETCHES = 4
#: Recorded time of the stretches that are looked into at most.
FAR_S = 2.0 * FITTING_S
#: Share of a stretch's squared residual from which on a candidate changes it.
CHANGED = 0.05
#: Effects that are looked for in stretches.
MOST = 2


def look_into_stretches(
    problem: Problem,
    beside: Fit,
    *,
    everything: Problem,
    candidates: Sequence[Place],
    scales: Sequence[Scales],
    report: Callable[[str], None] = lambda _: None,
) -> InStretches:
    """Returns what was found with what explains the stretches that it leaves far off.

    That may be nothing; stretches may also be too few.

    Args:
        problem: In which the search takes place.
        beside: What it found so far.
        everything: All stretches of the same recordings.
        candidates: What may explain them, with what acts now and then only.
        scales: Of every joint's signals.
        report: Told what is happening, in words.
    """
    everything = replace(everything, after_command=problem.after_command)
    found = InStretches(problem=problem, fit=beside)
    while len(found.rounds) < MOST:
        effects = found.fit.effects
        far = far_off(everything, effects)
        if not far:
            break
        report(f"looking into {len(far)} stretches that stay far off")
        part = with_state_basis(everything.subset(far), effects)
        played = _round(part, found.fit, candidates, scales, report)
        if played is None or _harms(found.problem, effects, played[0].fits[0].effects):
            break
        found = _with_round(found, played[0], part.subset(played[1]))
    return found


def _with_round(found: InStretches, this: Round, own: Problem) -> InStretches:
    """Returns what was found with what a round found in its own stretches."""
    effects = this.fits[0].effects
    problem = settled(found.problem.joined(own), effects).robust(effects)
    return InStretches(
        problem=problem,
        fit=_without_stand_ins(problem, fit(problem, effects)),
        rounds=(*found.rounds, this),
        stretches=(*found.stretches, own),
    )


def far_off(everything: Problem, effects: Sequence[EffectInstance]) -> list[int]:
    """Returns the stretches that `effects` leave far off, by their numbers; none if they are few.

    Far beyond the noise, and beyond what is left of a typical stretch.
    """
    costs = _by_stretch(everything, effects)
    least = max(MUCH, OUTLYING**2 * float(np.median(costs)))
    far = [i for i, cost in enumerate(costs) if cost > least]
    if len(far) < LEAST_STRETCHES:
        return []
    return [far[i] for i in everything.subset(far).sample(FAR_S)]


def _by_stretch(problem: Problem, effects: Sequence[EffectInstance]) -> Array:
    """Returns the mean squared residual of each stretch, however far it is off, shape (S,)."""
    residual = replace(problem, outlying_from=None).residuals([effects])[0]
    return np.array([np.mean(residual[rows] ** 2) for rows in problem.slices()])


def _round(
    part: Problem,
    before: Fit,
    candidates: Sequence[Place],
    scales: Sequence[Scales],
    report: Callable[[str], None],
) -> tuple[Round, list[int]] | None:
    """Returns a round about stretches and those that it explains, by their numbers.

    None where nothing explains most of what is left of some.
    """
    held = replace(part, given=(*part.given, *before.effects))
    held = settled(held, ()).robust(())
    start = nothing(held)
    places = suspected(held, candidates, replace(start, effects=before.effects))
    screened = screen(held, places, scales, start)
    fits = polished(held, fit_best(held, screened, start, report))
    for tested in fits[:MOST_TESTED]:
        own = changed(held, tested.effects)
        report(f"testing {describe(tested.effects[-1])} on {len(own)} stretches")
        if len(own) < LEAST_STRETCHES or at_bound(tested.effects[-1]):
            continue
        mine = held.subset(own)
        if explains_most(mine, tested.effects) and _explains_others(mine, tested.effects):
            order = [tested, *(f for f in fits if f is not tested)]
            return _told(mine, before, order, screened), own
    return None


def _told(
    problem: Problem, before: Fit, fits: Sequence[Fit], screened: Sequence[Screened]
) -> Round:
    """Returns a round with what the fits, the accepted one first, leave of its own stretches."""
    residuals = problem.residuals([(), *(f.effects for f in fits)])
    start, *costs = (float(cost) for cost in np.mean(residuals**2, axis=1))
    best, *others = (
        replace(f, effects=(*before.effects, *f.effects), residual=r, cost=cost)
        for f, r, cost in zip(fits, residuals[1:], costs, strict=True)
    )
    others.sort(key=lambda f: f.cost)
    return Round(
        before=start,
        screened=tuple(screened),
        fits=(best, *others),
        accepted=best,
        stretches=len(problem.segments),
    )


def changed(problem: Problem, effects: Sequence[EffectInstance]) -> list[int]:
    """Returns the stretches that effects change, by their numbers."""
    before, after = problem.residuals([(), effects])
    return [
        i
        for i, rows in enumerate(problem.slices())
        if np.sum((after[rows] - before[rows]) ** 2) > CHANGED * np.sum(before[rows] ** 2)
    ]


def explains_most(problem: Problem, effects: Sequence[EffectInstance]) -> bool:
    """Returns whether effects explain most of what is left of all stretches together."""
    before, after = np.mean(problem.residuals([(), effects]) ** 2, axis=1)
    return bool(after < (1.0 - OBVIOUS) * before)


def _explains_others(problem: Problem, effects: Sequence[EffectInstance]) -> bool:
    """Returns whether effects, fitted to every second stretch, explain most of the others."""
    count = len(problem.segments)
    halves = [list(range(first, count, 2)) for first in (0, 1)]
    return all(
        explains_most(
            problem.subset(others), fit(problem.subset(own), effects, tolerance=ROUGH).effects
        )
        for own, others in (halves, halves[::-1])
    )


def _without_stand_ins(problem: Problem, fitted: Fit) -> Fit:
    """Returns the fit without what only stood for its newest effect so far."""
    *before, newest = fitted.effects
    if not before:
        return fitted
    held = replace(problem, given=(*problem.given, newest))
    rest = without_superfluous(held, fit(held, before)).effects
    return fitted if len(rest) == len(before) else fit(problem, (*rest, newest))


def _harms(
    problem: Problem, before: Sequence[EffectInstance], after: Sequence[EffectInstance]
) -> bool:
    """Returns whether stretches that were explained are missed with what explains the others."""
    costs = np.mean(problem.robust(before).residuals([before, after]) ** 2, axis=1)
    return bool(costs[1] > (1.0 + LEAST_GAIN) * costs[0])
