"""Add an effect, on one joint or on all that lack it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from gfm.diagnosis.inference.amounts import at_bound
from gfm.diagnosis.inference.fitting import ROUGH, Fit, fit
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.naming import describe, first_of_each, grouped
from gfm.diagnosis.search.promises import jumps, promise, promising
from gfm.diagnosis.search.read_off import column, most_together, whitened
from gfm.diagnosis.search.screening import Screened, is_whole, open_to
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import Effect, EffectInstance, Scope, find_effect

#: Candidates that are fitted, places of one effect among those, amounts from which the fit of one
#: begins, and kinds that are tried on several joints.
FITTED, PLACES, STARTS, KINDS = 4, 2, 2, 2
#: Times an amount from which the fit of what holds a joint begins.
GRID = tuple(2.0 ** (n / 2) for n in range(-3, 4))
#: Fits in front that are compared from initial states of their own.
FRONT = 2


def add(before: Hypothesis[P], search: Search[P], best: Step | None = None) -> Step | None:
    """Returns the step that adds what predicts best, or none where nothing does clearly.

    Of what is simulated quickly: see `add_costly`. None where the best step so far leaves nothing.
    """
    if best is not None and best.chosen and not after(before, best.chosen).is_open:
        return None
    quick = [place for place in search.candidates if not takes_long(place.effect)]
    return _add(before, search, quick)


def add_costly(before: Hypothesis[P], search: Search[P], best: Step) -> Step | None:
    """Returns the same of what takes longer to simulate, beside the best step so far.

    None where that step leaves nothing that is worth the time, or is about a few segments only.
    """
    return _beside(before, search, best, [p for p in search.candidates if p.effect.costly])


def add_motors(before: Hypothesis[P], search: Search[P], best: Step) -> Step | None:
    """Returns the same of motors apart from their links, which take longest."""
    motors = [place for place in search.candidates if place.effect.separates_motor]
    return _beside(before, search, best, motors)


def _beside(
    before: Hypothesis[P], search: Search[P], best: Step, slow: Sequence[Place]
) -> Step | None:
    if best.part is not None or not (worth_more(before, best.chosen) and search.goes_on()):
        return None
    ranked = best.ranked if best.move is Move.ADD else ()
    return _add(before, search, slow, ranked, best.gain)


def takes_long(effect: Effect) -> bool:
    """Returns whether an effect takes long to simulate."""
    return effect.costly or effect.separates_motor


def _add(
    before: Hypothesis[P],
    search: Search[P],
    candidates: Sequence[Place],
    ranked: Sequence[Tried] = (),
    gained: float = 0.0,
) -> Step:
    left = after(before, best_of(before, ranked))
    tier = open_to(before, candidates, left.open_joints)
    search.report(f"screening {len(tier)} candidates (misfit {before.fit.cost:.3g})")
    screened = promising(before, tier)
    tried: list[Tried] = []
    for one, again in _shortlist(screened):
        if _is_worth_a_fit(before, one, tried, gained, again=again) and search.goes_on():
            tried += _in_time(before, (one.instance,), search)
    several = _together(before, screened, tried)
    for new in (*several, *_above_their_level(before, search, screened, [*ranked, *tried])):
        if search.goes_on():
            tried += _in_time(before, new, search)
    return best_first(before, [*ranked, *_with_front_fitted_out(before, tried)])


def best_first(before: Hypothesis, tried: Sequence[Tried]) -> Step:
    """Returns the step that adds the best of what was tried."""
    return Step(
        move=Move.ADD,
        before=before.fit.cost,
        ranked=tuple(sorted(tried, key=lambda one: -one.gain.nats)),
        chosen=best_of(before, tried),
    )


def _is_worth_a_fit(
    before: Hypothesis, one: Screened, tried: Sequence[Tried], gained: float, *, again: bool
) -> bool:
    """Returns whether a fit may gain anything clear; of a motor, which takes long, most so far.

    `gained` is by how many nats the best step so far predicts better; `again`, another start.
    """
    promised = promise((one,))
    if not promised.clear or not one.instance.effect.separates_motor:
        return promised.clear
    best = best_of(before, tried)
    most = max(gained, 0.0 if best is None else best.gain.nats)
    return promised.nats > most and not (again and not worth_more(before, best))


def beside(before: Hypothesis, fitted: Fit) -> Tried:
    """Returns a fit of more effects than there were before, as it was weighed."""
    new = fitted.effects[len(before.effects) :]
    return Tried(new=new, fit=fitted, gain=-before.over(fitted))


def _with_front_fitted_out(before: Hypothesis, tried: Sequence[Tried]) -> list[Tried]:
    """Returns what was tried, best first, those in front from initial states of their own.

    No two of them are the same effects in the same place.
    """
    ranked = sorted(tried, key=lambda one: -one.gain.nats)
    first = first_of_each(ranked, lambda one: tuple(e.key for e in one.new))[:FRONT]
    first = [one for one in first if not _separates_motor(one.new)]  # they have them already
    rest = [one for one in ranked if all(one is not other for other in first)]
    own = [beside(before, before.fitted_out(one.fit)) for one in first]
    return sorted([*own, *rest], key=lambda one: -one.gain.nats)


def best_of(before: Hypothesis, tried: Sequence[Tried]) -> Tried | None:
    """Returns what predicts best, or as well with fewer parameters; None where nothing is clear."""
    clear = [one for one in tried if one.gain.clear and not any(map(at_bound, one.new))]
    if not clear:
        return None
    best = max(clear, key=lambda one: one.gain.nats)
    there, count = after(before, best), best.parameters
    fewer = [one for one in clear if one.parameters < count]
    simpler = [one for one in fewer if not there.over(one.fit).clear]
    return min(simpler, key=lambda one: (one.parameters, -one.gain.nats), default=best)


def worth_more(before: Hypothesis, best: Tried | None) -> bool:
    """Returns whether what is left is worth a look at what takes longer.

    More can be gained than the best so far gains, and more than laws are inexact.
    """
    if best is None:
        return True
    there = after(before, best)
    return there.is_open and there.room.nats > best.gain.nats


def after(before: Hypothesis, best: Tried | None) -> Hypothesis:
    """Returns the hypothesis with what is best; as it was where nothing is."""
    return before if best is None else replace(before, fit=best.fit)


def _shortlist(screened: Sequence[Screened]) -> list[tuple[Screened, bool]]:
    """Returns the best candidates, not too many of one effect, and the best of the whole robot.

    Each with whether it is another start of one before it: those come last.
    """
    whole = [one for one in screened if is_whole(one.instance.effect)][:1]
    taken: list[Screened] = list(whole)
    for one in screened:
        key = one.instance.key
        keys = {other.instance.key for other in taken}
        places = {k for k in keys if k[0] == key[0]}
        starts = sum(other.instance.key == key for other in taken)
        new = key not in keys and len(keys) < FITTED and len(places) < PLACES
        if one not in whole and (new or 0 < starts < STARTS):
            taken.append(one)
    taken.sort(key=lambda one: -one.gain.nats)
    first = first_of_each(taken, lambda one: one.instance.key)
    again = [one for one in taken if all(one is not other for other in first)]
    return [*((one, False) for one in first), *((one, True) for one in again)]


def _together(
    before: Hypothesis, screened: Sequence[Screened], tried: Sequence[Tried]
) -> list[tuple[EffectInstance, ...]]:
    """Returns what may be missing on several joints at once, if that may gain most.

    What no single joint's effect explains, all joints may lack, also beside one of the whole robot:
    late commands and friction everywhere look like lags. And lags everywhere look like late
    commands: where an effect of the whole robot is in front, kinds are tried in its place.
    """
    best = best_of(before, tried)
    kinds = _kinds(screened)
    if worth_more(before, best):
        whole = [one.new for one in tried if is_whole(one.new[0].effect)][:1]
        return kinds + [(*one, *kind) for one in whole for kind in kinds]
    return kinds if best is not None and is_whole(best.new[0].effect) else []


def _above_their_level(
    before: Hypothesis[P], search: Search[P], screened: Sequence[Screened], tried: Sequence[Tried]
) -> list[tuple[EffectInstance, ...]]:
    """Returns what is in front, if it comes above the level of another effect, together with that.

    Alone it stands for both: a peak of friction at low speed, as wide as all speeds, is dry
    friction. From there no step leads back to both. The missing torque tells both.
    """
    best = best_of(before, tried)
    if best is None or not worth_more(before, best):
        return []
    excess = best.new[0]
    base = excess.effect.excess_of
    if base is None or any(one.key == (base, excess.joints) for one in before.effects):
        return []
    effect, peak = find_effect(base), excess.effect.parameters[0].name
    values = {effect.parameters[0].name: excess.values[peak]}  # alone it has about that amount
    level = EffectInstance(effect=effect, joints=excess.joints, values=values)
    starts = [one.instance for one in screened if one.instance.key == excess.key][:STARTS]
    return [_as_torque_tells(before, search, (level, start)) for start in starts]


def _as_torque_tells(
    before: Hypothesis[P], search: Search[P], new: tuple[EffectInstance, ...]
) -> tuple[EffectInstance, ...]:
    """Returns effects in the amounts that explain most of the missing torque, if all of them do."""
    domain = search.witness or search.torques
    if domain is None:
        return new
    columns = [column(domain, one) for one in (*before.effects, *new)]
    told = most_together(new, columns, whitened(domain, domain.missing(before.effects)))
    return tuple(told) if len(told) == len(new) else new


def _kinds(screened: Sequence[Screened]) -> list[tuple[EffectInstance, ...]]:
    """Returns the kinds of effects that promise most on several joints, each on all of those."""
    of_joints = [
        one
        for one in first_of_each(screened, lambda one: one.instance.key)
        if one.instance.effect.scope is Scope.JOINT and one.gain.nats > 0.0
    ]
    kinds = grouped(of_joints, lambda one: one.instance.effect.name)
    several = [kind for kind in kinds if len(kind) > 1 and promise(kind).clear]
    several = [kind for kind in several if not kind[0].instance.effect.separates_motor]
    several.sort(key=lambda kind: -sum(one.gain.nats for one in kind))
    return [tuple(one.instance for one in kind) for kind in several[:KINDS]]


def _in_time(
    before: Hypothesis[P], new: tuple[EffectInstance, ...], search: Search[P]
) -> list[Tried]:
    """Returns new effects fitted beside those that are there; nothing if that takes too long."""
    return search.in_its_time(lambda: [_tried(before, new, search)], [], step=True)


def _tried(before: Hypothesis[P], new: tuple[EffectInstance, ...], search: Search[P]) -> Tried:
    """Returns new effects fitted beside those that are there."""
    more = f" and {len(new) - 1} more" if len(new) > 1 else ""
    search.report(f"fitting {describe(new[0])}{more}")
    best = best_begun(before, new)
    if _separates_motor(new):
        best = before.fitted_out(best)  # a motor that rings has states that nothing else knows of
    return beside(before, best)


def best_begun(before: Hypothesis, new: Sequence[EffectInstance]) -> Fit:
    """Returns new effects fitted beside those that are there, as well as it gets from any start."""
    fits = [before.fitted(effects) for effects in _beginnings(before, new)]
    return min(fits, key=lambda f: f.cost)


def _separates_motor(effects: Sequence[EffectInstance]) -> bool:
    return any(one.effect.separates_motor for one in effects)


def _beginnings(
    before: Hypothesis, new: Sequence[EffectInstance]
) -> list[tuple[EffectInstance, ...]]:
    """Returns the effects with the amounts from which a fit begins.

    What jumps is also fitted from positions alone. Where friction holds a joint, small steps tell
    nothing of how much it is: it also begins at the best of a coarse grid of rollouts.
    """
    effects = told = (*before.effects, *new)
    for one in new:
        if one.effect.rugged:
            told = _best_of_grid(before, told, effects.index(one))
    begun = [effects] if told is effects else [effects, told]
    if any(jumps(before, one) for one in new):
        begun.append(fit(before.problem.positions_alone(), effects, tolerance=ROUGH).effects)
    return begun


def _best_of_grid(
    before: Hypothesis, effects: tuple[EffectInstance, ...], number: int
) -> tuple[EffectInstance, ...]:
    """Returns effects with those amounts of one, around its own, that leave least in rollouts."""
    one, sets = effects[number], []
    for factors in product(GRID, repeat=len(one.values)):
        rows = zip(one.values.items(), factors, strict=True)
        values = {name: factor * value for (name, value), factor in rows}
        if one.effect.admissible(values):
            sets.append((*effects[:number], replace(one, values=values), *effects[number + 1 :]))
    left = before.problem.coarse().residuals(sets)
    return sets[int(np.argmin(np.sum(left**2, axis=1)))]
