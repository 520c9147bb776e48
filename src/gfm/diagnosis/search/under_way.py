"""What every move of a search is told, and what it may take."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Generic, TypeAlias, TypeVar

from gfm.core.deadline import Clock, OutOfTimeError
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, P, in_turn
from gfm.diagnosis.search.trace import Step
from gfm.effects import Key
from gfm.signals.torque_domain import TorqueDomain

T = TypeVar("T")


def refitted(here: Hypothesis[P], step: Step) -> Hypothesis[P]:
    """Returns the hypothesis after a step, begun as it fits best."""
    problem, found = in_turn(here.problem, step.effects)
    return replace(here, problem=problem, fit=found)


@dataclass(kw_only=True)
class Search(Generic[P]):
    """A search under way.

    Attributes:
        candidates: What may be missing, and where.
        report: Told what is happening, in words.
        torques: The recordings as torques under the nominal model, where they can be seen so.
        witness: The same of those that bear witness of amounts: where nothing is touched.
        after: Returns the hypothesis to which a step leads from another.
        in_time: Whether there is time left to weigh rivals.
        goes_on: Whether there is time left for steps.
        clock: Breaks off what takes too long.
        steps: So far.
        ended_early: Whether there was no time left for steps that might have gained something.
    """

    candidates: Sequence[Place] = ()
    report: Callable[[str], None]
    torques: TorqueDomain | None = None
    witness: TorqueDomain | None = None
    after: Callable[[Hypothesis[P], Step], Hypothesis[P]] = refitted
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

    def led_to(self, here: Hypothesis[P], step: Step) -> Hypothesis[P]:
        """Returns the hypothesis to which a step leads that chose something.

        As it was weighed where there is no time to look for initial states that suit it.
        """
        weighed = here if step.chosen is None else replace(here, fit=step.chosen.fit)
        return self.in_its_time(partial(self.after, here, step), weighed)

    def in_its_time(self, made: Callable[[], T], otherwise: T, *, step: bool = False) -> T:
        """Returns what takes long to make, or something else where its time is over.

        Args:
            made: Makes it.
            otherwise: Returned if there is no time.
            step: Whether its time is that of steps.
        """
        try:
            with self.clock.until(self.goes_on if step else self.in_time):
                return made()
        except OutOfTimeError:
            self.report(f"the time {'for steps ' if step else ''}is over")
            return otherwise


#: Proposes a step beside the best that others propose; None where it is not its turn.
MoveFrom: TypeAlias = Callable[[Hypothesis[P], Search[P], Step], Step | None]
