"""The loop of every search: from one hypothesis to the next that predicts clearly better.

Moves propose steps; the best is taken, what became superfluous by it is removed, until what can
still be gained is not visible, nothing gains anything, or the time is over. In the end effects are
exchanged for what says more, and it is weighed what speaks for each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from typing import Generic, TypeAlias

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.constants import UNWEIGHED
from gfm.diagnosis.inference.fitting import acting, along_valley, always, each_left_out, measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.inference.steadiness import apart
from gfm.diagnosis.residuals.clock import Clock, OutOfTimeError
from gfm.diagnosis.residuals.outliers import slopes
from gfm.diagnosis.search.hypothesis import Hypothesis, P, columns_of
from gfm.diagnosis.search.moves.add import gain_of
from gfm.diagnosis.search.moves.reduce import (
    Compared,
    RivalsOf,
    exchange,
    gains_of_each,
    remove,
)
from gfm.diagnosis.search.naming import describe
from gfm.diagnosis.search.trace import Evidence, Step
from gfm.effects import EffectInstance, Key, Scope

#: Steps at most.
MOST_STEPS = 24


@dataclass(frozen=True, kw_only=True)
class Proposal(Generic[P]):
    """A step that a move proposes, and how to find the hypothesis after it."""

    step: Step
    after: Callable[[], Hypothesis[P]]


#: Proposes a step beside the best that others propose; None where it is not its turn.
MoveFrom: TypeAlias = Callable[[Hypothesis[P], Step | None], Proposal[P] | None]


@dataclass
class Search(Generic[P]):
    """A search under way.

    Attributes:
        report: Told what is happening, in words.
        in_time: Whether there is time left to weigh rivals.
        goes_on: Whether there is time left for steps.
        clock: Breaks off what takes too long.
        steps: So far.
        ended_early: Whether there was no time left for steps that might have gained something.
    """

    report: Callable[[str], None]
    in_time: Callable[[], bool] = lambda: True
    goes_on: Callable[[], bool] = lambda: True
    clock: Clock = field(default_factory=Clock)
    steps: list[Step] = field(default_factory=list)
    ended_early: bool = False

    @property
    def out_of_time(self) -> bool:
        """Whether more time might have led to another answer."""
        return self.ended_early or not self.in_time()

    @property
    def held(self) -> dict[Key, Difference]:
        """What a few segments judge, and by how much they predict better with it."""
        chosen = [step.chosen for step in self.steps if step.segments]
        return {one.new[0].key: one.gain for one in chosen if one is not None}

    def run(self, here: Hypothesis[P], moves: Sequence[MoveFrom[P]]) -> Hypothesis[P]:
        """Returns the best hypothesis that steps lead to, in time."""
        best = here
        try:
            with self._bounded():
                for after in self._steps(here, moves):
                    best = after
        except OutOfTimeError:
            self.report("the time is over")
        return best

    def _steps(self, here: Hypothesis[P], moves: Sequence[MoveFrom[P]]) -> Iterator[Hypothesis[P]]:
        """Yields one hypothesis after another."""
        while here.is_open and len(self.steps) < MOST_STEPS and self.goes_on():
            best = self._best(here, moves)
            if best is None:
                break
            if best.step.chosen is None:
                self.steps.append(best.step)
                break
            left, here = here.fit.cost, best.after()
            self.steps.append(best.step)
            self.report(f"{in_words(best.step)}: misfit {left:.3g} -> {here.fit.cost:.3g}")
            here, removed = remove(here, self.held, self.report)
            self.steps.extend(removed)
            yield here
        self.ended_early |= here.is_open and not self.goes_on()

    def _best(self, here: Hypothesis[P], moves: Sequence[MoveFrom[P]]) -> Proposal[P] | None:
        best: Proposal[P] | None = None
        for move in moves:
            other = move(here, best.step if best else None)
            if other and (best is None or _comes_before(other.step, best.step)):
                best = other
        return best

    def end(
        self, here: Hypothesis[P], rivals: RivalsOf
    ) -> tuple[Hypothesis[P], Mapping[Key, Evidence]]:
        """Returns a hypothesis after exchanges and removals, and what speaks for each effect."""
        here, compared = self._reduced(here, rivals)
        some = acting(here.effects)
        if len(some) < len(here.effects):
            here = replace(here, fit=measured(here.problem, some))
        else:
            whole = here
            here = self.in_its_time(
                lambda: replace(whole, fit=along_valley(whole.problem, whole.fit)), whole
            )
        return here, support(here, compared, self.held)

    def in_its_time(
        self, better: Callable[[], Hypothesis[P]], here: Hypothesis[P]
    ) -> Hypothesis[P]:
        """Returns a better hypothesis, or where finding it takes too long the one that there is."""
        try:
            with self._bounded():
                return better()
        except OutOfTimeError:
            self.report("the time is over")
            return here

    def _bounded(self) -> AbstractContextManager[None]:
        return self.clock.until(self.in_time)

    def _reduced(
        self, here: Hypothesis[P], rivals: RivalsOf
    ) -> tuple[Hypothesis[P], list[Compared]]:
        while True:
            here, exchanged, compared = exchange(
                here, self.held, rivals, self.report, self._bounded
            )
            here, removed = remove(here, self.held, self.report, self._bounded)
            self.steps.extend([*exchanged, *removed])
            if not exchanged or not self.in_time():
                return here, compared


def _comes_before(one: Step, other: Step) -> bool:
    """Returns whether a step predicts better, or as well, and has weighed more of the same move."""
    gains = gain_of(one), gain_of(other)
    return gains[0] > gains[1] or (gains[0] == gains[1] and one.move is other.move)


def in_words(step: Step) -> str:
    """Returns what a step brought."""
    new = () if step.chosen is None else step.chosen.new
    return f"{step.move}: {', '.join(map(describe, new)) or 'nothing'}"


def effects_of(step: Step) -> tuple[EffectInstance, ...]:
    """Returns the effects with which a search goes on after a step."""
    return () if step.chosen is None else step.chosen.fit.effects


def support(
    here: Hypothesis, compared: Sequence[Compared], held: Mapping[Key, Difference]
) -> dict[Key, Evidence]:
    """Returns what speaks for each effect of a hypothesis.

    Args:
        here: The hypothesis.
        compared: Its effects beside their best rivals.
        held: What spoke for those that a few segments judge, there: all others know nothing of it.
    """
    rivals = {one.instance.key: one for one in compared}
    left, parts = _left_by_joint(here), _apart(here)
    told = {}
    for without, instance in gains_of_each(here):
        beside = rivals.get(instance.key, Compared(instance=instance))
        unweighed = Difference(UNWEIGHED * without.nats, without.error)
        told[instance.key] = Evidence(
            without=held.get(instance.key, without),
            rival=beside.over if beside.weighed else unweighed,
            by=beside.rival,
            left=_left_of(instance, here.problem.joints, left),
            apart=parts[instance.key],
        )
    return told


def _left_by_joint(here: Hypothesis) -> Array:
    """Returns the squared gap of each joint before and after, in units of the noise, (2, J)."""
    plain = here.problem.plain()
    costs = [plain.joint_costs(r) for r in plain.residuals([(), here.effects])]
    return np.maximum(np.stack(costs) - 1.0, 1e-9)


def _left_of(instance: EffectInstance, joints: Sequence[str], gaps: Array) -> float:
    """Returns the share of the squared gap, shape (2, J), that is left where an effect acts."""
    local = instance.effect.scope in (Scope.JOINT, Scope.PAIR)
    rows = [joints.index(name) for name in (instance.joints if local else joints)]
    return float(gaps[1][rows].sum() / gaps[0][rows].sum())


def _apart(here: Hypothesis) -> dict[Key, float]:
    """Returns by what share of itself each effect differs between parts of the data."""
    fitted, blocks = here.fit, here.problem.blocks
    rests, _ = each_left_out(fitted.effects)
    whole, *rest = here.problem.plain().residuals([fitted.effects, *rests])
    weights = slopes(fitted.residual, here.problem.limits())
    rows = [piece.ravel() for piece in blocks.pieces]
    order = [np.flatnonzero(blocks.recording == one) for one in np.unique(blocks.recording)]
    told, steady = dict[Key, float](), always(fitted)
    for instance, without in zip(fitted.effects, rest, strict=True):
        own = columns_of(fitted, instance)
        beside = own | steady  # what acts now and then, a part may not know
        told[instance.key] = apart(
            fitted.jacobian[:, beside],
            fitted.residual,
            rows,
            order,
            own[beside],
            (without - whole) * weights,
        )
    return told
