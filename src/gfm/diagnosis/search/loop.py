"""The search: from the nominal model to the hypothesis that predicts best.

One step after another adds what predicts clearly better (`moves.add`), or common errors where no
single effect gains much, or what acts now and then only; removes what became superfluous, and
exchanges what something else says better. It ends where what can still be gained is not visible
beside the discrepancy of a right model, where nothing gains anything, or where its time is over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from gfm.core import Trajectory
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place, joint_scales, places, torque_views
from gfm.diagnosis.search.hypothesis import Hypothesis, nominal_hypothesis, settled_hypothesis
from gfm.diagnosis.search.moves.add import add, add_costly, gain_of, worth_more
from gfm.diagnosis.search.moves.common_errors import common_errors
from gfm.diagnosis.search.moves.intermittent import gain_in, intermittent, with_segments
from gfm.diagnosis.search.moves.reduce import rivals_of
from gfm.diagnosis.search.naming import equals_of, fitly_named, looked_for, recorded, twins
from gfm.diagnosis.search.nominal_parameters import least_amounts
from gfm.diagnosis.search.steps import Proposal, Search, effects_of
from gfm.diagnosis.search.trace import Evidence, Move, SearchResult, Step
from gfm.effects import EffectInstance, Key, Scope, effect_library

#: Share of the nominal misfit from which on common errors are looked for.
MUCH = 0.1
#: Share of the time that is kept for rivals of what was found.
FOR_RIVALS = 0.4
#: What long segments leave, in units of what short ones do, from which on they are searched, too.
MORE_IN_LONG = 2.0


@dataclass
class RobotMoves:
    """How a search goes on from a hypothesis on a robot.

    Attributes:
        candidates: What may be missing, and where.
        report: Told what is happening, in words.
        in_time: Whether there is time left.
        everything: All short segments there are.
        steps: Of the search so far.
        segments: That told of what acts now and then only, by the effect.
        looked_into: Whether segments that stay far off have been looked into.
    """

    candidates: Sequence[Place]
    report: Callable[[str], None]
    in_time: Callable[[], bool]
    everything: Problem
    steps: Sequence[Step]
    segments: dict[Key, Problem] = field(default_factory=dict)
    looked_into: bool = False

    @property
    def always(self) -> list[Place]:
        """Candidates that act all the time."""
        return [p for p in self.candidates if not p.effect.intermittent]

    def add(self, here: Hypothesis[Problem], _best: Step | None) -> Proposal[Problem]:
        """Proposes the best single effect of those that are simulated quickly."""
        step = add(here, self.always, self.report, self.in_time)
        return _proposal(here, step)

    def add_costly(self, here: Hypothesis[Problem], best: Step | None) -> Proposal[Problem] | None:
        """Proposes the best of all others, where those before leave what is worth it."""
        if best is not None and best.chosen is not None and best.segments:
            return None
        step = add_costly(here, self.always, self.report, self.in_time, best)
        return None if step is None else _proposal(here, step)

    def common(self, here: Hypothesis[Problem], best: Step | None) -> Proposal[Problem] | None:
        """Proposes common errors, once, where more can be gained than a single effect does."""
        tried = any(step.move is Move.COMMON_ERRORS for step in self.steps)
        much = here.fit.cost > MUCH * float(np.mean(here.nominal))
        enough = gain_of(best) >= 0.5 * here.room.nats
        if tried or enough or not much or not self.in_time():
            return None
        return _proposal(here, common_errors(here, self.always, self.report))

    def intermittent(
        self, here: Hypothesis[Problem], best: Step | None
    ) -> Proposal[Problem] | None:
        """Proposes what acts now and then only: where nothing else gains anything, and once before.

        As early as more can be gained than the best so far gains.
        """
        chosen = None if best is None else best.chosen
        early = not self.looked_into and worth_more(here, chosen)
        if not (early or chosen is None) or not self.in_time():
            return None
        self.looked_into = True
        found = intermittent(here, self.everything, self.candidates, self.report)
        if found is None:
            return None
        step, part = found

        def after() -> Hypothesis[Problem]:
            joined, own = with_segments(here, step, part)
            self.segments.update((e.key, own) for e in effects_of(step)[len(here.effects) :])
            return settled_hypothesis(joined, effects_of(step), here.nominal)

        return Proposal(step=step, after=after)

    def rivals(self, instance: EffectInstance, rest: Hypothesis) -> list[Fit]:
        """Returns fits of the best rivals of an effect beside the rest of a hypothesis."""
        return rivals_of(instance, rest, self.always, self.steps)


def _proposal(here: Hypothesis[Problem], step: Step) -> Proposal[Problem]:
    return Proposal(
        step=step, after=lambda: settled_hypothesis(here.problem, effects_of(step), here.nominal)
    )


def search(
    problem: Problem,
    long: Problem,
    everything: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
    time_left: Callable[[], float] = lambda: 1.0,
) -> tuple[SearchResult, Problem]:
    """Returns what recordings support, and that to which its amounts were fitted.

    Args:
        problem: Of short segments, in which effects are looked for.
        long: Of long ones, in which amounts are settled; the same problem where long ones tell
            no more.
        everything: All short segments there are.
        recordings: From which they were cut.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
    """
    longer = long is not problem
    candidates = _candidates(problem, recordings, report)
    here, under_way, moves = _begun(problem, everything, candidates, report, time_left)
    here = under_way.run(here, (moves.add, moves.common, moves.intermittent, moves.add_costly))
    if longer:
        report("settling amounts")
        long = reduce(Problem.joined, moves.segments.values(), replace(long, clock=problem.clock))
        settled = under_way.in_its_time(
            lambda: settled_hypothesis(long, here.effects, here.nominal), here
        )
        # What keeps a rollout off slowly, initial states of short segments make up for.
        slowly = settled.fit.cost - 1.0 > MORE_IN_LONG * max(here.fit.cost - 1.0, 1.0)
        here = under_way.run(settled, (moves.add, moves.add_costly)) if slowly else settled
    return _ended(here, under_way, moves)


def search_object(
    problem: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
    time_left: Callable[[], float] = lambda: 1.0,
) -> tuple[SearchResult, Problem]:
    """Returns what a robot feels of an object that it pushes, and to what amounts were fitted.

    Args:
        problem: Of segments in which the robot touches it, what the robot itself lacks given.
        recordings: From which they were cut.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
    """
    candidates = _candidates(problem, recordings, report)
    felt = [place for place in candidates if place.effect.scope is Scope.OBJECT]
    here, under_way, moves = _begun(problem, problem, felt, report, time_left)
    return _ended(under_way.run(here, (moves.add,)), under_way, moves)


def _begun(
    problem: Problem,
    everything: Problem,
    candidates: Sequence[Place],
    report: Callable[[str], None],
    time_left: Callable[[], float],
) -> tuple[Hypothesis[Problem], Search[Problem], RobotMoves]:
    """Returns the nominal model as a hypothesis, and how a search goes on from it."""
    under_way = Search[Problem](
        report=report,
        in_time=lambda: time_left() > 0.0,
        goes_on=lambda: time_left() > FOR_RIVALS,
        clock=problem.clock,
    )
    moves = RobotMoves(
        candidates=candidates,
        report=report,
        in_time=under_way.goes_on,
        everything=replace(everything, stepping=problem.stepping, clock=problem.clock),
        steps=under_way.steps,
    )
    return nominal_hypothesis(problem.robust(())), under_way, moves


def _ended(
    here: Hypothesis[Problem], under_way: Search[Problem], moves: RobotMoves
) -> tuple[SearchResult, Problem]:
    """Returns the result of a search, and to what its amounts were fitted."""
    final, evidence = under_way.end(here, moves.rivals)
    evidence = _of_the_end(evidence, final, moves.segments)
    fitted = fitly_named(final.fit, final.problem.specs)
    result = SearchResult(
        nominal_cost=float(np.mean(here.nominal)),
        fit=fitted,
        room=final.room,
        steps=tuple(under_way.steps),
        evidence=_also_by_other_names(evidence, fitted.effects),
        equals=_equals(final.problem, fitted.effects),
        segments=tuple(moves.segments.values()),
        out_of_time=under_way.out_of_time,
    )
    return result, final.problem


def _of_the_end(
    evidence: Mapping[Key, Evidence],
    final: Hypothesis[Problem],
    segments: Mapping[Key, Problem],
) -> dict[Key, Evidence]:
    """Returns evidence with what speaks in the end for effects that a few segments judge.

    They were taken beside what was known then.
    """
    few = {e.key: gain_in(segments[e.key], final, e) for e in final.effects if e.key in segments}
    return {
        key: replace(one, without=few[key]) if key in few else one for key, one in evidence.items()
    }


def _candidates(
    problem: Problem, recordings: Sequence[Trajectory], report: Callable[[str], None]
) -> list[Place]:
    """Returns every effect at every place that recordings may show."""
    report("looking at torques")
    scales = joint_scales(problem, torque_views(problem, recordings))
    library = (effect for effect in effect_library().values() if effect.twin is None)
    pushing = problem.pushing
    return [
        replace(place, least=least_amounts(problem.specs.values(), effect, place.joints))
        for effect in looked_for(library, recorded(problem))
        for place in places(effect, problem.joints, scales, problem.driven, pushing=pushing)
    ]


def _equals(
    problem: Problem, effects: Sequence[EffectInstance]
) -> dict[Key, tuple[EffectInstance, ...]]:
    """Returns the other names of effects that recordings do not tell from them."""
    seen = recorded(problem)
    same = {instance.key: twin for twin, instance in twins(effects)}
    return {
        e.key: (*((same[e.key],) if e.key in same else ()), *equals_of(e, seen)) for e in effects
    }


def _also_by_other_names(
    evidence: Mapping[Key, Evidence], effects: Sequence[EffectInstance]
) -> dict[Key, Evidence]:
    """Returns evidence under the names that effects have in the end."""
    other = {twin.key: one.key for twin, one in twins(effects)}
    told = dict(evidence)
    told.update({key: evidence[twin] for twin, key in other.items() if twin in evidence})
    return told
