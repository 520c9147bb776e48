"""What a model has too much of, and the delay that this hides.

Effects add to a model. Where its own damping, dry friction or motor inertia is larger than the
robot's, no effect explains what is left, and rollouts have no room for a delay. So where much is
left in the end, what the model itself says of its joints is fitted anew beside what was found; and
where answers to steps come late, a delay as well, by both witnesses.

Shape letters: N numbers of the rollouts' residual, A answers to steps.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.answers import Answers, dead_time, find_answers
from gfm.diagnosis.attribution import CLOSE_CALL, FAR_LESS, Round, without_superfluous
from gfm.diagnosis.fitting import FITTING_S, LEAST_GAIN, ROUGH, Fit, fit, mean_square, measured
from gfm.diagnosis.outliers import OUTLYING, bounded
from gfm.diagnosis.problem import Problem, settled
from gfm.diagnosis.restating import Key, beside_own, with_own, without_own
from gfm.diagnosis.usual import FITS, earning
from gfm.effects import EffectInstance, find_effect

#: Mean square, in units of the noise, from which on a model may have too much of something.
FAR = 10.0
#: Recorded time in which that is looked into, s.
LOOKED_AT_S = 2.0 * FITTING_S
#: What delays an answer, by name.
DELAYS = ("command_delay", "actuator_lag")


@dataclass(frozen=True, kw_only=True)
class BothWitnesses:
    """Rollouts and answers to steps as one least-squares problem.

    Attributes:
        rollouts: Open-loop predictions.
        answers: To steps; there may be none.
        units: Of the rollouts' residual, and of the answers, s.
    """

    rollouts: Problem
    answers: Answers
    units: tuple[float, float]

    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns what each candidate leaves of both, weighted alike, (candidates, N + A)."""
        rollouts = self.rollouts.residuals(candidates) / self.units[0]
        late = self.answers.late_s(candidates)
        answers = np.stack([bounded(one / self.units[1], OUTLYING) for one in late])
        both = rollouts, answers
        return np.concatenate([one / np.sqrt(max(one.shape[1], 1)) for one in both], axis=1)

    def coarse(self) -> BothWitnesses:
        """Returns the problem with rollouts by fast integration."""
        return replace(self, rollouts=self.rollouts.coarse())

    def without_own(
        self, keys: Collection[Key]
    ) -> tuple[BothWitnesses, tuple[EffectInstance, ...]]:
        """Returns both before models without what they say under `keys`, and what that is."""
        rollouts, own = without_own(self.rollouts, keys)
        problem, _ = without_own(self.answers.problem, keys)
        return replace(self, rollouts=rollouts, answers=replace(self.answers, problem=problem)), own


def too_much(
    problem: Problem,
    short: Problem,
    recordings: Sequence[Trajectory],
    fitted: Fit,
    kept: Collection[tuple[object, ...]] = (),
) -> Round | None:
    """Returns a round in which the model was found to have too much of something, or none.

    Without a delay it has to leave far less. With one that answers to steps show, rollouts may
    leave a little more, both witnesses together less: answers decide where rollouts hardly tell.

    Args:
        problem: Rollouts to which the effects were fitted.
        short: Short ones, in which what the model itself says is looked into.
        recordings: All recordings of the problem.
        fitted: What was found, by rollouts alone.
        kept: Keys of what these do not judge.
    """
    if any(e.effect.separates_motor for e in fitted.effects):
        return None
    answers, late_s, delay = _heard(problem, recordings, fitted)
    unit_s = float(np.sqrt(np.mean(late_s**2))) if delay else 1.0
    short = settled(short.subset(short.sample(LOOKED_AT_S)), fitted.effects)
    both = _witnesses(short.robust(fitted.effects), answers, unit_s, fitted)
    begun = _restated(both, fitted.effects, delay, kept)
    if begun is None:
        return None
    both = _witnesses(problem, answers, unit_s, fitted)
    together = _refitted(both, begun)
    left = together.cost / mean_square(both.residuals([fitted.effects])[0])
    told = measured(problem, together.effects)
    new = len({e.key for e in together.effects} - {e.key for e in fitted.effects})
    if not new or left > _at_most(delay) or told.cost > CLOSE_CALL * fitted.cost:
        return None
    return Round(
        before=fitted.cost,
        screened=(),
        fits=(replace(together, cost=left * fitted.cost),),
        accepted=told,
        together=new if new > 1 else 0,
        restated=True,
        late_s=(late_s, answers.late_s([together.effects])[0]) if delay else None,
    )


def _heard(
    problem: Problem, recordings: Sequence[Trajectory], fitted: Fit
) -> tuple[Answers, Array, tuple[EffectInstance, ...]]:
    """Returns answers to steps, by how much they come late, s, (A,), and the delay they show.

    None of either where they show none, or one was found already.
    """
    answers = find_answers(problem, recordings)
    late_s = answers.late_s([fitted.effects])[0]
    common_s = dead_time(late_s, answers.by_joint)
    if common_s is None or any(e.effect.name in DELAYS for e in fitted.effects):
        return answers.none, late_s[:0], ()
    effect = find_effect("command_delay")
    values = {"delay": common_s}
    return (
        answers,
        late_s,
        (EffectInstance(effect=effect, joints=problem.driven, values=values),),
    )


def _at_most(delay: Sequence[EffectInstance]) -> float:
    """Returns the share of both witnesses that may be left: answers to steps speak for a delay."""
    return 1.0 - LEAST_GAIN if delay else FAR_LESS


def _witnesses(problem: Problem, answers: Answers, unit_s: float, fitted: Fit) -> BothWitnesses:
    """Returns both witnesses, in units of what was left before."""
    unit = float(np.sqrt(mean_square(problem.residuals([fitted.effects])[0])))
    return BothWitnesses(rollouts=problem, answers=answers, units=(unit, unit_s))


def _restated(
    both: BothWitnesses,
    fitted: Sequence[EffectInstance],
    delay: Sequence[EffectInstance],
    kept: Collection[tuple[object, ...]],
) -> tuple[EffectInstance, ...] | None:
    """Returns what was found, a delay, and what the model says wrongly; None where that is little.

    Without what explains nothing beside these.
    """
    effects, stay = (*fitted, *delay), len(fitted) + len(delay)
    found = {e.key for e in effects}
    doubted = [e.key for e in without_own(both.rollouts)[1] if e.key not in found]
    if not doubted and not delay:
        return None
    before = mean_square(both.residuals([fitted])[0])
    for _ in range(FITS):
        bare, own = both.without_own(doubted)
        tried = fit(bare, with_own(effects, own), tolerance=ROUGH)
        if tried.cost > _at_most(delay) * before:
            return None
        earned = earning(bare.rollouts, measured(bare.rollouts, tried.effects), stay, own)
        effects = beside_own(earned, own)
        before_that, doubted = doubted, [k for k in doubted if k in {e.key for e in earned}]
        if doubted == before_that:
            break
    bare, own = both.without_own(doubted)
    whole = measured(bare.rollouts, with_own(effects, own))
    stay_there = [*kept, *(e.key for e in (*delay, *own))]
    return beside_own(without_superfluous(bare.rollouts, whole, stay_there).effects, own)


def _refitted(both: BothWitnesses, begun: Sequence[EffectInstance]) -> Fit:
    """Returns effects fitted to both witnesses, which may take off what the model has."""
    bare, own = both.without_own([e.key for e in begun])
    found = fit(bare, with_own(begun, own))
    return replace(found, effects=beside_own(found.effects, own))
