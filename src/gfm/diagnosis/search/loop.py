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
from gfm.diagnosis.inference.fitting import (
    acting,
    along_valley,
    amounts,
    free_parameters,
    measured,
    nothing,
)
from gfm.diagnosis.inference.intervals import disagreement
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place, joint_scales, places, torque_views
from gfm.diagnosis.search.equals import equals_of, looked_for, recorded
from gfm.diagnosis.search.hypothesis import Hypothesis, hypothesis, settled_hypothesis
from gfm.diagnosis.search.moves.add import add
from gfm.diagnosis.search.moves.common_errors import common_errors
from gfm.diagnosis.search.moves.intermittent import intermittent, with_segments
from gfm.diagnosis.search.moves.reduce import Compared, Rivals, exchange, gains_of_each, remove
from gfm.diagnosis.search.naming import fitly_named, twins
from gfm.diagnosis.search.nominal_parameters import with_room
from gfm.diagnosis.search.trace import Evidence, Move, SearchResult, Step
from gfm.effects import EffectInstance, Key, Scales, Scope, effect_library

#: Steps at most.
MOST_STEPS = 24
#: Share of the nominal misfit from which on common errors are looked for.
MUCH = 0.1
#: What long segments leave, in units of what short ones do, from which on they are searched, too.
MORE_IN_LONG = 2.0


@dataclass
class Search:
    """A search under way.

    Attributes:
        candidates: What may be missing, and where.
        scales: Of every joint's signals.
        report: Told what is happening, in words.
        in_time: Whether there is time left.
        everything: All short segments there are.
        steps: So far.
        segments: That told of what acts now and then only.
        held: Keys of what few segments judge.
    """

    candidates: Sequence[Place]
    scales: Sequence[Scales]
    report: Callable[[str], None]
    in_time: Callable[[], bool]
    everything: Problem
    steps: list[Step] = field(default_factory=list)
    segments: list[Problem] = field(default_factory=list)
    held: set[Key] = field(default_factory=set)

    def run(self, here: Hypothesis, moves: Sequence[Move]) -> Hypothesis:
        """Returns the best hypothesis that steps lead to."""
        while here.is_open and len(self.steps) < MOST_STEPS and self.in_time():
            after = self._step(here, moves)
            if after is None:
                break
            here, removed = remove(after, self.held, self.report)
            self.steps.extend(removed)
        return here

    def _step(self, here: Hypothesis, moves: Sequence[Move]) -> Hypothesis | None:
        """Returns the hypothesis after the best step; None where there is none."""
        always = [p for p in self.candidates if not p.effect.only_in_stretches]
        single = add(here, always, self.scales, self.report)
        step = single
        if Move.COMMON_ERRORS in moves and self._gains_little(here, single):
            common = common_errors(here, always, self.scales, self.report)
            if _gain(common) > _gain(single):
                step = common
        if step.chosen is None and Move.INTERMITTENT in moves:
            return self._intermittent(here, single)
        self.steps.append(step)
        if step.chosen is None:
            return None
        return settled_hypothesis(here.problem, step.chosen.fit.effects, here.nominal)

    def _gains_little(self, here: Hypothesis, single: Step) -> bool:
        """Returns whether more can be gained than the best single effect does."""
        tried = any(step.move is Move.COMMON_ERRORS for step in self.steps)
        much = here.fit.cost > MUCH * float(np.mean(here.nominal))
        return not tried and much and _gain(single) < 0.5 * here.room.nats

    def _intermittent(self, here: Hypothesis, single: Step) -> Hypothesis | None:
        """Returns the hypothesis with what acts now and then only; None where nothing does."""
        found = intermittent(here, self.everything, self.candidates, self.scales, self.report)
        self.steps.append(single if found is None else found[0])
        if found is None or (chosen := found[0].chosen) is None:
            return None
        step, part = found
        joined, own = with_segments(here, step, part)
        self.segments.append(own)
        self.held.add(chosen.new[0].key)
        return settled_hypothesis(joined, chosen.fit.effects, here.nominal)


def _gain(step: Step) -> float:
    return 0.0 if step.chosen is None else step.chosen.gain.nats


