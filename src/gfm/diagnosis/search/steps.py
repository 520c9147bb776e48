"""The loop of every search: from one hypothesis to the next that predicts clearly better.

Moves propose steps; the best is taken, what became superfluous by it is removed, until what can
still be gained is not visible, nothing gains anything, or the time is over. In the end effects are
exchanged for what says more, and it is weighed what speaks for each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gfm.diagnosis.inference.constants import UNWEIGHED
from gfm.diagnosis.inference.fitting import acting, along_valley, always, measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.inference.steadiness import apart, follows
from gfm.diagnosis.residuals.outliers import slopes
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.moves.reduce import (
    Compared,
    RivalsOf,
    exchange,
    gains_of_each,
    remove,
    rivals_of,
)
from gfm.diagnosis.search.naming import describe
from gfm.diagnosis.search.trace import Evidence, Move, SearchResult, Step
from gfm.diagnosis.search.under_way import MoveFrom, Search
from gfm.effects import EffectInstance, Key, Scope

#: Steps at most.
MOST_STEPS = 24


def run(here: Hypothesis[P], search: Search[P], moves: Sequence[MoveFrom[P]]) -> Hypothesis[P]:
    """Returns the best hypothesis that steps lead to, in time."""
    following = partial(next, _steps(here, search, moves), None)
    while (after := search.in_its_time(following, None)) is not None:
        here = after
    return here


def _steps(
    here: Hypothesis[P], search: Search[P], moves: Sequence[MoveFrom[P]]
) -> Iterator[Hypothesis[P]]:
    """Yields one hypothesis after another."""
    while here.is_open and len(search.steps) < MOST_STEPS and search.goes_on():
        best = _best(here, search, moves)
        if best.chosen is None:
            search.steps += [best] if best.ranked else []
            break
        left, here = here.fit.cost, search.after(here, best)
        search.steps.append(best)
        new = ", ".join(map(describe, best.chosen.new))
        search.report(f"{best.move}: {new}: misfit {left:.3g} -> {here.fit.cost:.3g}")
        here = remove(here, search)
        yield here
    search.ended_early |= here.is_open and not search.goes_on()


def _best(here: Hypothesis[P], search: Search[P], moves: Sequence[MoveFrom[P]]) -> Step:
    """Returns the best step that moves propose; one that chooses nothing where none does."""
    best = Step(move=Move.ADD, before=here.fit.cost)
    for move in moves:
        other = move(here, search, best)
        # What predicts as well, and is of the same move, has weighed more.
        if other and (other.gain, other.move is best.move) > (best.gain, False):
            best = other
    return best


def end(here: Hypothesis[P], search: Search[P], rivals: RivalsOf[P] = rivals_of) -> SearchResult[P]:
    """Returns a hypothesis after exchanges and removals, with what speaks for each effect."""
    here, compared = _reduced(here, search, rivals)
    some = acting(here.effects)
    if len(some) < len(here.effects):
        final = measured(here.problem, some)
    else:
        final = search.in_its_time(partial(along_valley, here.problem, here.fit), here.fit)
    here = replace(here, fit=final)
    return SearchResult(
        problem=here.problem,
        fit=here.fit,
        room=here.room,
        steps=tuple(search.steps),
        evidence=support(here, search, compared),
        equals={one.instance.key: one.equals for one in compared},
        out_of_time=search.out_of_time,
    )


def _reduced(
    here: Hypothesis[P], search: Search[P], rivals: RivalsOf[P]
) -> tuple[Hypothesis[P], list[Compared]]:
    while True:
        after, compared = exchange(here, search, rivals)
        last, here = after is here, remove(after, search)
        if last or not search.in_time():
            return here, compared


def support(
    here: Hypothesis[P], search: Search[P], compared: Sequence[Compared]
) -> dict[Key, Evidence]:
    """Returns what speaks for each effect of a hypothesis, also beside its best rival.

    For those that a few segments judge, what spoke for them there: all others know nothing of it.
    """
    rivals = {one.instance.key: one for one in compared}
    steady = _steadiness(here)
    told = {}
    for without, instance in gains_of_each(here):
        beside = rivals.get(instance.key, Compared(instance=instance))
        rival = -beside.rival.gain if beside.rival else None
        unweighed = Difference(UNWEIGHED * without.nats, without.error)
        parts, follows_it = steady[instance.key]
        told[instance.key] = Evidence(
            without=search.held.get(instance.key, without),
            rival=rival if beside.weighed else unweighed,
            by=beside.rival.new[0] if beside.rival else None,
            apart=parts,
            follows=follows_it,
        )
    return told


def _steadiness(here: Hypothesis) -> dict[Key, tuple[float, float]]:
    """Returns for each effect by what share of itself it differs between parts of the data.

    And how closely what is left on its joints follows what it does. Laws of one state of one joint
    are one law, as terms of a series are: they are asked together.
    """
    fitted, blocks, joints = here.fit, here.problem.blocks, here.problem.joints
    laws = [[one is e or _same_law(one, e) for e in fitted.effects] for one in fitted.effects]
    others = [[e for e, part in zip(fitted.effects, law, strict=True) if not part] for law in laws]
    whole, *rest = here.problem.plain().residuals([fitted.effects, *others])
    weights, motion = slopes(fitted.residual, here.problem.limits()), here.problem.motion()
    told, steady = dict[Key, tuple[float, float]](), always(fitted)
    for instance, law, without in zip(fitted.effects, laws, rest, strict=True):
        own = np.array(law)[fitted.owners]
        beside = own | steady  # what acts now and then, a part may not know
        known = replace(fitted, jacobian=fitted.jacobian[:, beside])
        local = instance.effect.scope in (Scope.JOINT, Scope.PAIR)
        where = [joints.index(name) for name in (instance.joints if local else joints)]
        told[instance.key] = (
            apart(known, blocks, own[beside], (without - whole) * weights),
            follows(whole, without - whole, motion, blocks, where),
        )
    return told


def _same_law(one: EffectInstance, other: EffectInstance) -> bool:
    law = one.effect.law_of
    return law is not None and (law, one.joints) == (other.effect.law_of, other.joints)
