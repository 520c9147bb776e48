"""What a model has too much of, and the delay that this hides.

Where a model's own damping, dry friction or motor inertia is larger than the robot's on many
joints, taking it off one of them explains too little, and rollouts have no room for a delay. So
where much is left in the end, what the model itself says of its joints is fitted anew beside what
was found, all of it together; and where answers to steps come late, a delay as well, by both
witnesses.

Shape letters: N numbers of the rollouts' residual, A answers to steps.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.former.adequate import FAR_LESS
from gfm.diagnosis.former.attribution import CLOSE_CALL, Round, without_superfluous
from gfm.diagnosis.former.usual import FITS, earning
from gfm.diagnosis.inference.fitting import (
    FITTING_S,
    LEAST_GAIN,
    ROUGH,
    Fit,
    fit,
    mean_square,
    measured,
)
from gfm.diagnosis.residuals.outliers import OUTLYING, bounded
from gfm.diagnosis.residuals.problem import Problem, settled
from gfm.diagnosis.residuals.step_response import Answers, dead_time, find_answers
from gfm.diagnosis.search.nominal_parameters import beside_own, with_own, without_own
from gfm.effects import EffectInstance, Key, find_effect

#: Mean square, in units of the noise, from which on a model may have too much of something.
FAR = 10.0
#: Recorded time in which that is looked into, s.
LOOKED_AT_S = 2.0 * FITTING_S
#: What delays an answer, by name.
DELAY = "command_delay"
DELAYS = (DELAY, "actuator_lag")


@dataclass(frozen=True, kw_only=True)
class RolloutsAndAnswers:
    """Rollouts and answers to steps as one least-squares problem.

    Attributes:
        rollouts: Open-loop predictions.
        late_s: By how much later than predicted without a delay each answer comes, s, shape (A,):
            of what else is fitted, it hardly depends, and by jumps from sample to sample.
        units: Of the rollouts' residual, and of the answers, s.
    """

    rollouts: Problem
    late_s: Array
    units: tuple[float, float]

    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns what each candidate leaves of both, weighted alike, (candidates, N + A)."""
        rollouts = self.rollouts.residuals(candidates) / self.units[0]
        left_s = [self.late_s - _delay_s(effects) for effects in candidates]
        answers = np.stack([bounded(one / self.units[1], OUTLYING) for one in left_s])
        both = rollouts, answers
        return np.concatenate([one / np.sqrt(max(one.shape[1], 1)) for one in both], axis=1)

    def of_rollouts(self, fitted: Fit) -> Fit:
        """Returns a fit to both as one to the rollouts: their rows, in their units."""
        rows = slice(self.rollouts.slices()[-1].stop)
        size = self.units[0] * np.sqrt(rows.stop)
        residual = size * fitted.residual[rows]
        return replace(
            fitted,
            residual=residual,
            jacobian=size * fitted.jacobian[rows],
            cost=mean_square(residual),
        )

    def coarse(self) -> RolloutsAndAnswers:
        """Returns the problem with rollouts by fast integration."""
        return replace(self, rollouts=self.rollouts.coarse())

    def without_own(
        self, keys: Collection[Key]
    ) -> tuple[RolloutsAndAnswers, tuple[EffectInstance, ...]]:
        """Returns both, of models without what they say under `keys`, and what that is."""
        rollouts, own = without_own(self.rollouts, keys)
        return replace(self, rollouts=rollouts), own


def _delay_s(effects: Sequence[EffectInstance]) -> float:
    return sum(e.values["delay"] for e in effects if e.effect.name == DELAY)


