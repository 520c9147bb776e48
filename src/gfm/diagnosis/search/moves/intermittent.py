"""Add what acts now and then only: a surface that the robot runs onto, a limit that it reaches.

It explains nearly all of a few segments and nothing of the others. Segments that stay far off are
screened by themselves, with what was found held as it is; whether the effect predicts better is
told by all of them together, by the score.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import at_bound, measured, nothing
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.diagnosis.residuals.outliers import OUTLYING
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis
from gfm.diagnosis.search.moves.add import SCREENING_S
from gfm.diagnosis.search.naming import describe, first_of_each
from gfm.diagnosis.search.screening import open_to, screen
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.effects import EffectInstance

#: Fewest segments that are looked into: fewer are an accident.
LEAST_SEGMENTS = 4
#: Recorded time of the segments that are looked into at most, valleys from which what acts now and
#: then is fitted, and other candidates that are.
FAR_S, VALLEYS, OTHERS = 96.0, 5, 2


def intermittent(
    before: Hypothesis[Problem],
    everything: Problem,
    candidates: Sequence[Place],
    report: Callable[[str], None],
) -> tuple[Step, Problem] | None:
    """Returns the step that adds such an effect, and the segments that told of it.

    None where too few segments stay far off, or nothing that acts now and then promises anything.

    Args:
        before: What was found so far.
        everything: All segments of the recordings.
        candidates: What may explain them.
        report: Told what is happening, in words.
    """
    everything = replace(everything, after_command=before.problem.after_command)
    far = far_off(everything, before.effects)
    if not far:
        return None
    report(f"looking into {len(far)} segments that stay far off")
    part = with_state_basis(everything.subset(far), before.effects)
    alone = _alone(part, before.effects, before.nominal)
    screened = screen(alone, open_to(before, candidates, before.open_joints), SCREENING_S)
    likely = [s.instance for s in screened if s.gain.nats > 0.0]
    own = [one for one in likely if one.effect.intermittent][:VALLEYS]
    if not own:
        return None
    always = [one for one in likely if not one.effect.intermittent]
    others = first_of_each(always, lambda e: e.key)[:OTHERS]
    tried = [_tried(alone, before.effects, one, report) for one in (*own, *others)]
    ranked = tuple(sorted(tried, key=lambda one: -one.gain.nats))
    # What acts always is no matter of a few segments.
    good = [
        one
        for one in ranked[:1]
        if one.gain.clear and one.new[0].effect.intermittent and not at_bound(one.new[0])
    ]
    step = Step(
        move=Move.INTERMITTENT,
        before=alone.fit.cost,
        ranked=ranked,
        chosen=good[0] if good else None,
        segments=len(far),
    )
    return step, part


def gain_in(part: Problem, here: Hypothesis[Problem], instance: EffectInstance) -> Difference:
    """Returns by how much better a few segments are predicted with one effect of a hypothesis.

    Each from the others, beside all else as it was found in the end.
    """
    alone = _alone(part, [e for e in here.effects if e is not instance], here.nominal)
    return alone.gain_of(measured(alone.problem, (instance,)))


def _alone(part: Problem, effects: Sequence[EffectInstance], nominal: Array) -> Hypothesis[Problem]:
    """Returns a few segments by themselves, beside effects that are held as they are.

    Few segments of few recordings tell of it: each is predicted from all others.
    """
    held = replace(part, given=(*part.given, *effects), each_segment=True).settled(()).robust(())
    return Hypothesis(problem=held, fit=nothing(held), nominal=nominal)


def _tried(
    alone: Hypothesis,
    held: Sequence[EffectInstance],
    instance: EffectInstance,
    report: Callable[[str], None],
) -> Tried:
    report(f"fitting {describe(instance)}")
    fitted = alone.fitted((instance,))
    whole = replace(fitted, effects=(*held, *fitted.effects))
    return Tried(new=fitted.effects, fit=whole, gain=alone.gain_of(fitted))


def far_off(everything: Problem, effects: Sequence[EffectInstance]) -> list[int]:
    """Returns the segments that `effects` leave far off, by their numbers; none if they are few.

    Far beyond what is left of a typical segment.
    """
    residual = everything.plain().residuals([effects])[0]
    costs = np.array([np.mean(residual[rows] ** 2) for rows in everything.slices()])
    far = np.flatnonzero(costs > OUTLYING**2 * max(float(np.median(costs)), OUTLYING**2))
    if len(far) < LEAST_SEGMENTS:
        return []
    return [int(far[i]) for i in everything.subset(far.tolist()).sample(FAR_S)]


def with_segments(
    before: Hypothesis[Problem], step: Step, part: Problem
) -> tuple[Problem, Problem]:
    """Returns the problem with the segments that an effect changes, and these alone."""
    if step.chosen is None:
        return before.problem, part
    instance = step.chosen.new[0]
    sets = [before.effects, (*before.effects, instance)]
    without, beside = part.residuals(sets)
    own = [
        i
        for i, rows in enumerate(part.slices())
        if np.sum((beside[rows] - without[rows]) ** 2) > np.sum(without[rows] ** 2) / OUTLYING**2
    ]
    part = part.subset(own)
    joined = before.problem.joined(part).settled((*before.effects, instance))
    return joined, part
