"""Add the effects that the missing torque shows.

A rollout that is far off goes where the robot never was, and near the truth it says little of what
two effects do together. Along the measured motion what is missing is nearly the sum of what effects
add to it, whatever their amounts are: they are taken one by one, each beside those before it
(orthogonal matching pursuit; Pati et al. 1993). That only proposes. How many there are is told by
rollouts, and the fit and the score are of rollouts, as always.

Shape letters: N block means of all joints.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations

import numpy as np

from gfm.diagnosis.inference.amounts import at_bound
from gfm.diagnosis.inference.fitting import Fit, without
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.moves.add import beside, best_begun
from gfm.diagnosis.search.naming import describe, first_of_each, grouped
from gfm.diagnosis.search.read_off import Shown, column, most_together, read_off, whitened
from gfm.diagnosis.search.screening import is_whole, open_to
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance
from gfm.signals.torque_domain import TorqueDomain

#: Share of what is left of the missing torque of its joints from which on an effect is taken, and
#: up to which others may explain less and rival it; so many of these; effects at most.
SHOWN, NEAR, MOST = 0.1, 4, 6


def missing_torque(
    before: Hypothesis[P], search: Search[P], _best: Step | None = None
) -> Step | None:
    """Returns the step that adds the effects that the missing torque shows; None for none.

    Of a robot that touches something, that of its motion in the air proposes, too: what pushes back
    is none that the model lacks.
    """
    domains = [one for one in (search.torques, search.witness) if one is not None]
    if not (domains and search.goes_on()):
        return None
    search.report(f"looking at the missing torque (misfit {before.fit.cost:.3g})")
    if not (new := borne_out(before, [shown(d, before, search.candidates) for d in domains])):
        return None
    search.report(f"fitting {describe(new[0])}" + f" and {len(new) - 1} more" * (len(new) > 1))
    fitted = search.in_its_time(partial(best_begun, before, new), None, step=True)
    if fitted is None:
        return None
    tried = beside(before, fitted)
    return Step(
        move=Move.MISSING_TORQUE,
        before=before.fit.cost,
        ranked=(tried,),
        chosen=tried if tried.gain.clear and not all(map(at_bound, tried.new)) else None,
    )


def fewest(before: Hypothesis, step: Step) -> Step:
    """Returns the step with the fewest of its effects that predict as well.

    That takes a fit for each that goes, so it is asked of what is chosen only.
    """
    tried = step.chosen
    while tried and (fewer := _fewer(before, tried)):
        tried = fewer
    return replace(step, chosen=tried)


def _fewer(before: Hypothesis, tried: Tried) -> Tried | None:
    """Returns what predicts as well without one or two of the new effects; None where none does.

    Two at once: what each of them does, the other may take back.
    """
    here, count = replace(before, fit=tried.fit), len(before.effects)
    own = range(count, len(here.effects))
    some = [gone for size in (2, 1) if size < len(own) for gone in combinations(own, size)]
    losses = zip(here.over_less(some), some, strict=True)
    for loss, gone in sorted(losses, key=lambda pair: pair[0].errors):
        if loss.clear:
            break
        rest = [e for i, e in enumerate(here.effects) if i not in gone]
        fitted = before.fitted(rest)
        if not here.over(fitted).clear:
            return beside(before, fitted)
    return None


def shown(
    domain: TorqueDomain, before: Hypothesis[P], candidates: Sequence[Place]
) -> Sequence[EffectInstance]:
    """Returns the effects that are not there yet with which rollouts predict best; maybe none.

    Smoothing and sampling move torques against commands by a millisecond or two: what being late
    would explain is taken out. But lags look like a delay, and so does dry friction behind a soft
    servo. So what is late is one effect among others where rollouts say that it explains more than
    all that is seen beside it.
    """
    places = [
        place
        for place in open_to(before, candidates, before.open_joints)
        if not place.effect.separates_motor
    ]
    prompt = [place for place in places if place.effect.shift is None]
    late = [one for p in candidates if p.effect.shift is not None for (one,) in p.probes]
    best = borne_out(before, shown_together(domain, before, prompt, late))
    if late:
        sets = shown_together(domain, before, places)
        first = next(sets, ())
        here, there = _rolled(before, [first, best])
        if replace(before, fit=here).over(there).nats > 0.0:
            best = borne_out(before, [best, first, *sets])
    return best


def borne_out(
    before: Hypothesis, shown: Iterable[Sequence[EffectInstance]]
) -> Sequence[EffectInstance]:
    """Returns the first of some sets that predicts as well as any, in rollouts with its amounts."""
    sets: list[Sequence[EffectInstance]] = [(), *shown]
    return sets[_best_in_rollouts(before, sets)]


def shown_together(
    domain: TorqueDomain,
    before: Hypothesis[P],
    places: Sequence[Place],
    nuisance: Sequence[EffectInstance] = (),
) -> Iterator[list[EffectInstance]]:
    """Yields effects of some places: the first, the first two and so on.

    Each of these sets in the amounts that explain most together. Of several that explain nearly as
    much, the one with which rollouts predict best. What a nuisance would explain is taken out.
    """
    known = [*before.effects, *nuisance]
    missing = whitened(domain, domain.missing(before.effects))
    columns = [np.zeros_like(missing), *(column(domain, one) for one in known)]
    found = list[EffectInstance]()
    while len(found) < MOST:
        basis = orthonormal(np.stack(columns, axis=1))
        left, taken = without(missing, basis), {one.key for one in found}
        rest = [place for place in places if place.key not in taken]
        rivals = _rivals([one for place in rest for one in read_off(domain, place, left, basis)])
        if not rivals:
            return
        bases = [[*columns, *(column(domain, one) for one in new)] for new in rivals]
        told = [
            most_together([*found, *new], own, missing)
            for new, own in zip(rivals, bases, strict=True)
        ]
        best = _best_in_rollouts(before, told) if len(told) > 1 else 0
        found += rivals[best]
        columns = bases[best]
        yield told[best]


def _rivals(shown: Sequence[Shown]) -> list[list[EffectInstance]]:
    """Returns what explains most, and what explains nearly as much; nothing where none is.

    Lags everywhere look like late commands: effects of one kind on several joints rival one of the
    whole robot, together.
    """
    clear = sorted((one for one in shown if one.share >= SHOWN), key=lambda one: -one.explained)
    first = first_of_each(clear, lambda one: one.instance.key)
    rivals = [[one] for one in first]
    if first and is_whole(first[0].instance.effect):
        kinds = grouped(first, lambda one: one.instance.effect.name)
        rivals += [kind for kind in kinds if len(kind) > 1]
    near = [one for one in rivals if _explained(one) >= (1.0 - SHOWN) * first[0].explained]
    near.sort(key=lambda one: -_explained(one))
    return [[one.instance for one in some] for some in near[:NEAR]]


def _explained(some: Sequence[Shown]) -> float:
    return sum(one.explained for one in some)


def _best_in_rollouts(before: Hypothesis, sets: Sequence[Sequence[EffectInstance]]) -> int:
    """Returns the number of the set that predicts best with its amounts.

    Or of one with fewer numbers that does not clearly predict worse.
    """
    fits = _rolled(before, sets)
    there = replace(before, fit=max(fits, key=lambda fitted: -before.over(fitted).nats))
    good = [i for i, fitted in enumerate(fits) if not there.over(fitted).clear]
    numbers = [sum(len(one.effect.parameters) for one in new) for new in sets]
    return min(good, key=lambda i: (numbers[i], before.over(fits[i]).nats))


def _rolled(before: Hypothesis, sets: Sequence[Sequence[EffectInstance]]) -> list[Fit]:
    """Returns what sets of effects leave in rollouts with their amounts."""
    residuals = before.problem.residuals([(*before.effects, *new) for new in sets])
    return [replace(before.fit, residual=r) for r in residuals]
