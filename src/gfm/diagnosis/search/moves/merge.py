"""Exchange several effects for one that says as much.

What a step adds is best beside what was there, not with what comes later: a weaker drive with less
inertia moves a robot as a heavier tool does. Each of them is needed while the other stands for what
is missing, so no exchange of one for one leads there.

Shape letters: N numbers of a residual.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import combinations

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import at_bound
from gfm.diagnosis.inference.fitting import Fit, without
from gfm.diagnosis.residuals.outliers import slopes
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, P, parameters_of
from gfm.diagnosis.search.moves.add import takes_long
from gfm.diagnosis.search.moves.reduce import RIVALS, RIVALS_S, simplest
from gfm.diagnosis.search.naming import describe
from gfm.diagnosis.search.promises import FIT_GAINS
from gfm.diagnosis.search.screening import changes_of, goes_beside, rows_of, weigh
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance


def merge(here: Hypothesis[P], search: Search[P]) -> Hypothesis[P]:
    """Returns a hypothesis with one effect in the place of several where that predicts as well.

    As well: to within one standard error, as where effects are removed, with no more numbers. What
    a few segments judge stays.
    """
    while step := search.in_its_time(partial(_merged, here, search), None):
        several = ", ".join(map(describe, step.replaced))
        search.report(f"exchange: {describe(step.effects[-1])} in the place of {several}")
        search.steps.append(step)
        here = search.led_to(here, step)
    return here


def _merged(here: Hypothesis[P], search: Search[P]) -> Step | None:
    """Returns the first of the best proposals that holds; None where none does."""
    for several, instance in _proposed(here, search)[:RIVALS]:
        fitted = here.fitted((*(e for e in here.effects if e not in several), instance))
        fitted = simplest(here, fitted)
        tried = Tried(new=fitted.effects[-1:], fit=fitted, gain=-here.over(fitted))
        more = tried.parameters > parameters_of(several, here.fit)
        if not (more or (-tried.gain).notable or at_bound(tried.new[0])):
            return Step(
                move=Move.EXCHANGE,
                before=here.fit.cost,
                ranked=(tried,),
                chosen=tried,
                replaced=several,
            )
    return None


def _proposed(
    here: Hypothesis[P], search: Search[P]
) -> list[tuple[tuple[EffectInstance, ...], EffectInstance]]:
    """Returns several effects and one that may stand for them, what leaves least first.

    To first order, beside the others of the hypothesis, of what rollouts leave without them.
    """
    groups = list(_groups([e for e in here.effects if e.key not in search.held]))
    taken = {e.key for e in here.effects}
    places = [
        place
        for place in search.candidates
        if place.key not in taken and goes_beside(here, place) and not takes_long(place.effect)
    ]
    if not (groups and places):
        return []
    sample = here.problem.sample(RIVALS_S, left=here.fit.residual)
    part, base = here.problem.subset(sample), rows_of(here, sample)
    sets = [[e for e in base.effects if e not in several] for several in groups]
    still, *gone = part.coarse().residuals([base.effects, *sets])
    weights = slopes(base.residual, part.limits())
    probes = [(place, group) for place in places for group in place.probes]
    changes = [
        (place, group, weights[:, None] * columns)
        for place, group, columns in changes_of(part.coarse(), probes, base.effects)
    ]
    found = []
    for several, rest, left in zip(groups, sets, gone, strict=True):
        best = _best_for(_of(base, rest), base.residual + weights * (left - still), changes)
        found += [(best[0], several, best[1])] if best else []
    return [(several, one) for _, several, one in sorted(found, key=lambda each: each[0])]


def _best_for(
    rest: Fit, lost: Array, changes: Sequence[tuple[Place, list[EffectInstance], Array]]
) -> tuple[float, EffectInstance] | None:
    """Returns what is left, in squares, with what explains most in the place of several effects.

    And that effect; None where so little is explained that no fit makes up for the rest. `lost` is
    what is left without the several, shape (N,); `changes`, what each candidate's probes change.
    """
    basis = np.linalg.qr(rest.jacobian)[0]
    residual, least = without(lost, basis), float(rest.residual @ rest.residual)
    best: tuple[float, EffectInstance] | None = None
    for place, group, columns in changes:
        told = weigh(place, group, without(columns, basis), residual)
        if told is not None:
            left = float(np.sum((residual - told[1]) ** 2))
            best = (left, told[0]) if best is None or left < best[0] else best
    most = least + (float(residual @ residual) - least) / FIT_GAINS
    return best if best is not None and best[0] < most else None


def _of(base: Fit, rest: Sequence[EffectInstance]) -> Fit:
    """Returns some of the effects of a fit, with the residual of all of them."""
    stay = np.array([e in rest for e in base.effects], dtype=bool)[base.owners]
    return Fit(effects=tuple(rest), jacobian=base.jacobian[:, stay], residual=base.residual)


def _groups(effects: Sequence[EffectInstance]) -> Iterator[tuple[EffectInstance, ...]]:
    """Yields every two effects, and all of one kind where these are more."""
    yield from combinations(effects, 2)
    for name in dict.fromkeys(e.effect.name for e in effects):
        kind = tuple(e for e in effects if e.effect.name == name)
        if len(kind) > 2:
            yield kind
