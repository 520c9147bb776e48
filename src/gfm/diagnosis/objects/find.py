"""Which effect of the object is missing: the few there are, by the search of the robot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import TypeAlias

import numpy as np

from gfm.diagnosis.inference.fitting import Fit, fit
from gfm.diagnosis.objects.problem import ObjectProblem
from gfm.diagnosis.search.hypothesis import Hypothesis, in_turn, nominal_hypothesis
from gfm.diagnosis.search.moves.add import beside, best_first
from gfm.diagnosis.search.steps import end, run
from gfm.diagnosis.search.trace import SearchResult, Step
from gfm.diagnosis.search.under_way import Search
from gfm.effects import Effect, EffectInstance, Scope, effect_library

Here: TypeAlias = Hypothesis[ObjectProblem]

#: What no pose depends on where the robot's motion is given, but for contacts that give way.
FELT = "object_mass"
#: An effect is seen where an amount that matters changes all residuals together by so much.
SEEN = 6.0
#: From one start of a fit to the next, in amounts that matter.
FAR = 2.0


def seen_and_unseen(problem: ObjectProblem) -> tuple[list[Effect], list[Effect]]:
    """Returns the effects of the object on which segments depend, and those on which not."""
    effects = [one for one in effect_library().values() if one.scope is Scope.OBJECT]
    seen = [one for one in effects if one.name != FELT and _is_seen(problem, one)]
    return seen, [one for one in effects if one not in seen]


def find(
    problem: ObjectProblem, seen: Sequence[Effect], report: Callable[[str], None]
) -> SearchResult[ObjectProblem]:
    """Returns which of some effects the object lacks."""

    def others(here: Here, known: Sequence[EffectInstance]) -> list[Fit]:
        new = [one for one in seen if one not in [e.effect for e in known]]
        starts = [_starts(problem, one) for one in new]
        return [here.fitted_out(_begun(problem, here.effects, some)) for some in starts]

    def one_more(before: Here, _: Search[ObjectProblem], _best: Step) -> Step:
        return best_first(before, [beside(before, one) for one in others(before, before.effects)])

    def two_more(before: Here, _: Search[ObjectProblem], best: Step) -> Step | None:
        """Where its mass lies and how it slides shape the same paths: one alone may mislead."""
        if best.chosen is not None:
            return None
        less = [one.new[0] for one in best.ranked if one.fit.cost < before.fit.cost]
        starts = [_starts_of_both(problem, *pair) for pair in combinations(less, 2)]
        fits = [before.fitted_out(_begun(problem, before.effects, some)) for some in starts]
        return best_first(before, [beside(before, one) for one in fits])

    def rivals(instance: EffectInstance, rest: Here, _: Search[ObjectProblem]) -> list[Fit]:
        return others(rest, (*rest.effects, instance))

    search = Search[ObjectProblem](report=report)
    return end(run(settled_with(problem, ()), search, [one_more, two_more]), search, rivals)


def settled_with(problem: ObjectProblem, effects: Sequence[EffectInstance]) -> Here:
    """Returns the hypothesis that the object lacks some effects, in the amounts that fit."""
    settled, fitted = in_turn(problem, effects)
    return replace(nominal_hypothesis(settled), fit=fitted)


def friction_cost(problem: ObjectProblem) -> float:
    """Returns what the object's friction leaves when it is fitted alone."""
    begun = _begun(problem, (), _starts(problem, effect_library()["object_friction"]))
    return in_turn(problem, begun.effects)[1].cost


def _begun(
    problem: ObjectProblem,
    there: Sequence[EffectInstance],
    starts: Sequence[Sequence[EffectInstance]],
) -> Fit:
    """Returns effects fitted beside others, from the best of some starts, segments as measured.

    Those that suited a model without them would hold them back.
    """
    begun = problem.based(there).robust(there)
    left = begun.residuals([(*there, *some) for some in starts])
    best = starts[int(np.argmin(np.sum(left**2, axis=1)))]
    return fit(begun, (*there, *best))


def _starts(problem: ObjectProblem, effect: Effect) -> list[list[EffectInstance]]:
    """Returns an effect in all amounts of a coarse grid: contacts are rough, and fits end early."""
    none = _none_of(effect)
    ways = product((-FAR, 0.0, FAR), repeat=len(none.values))
    grid = [
        {p: n * problem.sizes[p] for p, n in zip(none.values, way, strict=True)} for way in ways
    ]
    return [[replace(none, values=values)] for values in grid if effect.admissible(values)]


def _starts_of_both(
    problem: ObjectProblem, one: EffectInstance, other: EffectInstance
) -> list[list[EffectInstance]]:
    """Returns each of two effects as it was fitted alone, beside the other in all amounts."""
    first, second = (_starts(problem, each.effect) for each in (one, other))
    return [[one, other], *([one, *some] for some in second), *([*some, other] for some in first)]


def _none_of(effect: Effect) -> EffectInstance:
    return EffectInstance(effect=effect, joints=(), values={p.name: 0.0 for p in effect.parameters})


def _is_seen(problem: ObjectProblem, effect: Effect) -> bool:
    """Returns whether residuals depend on amounts of an effect that matter."""
    none = _none_of(effect)
    some = [replace(none, values={**none.values, p: problem.sizes[p]}) for p in none.values]
    without, *others = problem.based(()).residuals([(), *((one,) for one in some)])
    return max(float(np.linalg.norm(one - without)) for one in others) > SEEN