def search(
    problem: Problem,
    long: Problem,
    everything: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
    in_time: Callable[[], bool] = lambda: True,
) -> tuple[SearchResult, Problem]:
    """Returns what recordings support, and that to which its amounts were fitted.

    Args:
        problem: Of short segments, in which effects are looked for.
        long: Of long ones, in which amounts are settled; the same problem where long ones tell
            no more.
        everything: All short segments there are.
        recordings: From which they were cut.
        report: Told what is happening, in words.
        in_time: Whether there is time left.
    """
    longer = long is not problem
    report("looking at torques")
    scales = joint_scales(problem, torque_views(problem, recordings))
    problem = problem.robust(())
    nothing_yet = nothing(problem)
    here = hypothesis(problem, nothing_yet, problem.joint_costs(nothing_yet.residual))
    under_way = Search(
        candidates=_candidates(problem),
        scales=scales,
        report=report,
        in_time=in_time,
        everything=replace(everything, stepping=problem.stepping),
    )
    here = under_way.run(here, (Move.ADD, Move.COMMON_ERRORS, Move.INTERMITTENT))
    if longer:
        report("settling amounts")
        long = reduce(Problem.joined, under_way.segments, long)
        settled = settled_hypothesis(long, here.effects, here.nominal)
        # What keeps a rollout off slowly, initial states of short segments make up for.
        slowly = settled.fit.cost - 1.0 > MORE_IN_LONG * max(here.fit.cost - 1.0, 1.0)
        here = under_way.run(settled, (Move.ADD,)) if slowly else settled
    final, compared = _reduced(here, under_way)
    final = _with_acting(final)
    evidence = _evidence(final, compared)
    fitted = fitly_named(final.fit, problem.specs)
    return (
        SearchResult(
            nominal_cost=nothing_yet.cost,
            fit=fitted,
            room=final.room,
            steps=tuple(under_way.steps),
            evidence=_also_by_other_names(evidence, fitted.effects),
            equals=_equals(final.problem, fitted.effects),
            segments=tuple(under_way.segments),
            out_of_time=not in_time(),
        ),
        final.problem,
    )


def _candidates(problem: Problem) -> list[Place]:
    library = (effect for effect in effect_library().values() if effect.twin is None)
    return [
        with_room(problem, place)
        for effect in looked_for(library, recorded(problem))
        for place in places(effect, problem.joints, problem.driven, pushing=problem.pushing)
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


def _reduced(here: Hypothesis, under_way: Search) -> tuple[Hypothesis, list[Compared]]:
    """Returns a hypothesis after exchanges and removals, and what rivals every effect."""
    while True:
        rivals = Rivals(
            candidates=[p for p in under_way.candidates if not p.effect.only_in_stretches],
            scales=under_way.scales,
            steps=under_way.steps,
        )
        here, exchanged, compared = exchange(here, under_way.held, rivals, under_way.report)
        here, removed = remove(here, under_way.held, under_way.report)
        under_way.steps.extend([*exchanged, *removed])
        if not exchanged or not under_way.in_time():
            return here, compared


def _with_acting(here: Hypothesis) -> Hypothesis:
    """Returns a hypothesis without effects of which there is nothing, amounts settled."""
    some = acting(here.effects)
    if len(some) < len(here.effects):
        return hypothesis(here.problem, measured(here.problem, some), here.nominal)
    return hypothesis(here.problem, along_valley(here.problem, here.fit), here.nominal)


def _evidence(here: Hypothesis, compared: Sequence[Compared]) -> dict[Key, Evidence]:
    """Returns what speaks for each effect of a hypothesis."""
    rivals = {one.instance.key: one for one in compared}
    left, halves = _left_by_joint(here), _halves(here)
    return {
        instance.key: Evidence(
            without=without,
            rival=rivals[instance.key].over if instance.key in rivals else None,
            by=rivals[instance.key].rival if instance.key in rivals else None,
            left=_left_of(instance, here.problem, left),
            halves=halves[instance.key],
        )
        for without, instance in gains_of_each(here)
    }


def _left_by_joint(here: Hypothesis) -> tuple[np.ndarray, np.ndarray]:
    """Returns the squared gap of each joint before and after, in units of the noise, (J,) each."""
    plain = replace(here.problem, outlying_from=None)
    before, after = plain.residuals([(), here.effects])
    gap = [np.maximum(plain.joint_costs(r) - 1.0, 1e-9) for r in (before, after)]
    return gap[0], gap[1]


def _left_of(
    instance: EffectInstance, problem: Problem, gaps: tuple[np.ndarray, np.ndarray]
) -> float:
    local = instance.effect.scope in (Scope.JOINT, Scope.PAIR)
    names = instance.joints if local else problem.joints
    rows = [problem.joints.index(name) for name in names]
    return float(gaps[1][rows].sum() / gaps[0][rows].sum())


def _halves(here: Hypothesis) -> dict[Key, float]:
    """Returns by how many standard errors two halves of the data put each effect apart."""
    layout = here.problem.layout()
    recordings = sorted({segment.recording for segment in layout})
    by_recording = len(recordings) > 1
    half = [
        (recordings.index(s.recording) if by_recording else i) % 2 for i, s in enumerate(layout)
    ]
    fitted = here.fit
    apart = disagreement(
        amounts(fitted.effects), fitted.jacobian, fitted.residual, here.problem.slices(), half
    )
    by_effect: dict[Key, float] = {e.key: 0.0 for e in fitted.effects}
    for (i, _), errors in zip(free_parameters(fitted.effects), apart, strict=True):
        key = fitted.effects[i].key
        by_effect[key] = max(by_effect[key], float(errors))
    return by_effect


def _also_by_other_names(
    evidence: Mapping[Key, Evidence], effects: Sequence[EffectInstance]
) -> dict[Key, Evidence]:
    """Returns evidence under the names that effects have in the end."""
    other = {twin.key: one.key for twin, one in twins(effects)}
    told = dict(evidence)
    told.update({key: evidence[twin] for twin, key in other.items() if twin in evidence})
    return told
