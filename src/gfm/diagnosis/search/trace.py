"""What a search leaves behind: its steps, and what it found. The report reads nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Generic, NamedTuple

from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.hypothesis import Of, parameters_of
from gfm.effects import EffectInstance, Key


class Move(StrEnum):
    """How one hypothesis becomes another."""

    ADD = "add"
    COMMON_ERRORS = "common errors"
    MISSING_TORQUE = "missing torque"
    INTERMITTENT = "intermittent"
    EXCHANGE = "exchange"
    REMOVE = "remove"


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A hypothesis that was weighed in a step.

    Attributes:
        new: Effects that the one before did not have; what it lacks, of a removal.
        fit: All of its effects.
        gain: By how much it predicts better than the one before.
    """

    new: tuple[EffectInstance, ...]
    fit: Fit
    gain: Difference

    @property
    def parameters(self) -> int:
        """How many numbers the new effects have, see `parameters_of`."""
        return parameters_of(self.new, self.fit)


@dataclass(frozen=True, kw_only=True)
class Step:
    """One step of a search.

    Attributes:
        move: What was tried.
        before: Mean squared residual before, in units of the noise.
        ranked: What was weighed, best first.
        chosen: What the search went on with; None where nothing predicted clearly better.
        replaced: What made way for it.
        segments: How many segments it was about; 0 for all.
        part: Those of them that what was chosen changes; None for all.
    """

    move: Move
    before: float
    ranked: tuple[Tried, ...] = ()
    chosen: Tried | None = None
    replaced: tuple[EffectInstance, ...] = ()
    segments: int = 0
    part: Problem | None = None

    @property
    def gain(self) -> float:
        """By how much better it predicts, nats; nothing where it chose nothing."""
        return 0.0 if self.chosen is None else self.chosen.gain.nats

    @property
    def effects(self) -> tuple[EffectInstance, ...]:
        """The effects with which a search goes on after it."""
        return () if self.chosen is None else self.chosen.fit.effects


def parts_of(steps: Sequence[Step]) -> dict[Key, Problem]:
    """Returns the segments that told of what acts now and then only, by the effect."""
    told = [(step.chosen, step.part) for step in steps]
    return {tried.new[0].key: part for tried, part in told if tried and part}


class Nameless(NamedTuple):
    """A law without a name that predicts better than an effect, or several, in whose place it is.

    `over` is by how much they predict better (less than nothing), `state` that of which it is a
    law, position, velocity or drive torque, of `joint`.
    """

    over: Difference
    state: str
    joint: str


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What speaks for one effect of a hypothesis.

    Attributes:
        without: By how much the hypothesis predicts better than without it.
        rival: By how much it predicts better than with the best rival in its place; None where
            nothing rivals it.
        by: That rival.
        apart: By what share of itself it may differ between parts of the data.
        bends: How much of what is left on its joint it leaves by not changing with the state.
        disagrees: By how much its amount is not that which the missing torque tells.
        nameless: A law without a name for which it stands; None where it predicts as well.
    """

    without: Difference
    rival: Difference | None
    by: EffectInstance | None
    apart: float
    bends: float
    disagrees: float = 0.0
    nameless: Nameless | None = None

    @property
    def over_rival(self) -> Difference:
        """By how much it predicts better than with its best rival; without it, if there is none."""
        if self.nameless is not None:
            return self.nameless.over
        return self.without if self.rival is None else self.rival


@dataclass(frozen=True, kw_only=True)
class SearchResult(Generic[Of]):
    """What was found, and how.

    Attributes:
        problem: To which amounts were fitted in the end.
        fit: The hypothesis in the end.
        room: By how much any other one could predict better at most.
        steps: First to last.
        evidence: Of every effect of the hypothesis.
        equals: Other names of each effect that the recordings do not tell from it.
        out_of_time: Whether the search ended because its time was over.
    """

    problem: Of
    fit: Fit
    room: Difference
    steps: tuple[Step, ...] = ()
    evidence: Mapping[Key, Evidence] = field(default_factory=dict)
    equals: Mapping[Key, tuple[EffectInstance, ...]] = field(default_factory=dict)
    out_of_time: bool = False

    def names_of(self, instance: EffectInstance) -> tuple[EffectInstance, ...]:
        """Returns an effect and its other names."""
        return instance, *self.equals.get(instance.key, ())
