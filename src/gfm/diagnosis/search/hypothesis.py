"""A hypothesis: effects with their amounts, and how well they predict."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic

import numpy as np
from typing_extensions import TypeVar

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import amounts
from gfm.diagnosis.inference.constants import INEXACT_SHARE
from gfm.diagnosis.inference.fitting import (
    ROUGH,
    Fit,
    by_simplex,
    fit,
    mean_square,
    measured,
    without_some,
)
from gfm.diagnosis.inference.score import (
    Difference,
    Predictive,
    difference,
    predictive,
    room,
    room_by_joint,
)
from gfm.diagnosis.residuals.problem import Problem, unsettled
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.effects import EffectInstance

P = TypeVar("P", bound=SegmentedProblem)
Of = TypeVar("Of", bound=SegmentedProblem, covariant=True, default=SegmentedProblem)
#: Times that initial states and amounts are looked for in turn at most, and the share of what was
#: left that one turn may leave for another.
IN_TURN, TURN_LEAVES = 4, 0.9
#: Mean square from which on first order says little: initial states, too, may be held back by a
#: model that was wrong.
FAR_OFF = 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Hypothesis(Generic[Of]):
    """Effects that were fitted to a problem.

    Attributes:
        problem: Whose residual it is.
        fit: The effects.
        nominal: Mean square that the nominal model leaves on each joint, in units of the noise,
            shape (J,).
    """

    problem: Of
    fit: Fit
    nominal: Array

    @property
    def effects(self) -> tuple[EffectInstance, ...]:
        """The effects with their amounts."""
        return self.fit.effects

    @cached_property
    def predictive(self) -> Predictive:
        """How well it predicts each part of the data from the others."""
        return predictive(self.problem.blocks, self.fit)

    @cached_property
    def room(self) -> Difference:
        """By how much any other hypothesis could predict better at most."""
        return room(self.problem.blocks, self.predictive)

    @property
    def is_open(self) -> bool:
        """Whether something can still be gained that is visible beside the discrepancy."""
        return bool(self.open_joints)

    def over(self, other: Fit) -> Difference:
        """Returns by how much it predicts better than another fit to the same residual."""
        blocks = self.problem.blocks
        return difference(blocks, self.predictive, predictive(blocks, other))

    def over_less(self, gone: Sequence[Collection[int]]) -> list[Difference]:
        """Returns by how much it predicts better than without some effects each, by number."""
        return [self.over(one) for one in without_some(self.problem, self.fit, gone)]

    def fitted(self, effects: Sequence[EffectInstance]) -> Fit:
        """Returns other effects, fitted to the same residual well enough to be compared.

        What effects they have in common change of it is known.
        """
        return fit(self.problem, effects, tolerance=ROUGH, known=self.fit)

    def fitted_out(self, begun: Fit) -> Fit:
        """Returns a fit from initial states of its own, if that leaves less.

        Those of the problem suit what was found before, and among close rivals that which changes
        least beside it.
        """
        own: SegmentedProblem = self.problem
        best = begun
        for _ in range(IN_TURN):
            there = own.settled(best.effects)
            if there.segments == own.segments:
                return best
            other = fit(there, best.effects)
            if other.cost > TURN_LEAVES * best.cost:
                return min(best, other, key=lambda f: f.cost)
            own, best = there, other
        return best

    @cached_property
    def open_joints(self) -> tuple[str, ...]:
        """Joints on which something can still be gained that is visible beside the discrepancy.

        More than laws that explain the rest leave by not being quite exact. None where all of them
        together leave too little for any difference to be clear.
        """
        if not self.room.visible:
            return ()
        joints = self.problem.joints
        exact = INEXACT_SHARE * (self.nominal - 1.0)
        inexact = self.problem.joint_costs(self.fit.residual) - 1.0 > exact
        rooms = room_by_joint(self.problem.blocks, self.predictive, len(joints))
        rows = zip(joints, rooms, inexact, strict=True)
        return tuple(joint for joint, left, more in rows if left.clear and more)


def nominal_hypothesis(problem: P) -> Hypothesis[P]:
    """Returns the hypothesis that the model lacks nothing."""
    fitted = measured(problem, ())
    return Hypothesis(problem=problem, fit=fitted, nominal=problem.joint_costs(fitted.residual))


def parameters_of(effects: Sequence[EffectInstance], fitted: Fit) -> int:
    """Returns how many numbers some effects of a fit have.

    One that is nothing to within its own standard error is none: a robot that moves in a plane
    knows nothing of gravity across it. A number of periods, found among many, counts too.
    """
    left = np.sqrt(fitted.cost)
    told = np.abs(amounts(fitted.effects)) * np.linalg.norm(fitted.jacobian, axis=0) > left
    owners = [fitted.effects[i].key for i in fitted.owners]
    keys = {e.key for e in effects}
    seen = sum(bool(shows) for key, shows in zip(owners, told, strict=True) if key in keys)
    return seen + sum(len(e.effect.fixed) for e in effects)


def settled_hypothesis(
    problem: Problem, effects: Sequence[EffectInstance], nominal: Array
) -> Hypothesis[Problem]:
    """Returns effects fitted to a problem whose initial states suit them.

    States and amounts are looked for in turn. Where much is left, the states that suited what was
    found before may be the reason: those measured are tried, too.
    """
    problem = with_suitable_steps(problem, effects)
    there, found = in_turn(problem, effects)
    if found.cost > FAR_OFF and any(s.measured is not None for s in there.segments):
        begun = unsettled(there, found.effects)
        again = in_turn(begun, fit(begun, found.effects).effects)
        there, found = min((there, found), again, key=_unbounded)
    return Hypothesis(problem=there, fit=found, nominal=nominal)


def _unbounded(found: tuple[Problem, Fit]) -> float:
    """Returns the cost of a fit to a problem if what is outlying counts in full."""
    return mean_square(found[0].plain().residuals([found[1].effects])[0])


def in_turn(problem: P, effects: Sequence[EffectInstance]) -> tuple[P, Fit]:
    """Returns initial states and amounts, each looked for anew where the other was found.

    Where nothing of a problem is free, amounts alone.
    """
    before = np.inf
    for _ in range(IN_TURN):
        begun, problem = problem, problem.settled(effects).robust(effects)
        found = fit(problem, effects)
        left = room(problem.blocks, predictive(problem.blocks, found))
        if left.clear:
            found = by_simplex(problem, found)
        effects = found.effects
        if problem is begun or found.cost > TURN_LEAVES * before or not left.clear:
            break
        before = found.cost
    return problem, found
