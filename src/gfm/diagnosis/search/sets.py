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
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import (
    FIT_STEPS,
    FIT_TOLERANCE,
    Fit,
    amounts,
    bounds_of,
    derivatives,
    free_parameters,
    mean_square,
    with_amounts,
)
from gfm.diagnosis.inference.intervals import standard_errors
from gfm.diagnosis.inference.score import (
    Blocks,
    Predictive,
    SegmentShape,
    blocks_of,
    difference,
    predictive,
)
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
        courses: Of each effect.
        amounts: Of each set, shape (K, P).
        residuals: Of each set.
        columns: Their derivatives by the set's amounts, (N of the set, P) each.
        predictive: How well it predicts each part of the data from the others.
    """

    courses: tuple[Course, ...]
    amounts: Array
    residuals: tuple[Array, ...]
    columns: tuple[Array, ...]
    predictive: Predictive


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
    def owner(self) -> Array:
        """The effect to which each parameter belongs, shape (P,)."""
        return np.array([i for i, _ in free_parameters(self.effects)], dtype=int)

    @property
    def joints(self) -> tuple[str, ...]:
        """The measured joints."""
        return self.problems[0].joints

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

    @cached_property
    def blocks(self) -> Blocks:
        """How the residual of all sets is divided."""
        return blocks_of(self)

    def limits(self) -> Array | None:
        """Returns beyond what numbers count less in a fit, shape (N,)."""
        own = [problem.limits() for problem in self.problems]
        rows = zip(own, self.fits, strict=True)
        return np.concatenate(
            [np.full_like(f.residual, np.inf) if x is None else x for x, f in rows]
        )

    def slices(self) -> list[slice]:
        """Returns where each segment's numbers lie in the residual of all sets."""
        rows, start = [], 0
        for problem in self.problems:
            own = problem.slices()
            rows += [slice(start + one.start, start + one.stop) for one in own]
            start += own[-1].stop
        return rows

    def apart(self) -> OverSets:
        """Returns the hypothesis that every set has amounts of its own."""
        return self._told(
            (Course.CHANGES,) * len(self.effects),
            np.stack([amounts(one.effects) for one in self.fits]),
            tuple(one.residual for one in self.fits),
            tuple(
                derivatives(problem, one.effects, one.residual)
                for problem, one in zip(self.problems, self.fits, strict=True)
            ),
        )

    def simplest(self, here: OverSets, report: Callable[[str], None]) -> OverSets:
        """Returns the simplest hypothesis that none predicts clearly better than.

        First with one step to every simpler one; what then still differs has to do so against
        those that were fitted in earnest.
        """
        for steps in (1, FIT_STEPS):
            here = here if steps == 1 else self.fitted(here, here.courses, steps)
            while (simpler := next(self._simpler(here, steps, report), None)) is not None:
                here = simpler
        return here

    def _simpler(
        self, here: OverSets, steps: int, report: Callable[[str], None]
    ) -> Iterator[OverSets]:
        """Yields what predicts as well with one effect simpler, that first which says least."""
        others = []
        for i, course in enumerate(here.courses):
            if course is not Course.REPEATS:
                courses = (*here.courses[:i], self._simplified(course), *here.courses[i + 1 :])
                _, _, linear = self._step(here, courses)
                others.append((difference(self.blocks, here.predictive, linear).errors, i, courses))
        for _, i, courses in sorted(others):
            if steps > 1:
                report(f"does {describe(self.effects[i])} differ between sets?")
            other = self.fitted(here, courses, steps)
            if not difference(self.blocks, here.predictive, other.predictive).clear:
                yield other

    def _simplified(self, course: Course) -> Course:
        between = course is Course.CHANGES and len(self.problems) > 2
        return Course.DRIFTS if between else Course.REPEATS

    def fitted(self, here: OverSets, courses: tuple[Course, ...], steps: int) -> OverSets:
        """Returns another hypothesis, fitted by so many Gauss-Newton steps at most."""
        best = here if courses == here.courses else None
        for step in range(steps):
            values = self._step(best or here, courses)[0]
            effects = [with_amounts(self.effects, row) for row in values]
            rows = list(zip(self.problems, effects, strict=True))
            residuals = tuple(problem.residuals([one])[0] for problem, one in rows)
            before = np.inf if best is None else _cost(best.residuals)
            if _cost(residuals) > (1.0 - FIT_TOLERANCE) * before:
                break
            columns = (best or here).columns
            if step + 1 < steps:
                columns = tuple(
                    derivatives(*row, left) for row, left in zip(rows, residuals, strict=True)
                )
            best = self._told(courses, values, residuals, columns)
        assert best is not None
        return best

    def alone(self, here: OverSets, effect: int) -> tuple[Array, Array]:
        """Returns one effect's amounts in every set, and their standard errors, if only it differs.

        Both of shape (K, its parameters); errors are infinite where a set does not show it.
        """
        changes = Course.CHANGES
        courses = (*here.courses[:effect], changes, *here.courses[effect + 1 :])
        values, numbers, _ = self._step(here, courses)
        design, jacobian = self._design(courses), self._jacobian(here.columns, courses)
        moved = np.concatenate(
            [r + c @ (v - a) for r, c, v, a in zip(*_rows(here), values, here.amounts, strict=True)]
        )
        errors = standard_errors(numbers, jacobian, moved, self.slices())
        own = np.flatnonzero(self.owner == effect)
        places = [[int(np.flatnonzero(design[k, p])[0]) for p in own] for k in range(len(values))]
        return values[:, own], errors[places]

    def seen(self, here: OverSets, effect: int, none: float) -> tuple[bool, ...]:
        """Returns whether each set would show if an effect's first amount were `none` there.

        To first order, by the score.
        """
        first = int(np.flatnonzero(self.owner == effect)[0])
        told = []
        for k, column in enumerate(here.columns):
            residuals = list(here.residuals)
            residuals[k] = residuals[k] + column[:, first] * (none - here.amounts[k, first])
            other = self._predictive(np.concatenate(residuals), here.columns, here.courses)
            apart = difference(self.blocks, here.predictive, other)
            told.append(apart._replace(nats=abs(apart.nats)).clear)
        return tuple(told)

    def _told(
        self,
        courses: tuple[Course, ...],
        values: Array,
        residuals: tuple[Array, ...],
        columns: tuple[Array, ...],
    ) -> OverSets:
        return OverSets(
            courses=courses,
            amounts=values,
            residuals=residuals,
            columns=columns,
            predictive=self._predictive(np.concatenate(residuals), columns, courses),
        )

    def _predictive(
        self, residual: Array, columns: Sequence[Array], courses: Sequence[Course]
    ) -> Predictive:
        jacobian = self._jacobian(columns, courses)
        cost = mean_square(residual)
        told = Fit(effects=self.effects, cost=cost, jacobian=jacobian, residual=residual)
        return predictive(self.blocks, told)

    def _step(self, here: OverSets, courses: Sequence[Course]) -> tuple[Array, Array, Predictive]:
        """Returns amounts (K, P), free numbers (M,) and prediction of a simpler hypothesis.

        To first order around another one.
        """
        design = self._design(courses)
        many = design.shape[2]
        first = np.linalg.lstsq(design.reshape(-1, many), here.amounts.ravel(), rcond=None)[0]
        jacobian = self._jacobian(here.columns, courses)
        away = np.concatenate(
            [
                r + c @ (row - a)
                for r, c, row, a in zip(*_rows(here), design @ first, here.amounts, strict=True)
            ]
        )
        size = np.linalg.norm(jacobian, axis=0) + 1e-9
        change = np.linalg.lstsq(jacobian / size, -away, rcond=NEGLIGIBLE)[0] / size
        low, high = bounds_of(self.effects)
        values = np.clip(design @ (first + change), low, high)
        told = self._predictive(away + jacobian @ change, here.columns, courses)
        return values, first + change, told

    def _design(self, courses: Sequence[Course]) -> Array:
        """Returns how amounts follow from the free numbers, shape (K, P, M)."""
        sets, own = len(self.problems), len(self.owner)
        middle = np.linspace(-1.0, 1.0, sets)
        shapes = {
            Course.REPEATS: np.ones((sets, 1)),
            Course.DRIFTS: np.stack([np.ones(sets), middle], axis=1),
            Course.CHANGES: np.eye(sets),
        }
        columns = []
        for p, effect in enumerate(self.owner):
            for shape in shapes[courses[effect]].T:
                column = np.zeros((sets, own))
                column[:, p] = shape
                columns.append(column)
        return np.stack(columns, axis=2)

    def _jacobian(self, columns: Sequence[Array], courses: Sequence[Course]) -> Array:
        """Returns the derivative of all residuals by the free numbers, shape (N, M)."""
        rows = zip(columns, self._design(courses), strict=True)
        return np.concatenate([own @ design for own, design in rows])


def _rows(here: OverSets) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    return here.residuals, here.columns


def _cost(residuals: Sequence[Array]) -> float:
    return mean_square(np.concatenate(residuals))