def too_much(
    problem: Problem,
    long: Problem,
    short: Problem,
    recordings: Sequence[Trajectory],
    fitted: Fit,
    in_stretches: Collection[tuple[object, ...]] = (),
) -> Round | None:
    """Returns a round in which the model was found to have too much of something, or none.

    Without a delay it has to leave far less. With one that answers to steps show, rollouts may
    leave a little more, both witnesses together less: answers decide where rollouts hardly tell.

    Args:
        problem: Rollouts to which the effects were fitted.
        long: Those of them in which everything acts at any time.
        short: Short ones, in which what the model itself says is looked into.
        recordings: All recordings of the problem.
        fitted: What was found, by rollouts alone.
        in_stretches: Keys of what acts now and then only: it is held as it is.
    """
    if any(e.effect.separates_motor for e in fitted.effects):
        return None
    held = tuple(e for e in fitted.effects if e.key in in_stretches)
    effects = tuple(e for e in fitted.effects if e not in held)
    long, short = (replace(p, given=(*p.given, *held)) for p in (long, short))
    answers, late_s, delay = _heard(long, recordings, effects)
    short = settled(short.subset(short.sample(LOOKED_AT_S)), effects).robust(effects)
    begun = _restated(_witnesses(short, late_s, effects), effects, delay)
    if begun is None:
        return None
    long = settled(long, effects).robust(effects)
    both = _witnesses(long, late_s, effects)
    known = {e.key for e in (*effects, *delay)}
    together = _refitted(both, begun, [e.key for e in begun if e.key not in known])
    before, after = np.mean(both.residuals([effects, together]) ** 2, axis=1)
    left = float(after / before)
    told = measured(problem, _in_order((*held, *together), fitted.effects))
    new = len({e.key for e in together} - {e.key for e in effects})
    if not new or left > _at_most(delay) or told.cost > CLOSE_CALL * fitted.cost:
        return None
    return Round(
        before=fitted.cost,
        screened=(),
        fits=(replace(told, cost=left * fitted.cost),),
        accepted=told,
        together=new if new > 1 else 0,
        restated=True,
        late_s=(late_s, answers.late_s([together])[0]) if delay else None,
    )


def _in_order(
    effects: Sequence[EffectInstance], found: Sequence[EffectInstance]
) -> tuple[EffectInstance, ...]:
    """Returns effects as they were found before, and behind them what is new."""
    keys = [e.key for e in found]
    return tuple(sorted(effects, key=lambda e: keys.index(e.key) if e.key in keys else len(keys)))


def _heard(
    problem: Problem, recordings: Sequence[Trajectory], effects: Sequence[EffectInstance]
) -> tuple[Answers, Array, tuple[EffectInstance, ...]]:
    """Returns answers to steps, by how much they come late, s, (A,), and the delay they show.

    None of either where they show none, or one was found already.
    """
    answers = find_answers(problem, recordings)
    late_s = answers.late_s([effects])[0]
    common_s = dead_time(late_s, answers.by_joint)
    if common_s is None or any(e.effect.name in DELAYS for e in effects):
        return answers, late_s[:0], ()
    delay = EffectInstance(
        effect=find_effect(DELAY), joints=problem.driven, values={"delay": common_s}
    )
    return answers, late_s, (delay,)


def _at_most(delay: Sequence[EffectInstance]) -> float:
    """Returns the share of both witnesses that may be left: answers to steps speak for a delay."""
    return 1.0 - LEAST_GAIN if delay else FAR_LESS


def _witnesses(
    problem: Problem, late_s: Array, effects: Sequence[EffectInstance]
) -> RolloutsAndAnswers:
    """Returns both witnesses, in units of what `effects` leave."""
    left = float(np.sqrt(mean_square(problem.residuals([effects])[0])))
    late = float(np.median(np.abs(late_s))) if len(late_s) else 1.0
    return RolloutsAndAnswers(rollouts=problem, late_s=late_s, units=(left, late))


def _restated(
    both: RolloutsAndAnswers, fitted: Sequence[EffectInstance], delay: Sequence[EffectInstance]
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
        effects = _needed(bare, tried, own, stay)
        before_that, doubted = doubted, [e.key for e in effects[stay:]]
        if len(doubted) == len(before_that):
            break
    bare, own = both.without_own(doubted)
    whole = measured(bare.rollouts, with_own(effects, own))
    new = [e.key for e in (*delay, *own)]
    return beside_own(without_superfluous(bare.rollouts, whole, new).effects, own)


def _needed(
    bare: RolloutsAndAnswers, fitted: Fit, own: Sequence[EffectInstance], stay: int
) -> tuple[EffectInstance, ...]:
    """Returns the effects, beside what the model says, without what it does not have too much of.

    Nor what explains too little. The first `stay` are not judged.
    """
    earned = beside_own(earning(bare.rollouts, bare.of_rollouts(fitted), stay, own), own)
    return (*earned[:stay], *(e for e in earned[stay:] if e.takes_off))


def _refitted(
    both: RolloutsAndAnswers, begun: Sequence[EffectInstance], doubted: Collection[Key]
) -> tuple[EffectInstance, ...]:
    """Returns effects fitted to both witnesses, which may take off what the model has.

    Without those of `doubted`, the last of them, that explain too little there.
    """
    bare, own = both.without_own([e.key for e in begun])
    found = fit(bare, with_own(begun, own))
    stay = len(begun) - len(doubted)
    left = _needed(bare, found, own, stay)
    if len(left) == len(begun):
        return left
    return _refitted(both, left, [e.key for e in left[stay:]])
