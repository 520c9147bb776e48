"""Hypotheses over several sets of recordings: which amounts they have in common.

Every set is first explained by itself, by the same effects. To first order around that, what all
sets leave together if they share an amount is linear algebra; what is decided is decided by
rollouts. An amount that differs between sets has to earn that like an effect earns its name:
without it, the sets have to be predicted clearly worse. Where a model is wrong in all sets alike,
it is wrong with the amounts that they share, too, and nothing is gained by amounts of their own.

Shape letters: K sets, P parameters, M free numbers of a hypothesis, N numbers of all residuals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import amounts, bounds_of, with_amounts
from gfm.diagnosis.inference.blocks import Blocks, SegmentShape, blocks_of
from gfm.diagnosis.inference.fitting import FIT_STEPS, FIT_TOLERANCE, Fit, derivatives
from gfm.diagnosis.inference.intervals import standard_errors
from gfm.diagnosis.inference.score import Difference, Predictive, difference, predictive
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.naming import describe
from gfm.effects import EffectInstance

#: Singular values below this share of the largest tell nothing.
NEGLIGIBLE = 1e-6


class Course(StrEnum):
    """How an effect's amounts go on from set to set."""

    REPEATS = "repeats"
    DRIFTS = "drifts"
    CHANGES = "changes"


@dataclass(frozen=True, kw_only=True, eq=False)
class OverSets:
    """A hypothesis over all sets.

    Attributes:
        sets: The sets.
        courses: Of each effect.
        fit: The effects of all sets, set by set, with the derivatives by all their amounts, as if
            no set shared any: shape (N, K P).
    """

    sets: Sets
    courses: tuple[Course, ...]
    fit: Fit

    @cached_property
    def predictive(self) -> Predictive:
        """How well it predicts each part of the data from the others."""
        shared = replace(self.fit, jacobian=self.fit.jacobian @ self.sets.design(self.courses))
        return predictive(self.sets.blocks, shared)

    def over(self, other: OverSets) -> Difference:
        """Returns by how much it predicts better than another one."""
        return difference(self.sets.blocks, self.predictive, other.predictive)


