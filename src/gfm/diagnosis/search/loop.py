"""The search: from the nominal model to the hypothesis that predicts best.

One step after another adds what predicts clearly better: what the missing torque shows
(`moves.missing_torque`); one effect (`moves.add`); common errors, where no single effect gains
much; or what acts now and then only. What became superfluous is removed, and what something else
says better is exchanged: one for several (`moves.merge`), one for one (`moves.reduce`). It ends
where what can still be gained is not visible beside the discrepancy of a right model, where nothing
gains anything, or where its time is over.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from functools import partial, reduce

from gfm.core import Trajectory
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import joint_scales, places
from gfm.diagnosis.search.hypothesis import Hypothesis, P, nominal_hypothesis, settled_hypothesis
from gfm.diagnosis.search.moves.add import add, add_costly, add_motors
from gfm.diagnosis.search.moves.common_errors import common_errors
from gfm.diagnosis.search.moves.intermittent import Intermittent, gain_in
from gfm.diagnosis.search.moves.missing_torque import missing_torque
from gfm.diagnosis.search.naming import equals_of, fitly_named, looked_for, recorded, twins
from gfm.diagnosis.search.steps import end, run
from gfm.diagnosis.search.trace import SearchResult, Step, parts_of
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, effect_library
from gfm.effects.nominal_parameters import least_amounts, most_amounts
from gfm.signals.torque_domain import torque_domain, torque_views

#: Share of the time that is kept for rivals of what was found.
FOR_RIVALS = 0.4
#: Measurements that are looked at as torques.
TORQUES = 3000
#: What long segments leave, in units of what short ones do, from which on they are searched, too.
MORE_IN_LONG = 2.0


def search(
    problem: Problem,
    long: Problem,
    everything: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
    time_left: Callable[[], float] = lambda: 1.0,
    known: Sequence[EffectInstance] = (),
    free: Sequence[Trajectory] = (),
) -> SearchResult[Problem]:
    """Returns what recordings support.

    Args:
        problem: Of short segments, in which effects are looked for.
        long: Of long ones, in which amounts are settled; the same where long ones tell no more.
        everything: All short segments there are.
        recordings: From which they were cut.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
        known: Effects to begin with.
        free: Pieces of them in which the robot touches nothing: those that bear witness of amounts.
    """
    here, under_way = _begun(problem, recordings, report, time_left)
    if free:
        under_way.witness = torque_domain(problem, free, TORQUES)
    if known:
        here = settled_hypothesis(here.problem, known, here.nominal)
    everything = replace(everything, stepping=problem.stepping)
    rarely = Intermittent(everything=everything, candidates=under_way.candidates)
    under_way.candidates = [p for p in rarely.candidates if not p.effect.intermittent]
    moves = (missing_torque, add, common_errors, rarely, add_costly, _motors_beside)
    here = run(here, under_way, moves)
    if long is not problem:
        report("settling amounts")
        parts = parts_of(under_way.steps).values()
        long = reduce(Problem.joined, parts, replace(long, clock=problem.clock))
        settle = partial(settled_hypothesis, long, here.effects, here.nominal)
        settled = under_way.in_its_time(settle, here)
        # What keeps a rollout off slowly, initial states of short segments make up for.
        slowly = settled.fit.cost - 1.0 > MORE_IN_LONG * max(here.fit.cost - 1.0, 1.0)
        here = run(settled, under_way, (missing_torque, add, add_costly)) if slowly else settled
    # Motors apart from their links take longest: alone they are tried where nothing else gains.
    last = run(here, under_way, (add_motors,))
    if last is not here:
        last = run(last, under_way, (missing_torque, add, add_costly, add_motors))
    return _fitly_told(end(last, under_way))


def _motors_beside(before: Hypothesis[P], search: Search[P], best: Step) -> Step | None:
    """Returns the step of `add_motors` beside one that gains something; None where none does."""
    return add_motors(before, search, best) if best.chosen else None


def search_object(
    problem: Problem,
    recordings: Sequence[Trajectory],
    names: Collection[str],
    report: Callable[[str], None],
    time_left: Callable[[], float] = lambda: 1.0,
) -> SearchResult[Problem]:
    """Returns what a robot feels of an object that it pushes.

    Args:
        problem: Of segments in which the robot touches it, what the robot itself lacks given.
        recordings: From which they were cut.
        names: Of the effects that are looked for.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
    """
    nominal, under_way = _begun(problem, recordings, report, time_left)
    under_way.candidates = [p for p in under_way.candidates if p.effect.name in names]
    return _fitly_told(end(run(nominal, under_way, (add,)), under_way))


def _begun(
    problem: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
    time_left: Callable[[], float],
) -> tuple[Hypothesis[Problem], Search[Problem]]:
    """Returns the nominal model, and a search for every effect at every place that may show."""
    report("looking at torques")
    views = torque_views(problem, recordings)
    scales = joint_scales(problem, views)
    library = [effect for effect in effect_library().values() if effect.twin is None]
    if problem.air:  # what the robot runs onto is left out
        library = [effect for effect in library if not effect.intermittent]
    pushing = problem.pushing
    under_way = Search(
        candidates=[
            replace(
                place,
                least=least_amounts(problem.specs.values(), effect, place.joints),
                most=most_amounts(problem.specs.values(), effect),
            )
            for effect in looked_for(library, recorded(problem))
            for place in places(effect, problem.joints, scales, problem.driven, pushing=pushing)
        ],
        report=report,
        torques=torque_domain(problem, recordings, TORQUES),
        after=_after,
        in_time=lambda: time_left() > 0.0,
        goes_on=lambda: time_left() > FOR_RIVALS,
        clock=problem.clock,
    )
    return nominal_hypothesis(problem.robust(())), under_way


def _after(here: Hypothesis[Problem], step: Step) -> Hypothesis[Problem]:
    """Returns the hypothesis after a step, with the segments that told of it."""
    problem = here.problem
    if step.part is not None:
        problem = problem.joined(step.part).settled(step.effects)
    return settled_hypothesis(problem, step.effects, here.nominal)


def _fitly_told(found: SearchResult[Problem]) -> SearchResult[Problem]:
    """Returns what was found by the names that effects have in the end, and their other names.

    With what speaks in the end for effects that a few segments judge: more is known than then.
    """
    effects, parts = found.fit.effects, parts_of(found.steps)
    fit = fitly_named(found.fit, found.problem.specs)
    evidence, equals, seen = {}, {}, recorded(found.problem)
    for before, named in zip(effects, fit.effects, strict=True):
        told = found.evidence[before.key]
        if before.key in parts:
            told = replace(told, without=gain_in(parts[before.key], effects, before))
        evidence[named.key] = told
        same = found.equals.get(before.key, ())
        equals[named.key] = (*same, *twins(named), *equals_of(named, seen))
    return replace(found, fit=fit, evidence=evidence, equals=equals)
