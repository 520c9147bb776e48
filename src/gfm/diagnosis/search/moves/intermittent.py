"""Add what acts now and then only: a surface that the robot runs onto, a limit that it reaches.

It explains nearly all of a few segments and nothing of the others. Segments that stay far off are
screened by themselves, with what was found held as it is; whether the effect predicts better is
told by all of them together, by the score.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gfm.diagnosis.inference.amounts import at_bound
from gfm.diagnosis.inference.fitting import measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.diagnosis.residuals.outliers import OUTLYING
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, nominal_hypothesis
from gfm.diagnosis.search.moves.add import worth_more
from gfm.diagnosis.search.naming import describe, first_of_each
from gfm.diagnosis.search.promises import SCREENING_S
from gfm.diagnosis.search.screening import Screened, open_to, screen
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance

#: Fewest segments that are looked into: fewer are an accident.
LEAST_SEGMENTS = 4
#: Recorded time of the segments that are looked into at most, valleys from which what acts now and
#: then is fitted, and other candidates that are.
FAR_S, VALLEYS, OTHERS = 96.0, 5, 2


@dataclass(kw_only=True)
class Intermittent:
    """The move: as early as more can be gained than the best step so far gains, or than nothing.

    Once before others have nothing to gain.

    Attributes:
        everything: All segments of the recordings.
        candidates: What may explain them, also what acts now and then only.
        looked_into: Whether segments that stay far off have been looked into.
    """

    everything: Problem
    candidates: Sequence[Place]
    looked_into: bool = False

    def __call__(
        self, before: Hypothesis[Problem], search: Search[Problem], best: Step
    ) -> Step | None:
        """Returns the step that adds such an effect.

        None where too few segments stay far off, or nothing that acts now and then shows.
        """
        early = not self.looked_into and worth_more(before, best.chosen)
        if not (early or best.chosen is None) or not search.goes_on():
            return None
        self.looked_into = True
        everything = replace(self.everything, in_force=before.problem.in_force)
        far = far_off(everything, before.effects)
        if not far:
            return None
        search.report(f"looking into {len(far)} segments that stay far off")
        part = with_state_basis(everything.subset(far), before.effects)
        alone = _alone(part, before.effects)
        tier = open_to(before, self.candidates, before.open_joints)
        own, others = _likely(screen(alone, tier, SCREENING_S))
        if not own:
            return None
        tried = [_tried(alone, before.effects, one, search.report) for one in own]
        best_own = max(tried, key=lambda one: one.gain.nats)
        acting = _changed(before, part, best_own.new[0])
        if best_own.gain.clear and len(acting.segments) >= LEAST_SEGMENTS:
            # What stays far off elsewhere, for other reasons, says nothing for or against it.
            part, alone = acting, _alone(acting, before.effects)
            tried = [_tried(alone, before.effects, best_own.new[0], search.report)]
        tried += [_tried(alone, before.effects, one, search.report) for one in others]
        return _step(before, part, alone.fit.cost, tried)


def _likely(screened: Sequence[Screened]) -> tuple[list[EffectInstance], list[EffectInstance]]:
    """Returns what is worth a fit: what acts now and then only, and what acts always."""
    likely = [one.instance for one in screened if one.gain.nats > 0.0]
    own = [one for one in likely if one.effect.intermittent]
    always = [one for one in likely if not one.effect.intermittent]
    return own[:VALLEYS], first_of_each(always, lambda e: e.key)[:OTHERS]


def _step(before: Hypothesis[Problem], part: Problem, left: float, tried: Sequence[Tried]) -> Step:
    """Returns the step that adds the best of what was tried; what acts always is none of it.

    It explains `part`, segments that stay far off and `left` so much before.
    """
    ranked = tuple(sorted(tried, key=lambda one: -one.gain.nats))
    best = ranked[0]
    (new,) = best.new
    good = best.gain.clear and new.effect.intermittent and not at_bound(new)
    return Step(
        move=Move.INTERMITTENT,
        before=left,
        ranked=ranked,
        chosen=best if good else None,
        segments=len(part.segments),
        part=_changed(before, part, new) if good else None,
    )


def _changed(before: Hypothesis[Problem], part: Problem, new: EffectInstance) -> Problem:
    """Returns those segments of a part that an effect changes beside all that was found before."""
    without, beside = part.residuals([before.effects, (*before.effects, new)])
    own = [
        i
        for i, rows in enumerate(part.slices())
        if np.sum((beside[rows] - without[rows]) ** 2) > np.sum(without[rows] ** 2) / OUTLYING**2
    ]
    return part.subset(own)


def gain_in(
    part: Problem, effects: Sequence[EffectInstance], instance: EffectInstance
) -> Difference:
    """Returns by how much better a few segments are predicted with one of `effects`.

    Each from the others, beside all else as it was found in the end.
    """
    alone = _alone(part, [e for e in effects if e is not instance])
    return -alone.over(measured(alone.problem, (instance,)))


def _alone(part: Problem, effects: Sequence[EffectInstance]) -> Hypothesis[Problem]:
    """Returns a few segments by themselves, beside effects that are held as they are.

    Few segments of few recordings tell of it: each is predicted from all others.
    """
    held = replace(part, given=(*part.given, *effects), each_segment=True)
    return nominal_hypothesis(held.settled(()).robust(()))


def _tried(
    alone: Hypothesis,
    held: Sequence[EffectInstance],
    instance: EffectInstance,
    report: Callable[[str], None],
) -> Tried:
    report(f"fitting {describe(instance)}")
    fitted = alone.fitted((instance,))
    whole = replace(fitted, effects=(*held, *fitted.effects))
    return Tried(new=fitted.effects, fit=whole, gain=-alone.over(fitted))


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