@dataclass(frozen=True, kw_only=True, eq=False)
class Sets:
    """The same effects, fitted to every set by itself.

    Attributes:
        problems: Of each set, initial states settled.
        fits: Of each set, all with the same effects.
    """

    problems: tuple[Problem, ...]
    fits: tuple[Fit, ...]

    @property
    def effects(self) -> tuple[EffectInstance, ...]:
        """The effects, with the amounts of the last set."""
        return self.fits[-1].effects

    @cached_property
    def blocks(self) -> Blocks:
        """How the residual of all sets is divided."""
        limits = np.concatenate([problem.limits() for problem in self.problems])
        return blocks_of(self.layout(), len(self.problems[0].joints), limits)

    def layout(self) -> list[SegmentShape]:
        """Returns what each segment's numbers are.

        Each set has parts of its own, recordings or every other segment: what one set says can be
        predicted from what is left of it.
        """
        shapes: list[SegmentShape] = []
        for k, problem in enumerate(self.problems):
            several = len({s.recording for s in problem.segments}) > 1
            for i, shape in enumerate(problem.layout()):
                part = shape.recording if several else i % 2
                shapes.append(shape._replace(recording=part * len(self.problems) + k))
        return shapes

    def apart(self) -> OverSets:
        """Returns the hypothesis that every set has amounts of its own."""
        effects = tuple(chain.from_iterable(one.effects for one in self.fits))
        residual = np.concatenate([one.residual for one in self.fits])
        jacobian = self._derivatives(effects, residual)
        fit = Fit(effects=effects, jacobian=jacobian, residual=residual)
        return OverSets(sets=self, courses=(Course.CHANGES,) * len(self.effects), fit=fit)

    def simplest(self, here: OverSets, report: Callable[[str], None]) -> OverSets:
        """Returns the simplest hypothesis that none predicts clearly better than.

        First with one step to every simpler one; what then still differs has to do so against
        those that were fitted in earnest.
        """
        for steps in (1, FIT_STEPS):
            here = here if steps == 1 else self._fitted(here, here.courses, steps)
            while (simpler := next(self._simpler(here, steps, report), None)) is not None:
                here = simpler
        return here

    def alone(self, here: OverSets, effect: int) -> tuple[Array, Array]:
        """Returns one effect's amounts in every set, and their standard errors, if only it differs.

        Both of shape (K, its parameters); errors are infinite where a set does not show it.
        """
        courses = (*here.courses[:effect], Course.CHANGES, *here.courses[effect + 1 :])
        other, design = self._nearby(here, courses).fit, self.design(courses)
        values = amounts(other.effects)
        numbers = np.asarray(np.linalg.lstsq(design, values, rcond=None)[0], np.float64)
        parts = chain.from_iterable(problem.slices() for problem in self.problems)
        ends = np.cumsum([0, *(part.stop - part.start for part in parts)]).tolist()
        segments = [slice(a, b) for a, b in pairwise(ends)]
        errors = standard_errors(numbers, other.jacobian @ design, other.residual, segments)
        own = self._places(effect)
        return values[own], errors[design[own].argmax(axis=2)]

    def seen(self, here: OverSets, effect: int, none: float) -> tuple[bool, ...]:
        """Returns whether each set would show if an effect's first amount were `none` there.

        To first order, by the score.
        """
        fit, values = here.fit, amounts(here.fit.effects)
        told = []
        for place in self._places(effect)[:, 0]:
            left = fit.residual + fit.jacobian[:, place] * (none - values[place])
            apart = here.over(replace(here, fit=replace(fit, residual=left)))
            told.append(apart._replace(nats=abs(apart.nats)).clear)
        return tuple(told)

    def _simpler(
        self, here: OverSets, steps: int, report: Callable[[str], None]
    ) -> Iterator[OverSets]:
        """Yields what predicts as well with one effect simpler, that first which says least."""
        between = Course.DRIFTS if len(self.problems) > 2 else Course.REPEATS
        others = []
        for i, course in enumerate(here.courses):
            if course is not Course.REPEATS:
                less = between if course is Course.CHANGES else Course.REPEATS
                courses = (*here.courses[:i], less, *here.courses[i + 1 :])
                others.append((here.over(self._nearby(here, courses)).errors, i, courses))
        for _, i, courses in sorted(others):
            if steps > 1:
                report(f"does {describe(self.effects[i])} differ between sets?")
            other = self._fitted(here, courses, steps)
            if not here.over(other).clear:
                yield other

    def _fitted(self, here: OverSets, courses: tuple[Course, ...], steps: int) -> OverSets:
        """Returns another hypothesis, fitted by so many Gauss-Newton steps at most."""
        near = self._nearby(here, courses)
        own = [p.residuals([part])[0] for p, part in self._of_sets(near.fit.effects)]
        fit = replace(near.fit, residual=np.concatenate(own))
        if courses == here.courses and 1.0 - fit.cost / here.fit.cost < FIT_TOLERANCE:
            return here
        if steps == 1:
            return replace(near, fit=fit)
        fit = replace(fit, jacobian=self._derivatives(fit.effects, fit.residual))
        return self._fitted(replace(near, fit=fit), courses, steps - 1)

    def _nearby(self, here: OverSets, courses: tuple[Course, ...]) -> OverSets:
        """Returns another hypothesis as it fits best, to first order around one."""
        fit, values, design = here.fit, amounts(here.fit.effects), self.design(courses)
        numbers = np.linalg.lstsq(design, values, rcond=None)[0]
        left = fit.residual + fit.jacobian @ (design @ numbers - values)
        columns = fit.jacobian @ design
        size = np.linalg.norm(columns, axis=0) + 1e-9
        numbers -= np.linalg.lstsq(columns / size, left, rcond=NEGLIGIBLE)[0] / size
        moved = np.clip(design @ numbers, *bounds_of(fit.effects))
        left = fit.residual + fit.jacobian @ (moved - values)
        near = replace(fit, effects=with_amounts(fit.effects, moved), residual=left)
        return OverSets(sets=self, courses=courses, fit=near)

    def _of_sets(
        self, effects: tuple[EffectInstance, ...]
    ) -> list[tuple[Problem, tuple[EffectInstance, ...]]]:
        """Returns each set's problem and its part of the effects of all sets."""
        count = len(self.effects)
        return [(p, effects[k * count : (k + 1) * count]) for k, p in enumerate(self.problems)]

    def _derivatives(self, effects: tuple[EffectInstance, ...], residual: Array) -> Array:
        """Returns the derivatives of all residuals by all amounts, shape (N, K P)."""
        parts = np.split(residual, np.cumsum([len(one.residual) for one in self.fits])[:-1])
        rows = zip(self._of_sets(effects), parts, strict=True)
        return np.asarray(block_diag(*(derivatives(*own, left) for own, left in rows)))

    def _places(self, effect: int) -> NDArray[np.intp]:
        """Returns where an effect's amounts are among all, shape (K, its parameters)."""
        owners = self.fits[-1].owners
        sets = len(owners) * np.arange(len(self.problems))
        return np.asarray(sets[:, None] + np.flatnonzero(owners == effect))

    def design(self, courses: Sequence[Course]) -> Array:
        """Returns how the amounts of all sets follow from the free numbers, shape (K P, M)."""
        sets = len(self.problems)
        shapes = {
            Course.REPEATS: np.ones((sets, 1)),
            Course.DRIFTS: np.stack([np.ones(sets), np.linspace(-1.0, 1.0, sets)], axis=1),
            Course.CHANGES: np.eye(sets),
        }
        owners = self.fits[-1].owners
        each = np.eye(len(owners))[:, :, None]
        return np.hstack(
            [np.kron(shapes[courses[i]], e) for i, e in zip(owners, each, strict=True)]
        )
