"""What a search says of itself: its steps, why it ended there, and what else predicts as well.

What predicts as well are the names that the data cannot rule out, by named effect. A rival is equal
where the score does not tell it from the named effect at all, and close where it does not tell it
clearly. Which motion would tell them apart is what shows either of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gfm.diagnosis.inference.amounts import at_bound
from gfm.diagnosis.inference.constants import CLEARLY
from gfm.diagnosis.search.naming import describe, twins
from gfm.diagnosis.search.trace import Move, SearchResult, Step
from gfm.effects import EffectInstance, Placed

#: Standard errors up to which two hypotheses predict equally well.
EQUAL = 1.0


@dataclass(frozen=True, kw_only=True)
class StepRow:
    """One step of the search.

    Attributes:
        move: What was tried.
        before: Mean squared residual that was left, in units of the noise.
        best: What predicts best, in words; empty where nothing was fitted.
        gain: By how much it predicts better, nats.
        error: Standard error of that.
        chosen: Whether the search went on with it.
        replaced: What made way for it, or was removed, in words; empty if nothing.
        segments: How many segments the step was about, those that stayed far off; 0 for all.
    """

    move: str
    before: float
    best: str
    gain: float
    error: float
    chosen: bool
    replaced: str = ""
    segments: int = 0


@dataclass(frozen=True, kw_only=True)
class Stopping:
    """How the search went and ended.

    Attributes:
        steps: First to last.
        left: Mean squared residual in the end, in units of the noise.
        room: By how much any other hypothesis could predict better at most, nats.
        room_error: Standard error of that.
        reason: Why it ended, in words.
        taken_out: What was found and is not among the effects in the end, with the reason.
    """

    steps: tuple[StepRow, ...]
    left: float
    room: float
    room_error: float
    reason: str
    taken_out: tuple[str, ...] = ()


def stopping(found: SearchResult) -> Stopping:
    """Returns how a search went and why it ended."""
    return Stopping(
        steps=tuple(_row(step) for step in found.steps),
        left=found.fit.cost,
        room=found.room.nats,
        room_error=found.room.error,
        reason=_reason(found),
        taken_out=_taken_out(found),
    )


def _row(step: Step) -> StepRow:
    best = step.chosen or (step.ranked[0] if step.ranked else None)
    return StepRow(
        move=str(step.move),
        before=step.before,
        best="" if best is None or step.move is Move.REMOVE else _in_words(best.new),
        gain=0.0 if best is None else best.gain.nats,
        error=0.0 if best is None else best.gain.error,
        chosen=step.chosen is not None,
        replaced=", ".join(map(describe, step.replaced)),
        segments=step.segments,
    )


def _in_words(new: Sequence[EffectInstance]) -> str:
    return f"{len(new)} effects together" if len(new) > 1 else describe(new[0])


def _taken_out(found: SearchResult) -> tuple[str, ...]:
    left = {e.key for e in (*found.fit.effects, *twins(*found.fit.effects))}
    gone = {
        describe(one): "it predicts as well without"
        if step.move is Move.REMOVE
        else f"{describe(step.chosen.new[0])} predicts better, or as well and is simpler"
        for step in found.steps
        for one in step.replaced
        if step.chosen and one.key not in left
    }
    return tuple(f"{words}: {why}" for words, why in gone.items())


def _reason(found: SearchResult) -> str:
    if found.out_of_time:
        return "its time was over: this is the best answer so far"
    if not found.room.clear:
        return (
            "what any other effect could still gain is not visible beside what a right model leaves"
        )
    best = [step.ranked[0] for step in found.steps if step.ranked and step.chosen is None]
    if best and any(map(at_bound, best[-1].new)):
        return f"{_in_words(best[-1].new)} predicts best, but its amount is none, or has no end"
    return "no candidate predicts clearly better"


@dataclass(frozen=True, kw_only=True)
class Alternative(Placed):
    """Another name for what was found.

    Attributes:
        errors: By how many standard errors the named effect predicts better; 0 for the same law
            under another name.
        told_by: The motion that shows it, in words.
    """

    errors: float
    told_by: str

    @property
    def equal(self) -> bool:
        """Whether the recordings do not tell it from the named effect."""
        return self.errors < EQUAL


@dataclass(frozen=True, kw_only=True)
class ConfusableSet(Placed):
    """A named effect with its alternatives.

    Attributes:
        alternatives: Nearest first.
        shown_by: The motion that shows it itself, in words.
    """

    alternatives: tuple[Alternative, ...]
    shown_by: str


def confusable_sets(
    found: SearchResult, named: Sequence[EffectInstance]
) -> tuple[ConfusableSet, ...]:
    """Returns the set of every named effect, with no alternative where nothing comes close."""
    return tuple(
        ConfusableSet(
            *instance.key,
            alternatives=_alternatives(instance, found),
            shown_by=instance.effect.shown_by,
        )
        for instance in named
    )


def _alternatives(instance: EffectInstance, found: SearchResult) -> tuple[Alternative, ...]:
    others = [(other, 0.0) for other in found.names_of(instance)[1:]]
    told = found.evidence.get(instance.key)
    if told is not None and told.rival is not None and told.by is not None:
        others.append((told.by, max(told.rival.errors, 0.0)))
    return tuple(
        Alternative(*other.key, errors=errors, told_by=other.effect.shown_by)
        for other, errors in sorted(others, key=lambda one: one[1])
        if errors < CLEARLY
    )
