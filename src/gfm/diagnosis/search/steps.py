"""The loop of every search: from one hypothesis to the next that predicts clearly better.

Moves propose steps; the best is taken, what became superfluous by it is removed, until what can
still be gained is not visible, nothing gains anything, or the time is over. In the end effects are
exchanged for what says more, and it is weighed what speaks for each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from gfm.diagnosis.inference.amounts import acting
from gfm.diagnosis.inference.fitting import measured
from gfm.diagnosis.search.hypothesis import FAR_OFF, Hypothesis, P
from gfm.diagnosis.search.moves.begin_anew import begun_anew
from gfm.diagnosis.search.moves.merge import merge
from gfm.diagnosis.search.moves.missing_torque import fewest
from gfm.diagnosis.search.moves.reduce import Compared, RivalsOf, exchange, remove, rivals_of
from gfm.diagnosis.search.naming import describe
from gfm.diagnosis.search.support import support
from gfm.diagnosis.search.trace import Move, SearchResult, Step
from gfm.diagnosis.search.under_way import MoveFrom, Search
from gfm.effects import Key

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
        if best.move is Move.MISSING_TORQUE:
            best = search.in_its_time(partial(fewest, here, best), best, step=True)
        if here.fit.cost > FAR_OFF and not search.goes_on():
            best = replace(best, chosen=None)  # far off, what was compared with little may be wrong
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
        here = replace(here, fit=measured(here.problem, some))
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
    begun = frozenset[Key]()
    while True:
        merged = merge(here, search)
        if (keys := frozenset(e.key for e in merged.effects)) != begun:
            begun, merged = keys, begun_anew(merged, search)  # once for what stands there
        after, compared = exchange(merged, search, rivals)
        last, here = after is merged, remove(after, search)
        if last or not search.in_time():
            return here, compared
