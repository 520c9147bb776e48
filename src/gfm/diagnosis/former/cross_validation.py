"""Whether effects hold for recordings that they were not fitted to.

While much stays unexplained, a model that is wrong anyway can be bent to fit what it was fitted to.
What is missing in truth helps everywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import FITTING_S, LEAST_GAIN, ROUGH, Fit, fit, without_each
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.naming import describe
from gfm.effects import EffectInstance

#: Parts into which recordings are divided.
FOLDS = 2
#: Cost elsewhere without an effect, to first order, as a multiple of that with it, beyond which its
#: being needed is not looked into.
HARDLY = 1.2


@dataclass(frozen=True, kw_only=True)
class Fold:
    """One part of the recordings.

    Attributes:
        own: Problem of each of its recordings.
        others: Problem of the recordings of all other parts.
    """

    own: tuple[Problem, ...]
    others: Problem

    def fitted(self, effects: Sequence[EffectInstance]) -> Fit:
        """Returns `effects` with amounts from the other recordings."""
        return fit(self.others, effects, tolerance=ROUGH)

    def sums(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns the candidates' sums of squares, shape (own recordings, candidates, J)."""
        return np.stack([_sums(problem, candidates) for problem in self.own])


def folds_of(problem: Problem) -> list[Fold]:
    """Returns the parts of a problem's recordings; none where there is one recording only."""
    recordings = sorted({s.recording for s in problem.segments})
    parts = [recordings[fold::FOLDS] for fold in range(FOLDS)] if len(recordings) >= FOLDS else []
    return [_fold(problem, part) for part in parts]


def _fold(problem: Problem, recordings: Collection[int]) -> Fold:
    places = list(enumerate(problem.segments))
    others = problem.subset([i for i, s in places if s.recording not in recordings])
    return Fold(
        own=tuple(
            problem.subset([i for i, s in places if s.recording == recording])
            for recording in recordings
        ),
        others=others.subset(others.sample(FITTING_S)),
    )


def _sums(problem: Problem, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
    residuals = problem.residuals(candidates)
    joints = len(problem.joints)
    return np.asarray([(one.reshape(-1, joints) ** 2).sum(axis=0) for one in residuals])


def _on(problem: Problem, effect: EffectInstance) -> list[int]:
    """Returns the joints on which an effect acts: all, where it has none."""
    return [problem.joints.index(name) for name in effect.joints or problem.joints]


def holds_elsewhere(
    problem: Problem, base: Sequence[EffectInstance], effects: Sequence[EffectInstance]
) -> bool:
    """Returns whether `effects` explain more than `base` on recordings they are not fitted to.

    Where the newest of them acts: in all, and in more recordings than not. One recording in which
    something else happened (a stop, a collision) is no reason to be wrong about the others.
    """
    folds = folds_of(problem)
    if not folds:
        return True
    where = _on(problem, effects[-1])
    rows = [fold.sums([fold.fitted(e).effects for e in (base, effects)]) for fold in folds]
    before, after = np.concatenate(rows)[..., where].sum(axis=-1).T
    helped = after < (1.0 - LEAST_GAIN) * before
    harmed = after > (1.0 + LEAST_GAIN) * before
    less = after.sum() < (1.0 - LEAST_GAIN) * before.sum()
    return bool(less and helped.sum() >= harmed.sum())


def what_holds(
    problem: Problem,
    effects: Sequence[EffectInstance],
    kept: Collection[tuple[object, ...]] = (),
    report: Callable[[str], None] = lambda _: None,
) -> tuple[EffectInstance, ...]:
    """Returns the effects that explain something on recordings that they are not fitted to.

    One after the other is taken out without which the others do as well elsewhere, that first
    without which they do best. Those with the keys in `kept` stay, and so does the last.
    """
    folds, needed = folds_of(problem), {*kept}
    if not folds or len(effects) < 2:
        return tuple(effects)
    fits = [fold.fitted(effects) for fold in folds]
    while (doubtful := _least_needed(folds, fits, needed)) is not None:
        report(f"testing {describe(doubtful)} on other recordings")
        rests = [[e for e in f.effects if e.key != doubtful.key] for f in fits]
        without = [fold.fitted(rest) for fold, rest in zip(folds, rests, strict=True)]
        pairs = [(f.effects, other.effects) for f, other in zip(fits, without, strict=True)]
        if _ratios(folds, pairs, [doubtful])[0] < 1.0 + LEAST_GAIN:
            # What stood for it, or against it, may be needed no more.
            fits, needed = without, {*kept}
        else:
            needed.add(doubtful.key)
    left = {e.key for e in fits[0].effects}
    return tuple(e for e in effects if e.key in left)


def _least_needed(
    folds: Sequence[Fold], fits: Sequence[Fit], needed: Collection[tuple[object, ...]]
) -> EffectInstance | None:
    """Returns the effect that explains least elsewhere, to first order; None if it explains much.

    The others make up for it as far as they can.
    """
    effects = fits[0].effects
    if len(effects) < 2:
        return None
    pairs = zip(folds, fits, strict=True)
    sets = [(f.effects, *without_each(fold.others, f)) for fold, f in pairs]
    rows = zip(_ratios(folds, sets, effects), effects, strict=True)
    open_ = [(ratio, one) for ratio, one in rows if one.key not in needed and ratio < HARDLY]
    return min(open_, key=lambda pair: pair[0])[1] if open_ else None


def _ratios(
    folds: Sequence[Fold],
    sets: Sequence[Sequence[Sequence[EffectInstance]]],
    effects: Sequence[EffectInstance],
) -> list[float]:
    """Returns what is left elsewhere without each of `effects`, over what is left with all.

    On the joints on which it acts.

    Args:
        folds: Parts of the recordings.
        sets: For each of them, all effects, then those without each of `effects`.
        effects: Which ones.
    """
    sums = np.sum([fold.sums(s).sum(axis=0) for fold, s in zip(folds, sets, strict=True)], axis=0)
    problem = folds[0].others
    return [
        float(without[_on(problem, one)].sum() / sums[0, _on(problem, one)].sum())
        for one, without in zip(effects, sums[1:], strict=True)
    ]
