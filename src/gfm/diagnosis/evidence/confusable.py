"""What else predicts as well: the names that the data cannot rule out, by named effect.

A rival is equal where the score does not tell it from the named effect at all, and close where it
does not tell it clearly. Which motion would tell them apart is what shows either of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gfm.diagnosis.inference.constants import CLEARLY
from gfm.diagnosis.search.hypothesis import parameters_of
from gfm.diagnosis.search.trace import SearchResult
from gfm.effects import EffectInstance

#: Standard errors up to which two hypotheses predict equally well.
EQUAL = 1.0


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Another name for what was found.

    Attributes:
        effect: Name.
        joints: Where.
        errors: By how many standard errors the named effect predicts better; 0 for the same law
            under another name.
        told_by: The motion that shows it, in words.
        more_parameters: How many more it has.
    """

    effect: str
    joints: tuple[str, ...]
    errors: float
    told_by: str
    more_parameters: int = 0

    @property
    def equal(self) -> bool:
        """Whether the recordings do not tell it from the named effect."""
        return self.errors < EQUAL


@dataclass(frozen=True, kw_only=True)
class ConfusableSet:
    """A named effect with its alternatives.

    Attributes:
        effect: Name.
        joints: Where.
        alternatives: Nearest first.
        shown_by: The motion that shows it itself, in words.
    """

    effect: str
    joints: tuple[str, ...]
    alternatives: tuple[Alternative, ...]
    shown_by: str


def confusable_sets(
    found: SearchResult, named: Sequence[EffectInstance]
) -> tuple[ConfusableSet, ...]:
    """Returns the set of every named effect, with no alternative where nothing comes close."""
    return tuple(
        ConfusableSet(
            effect=instance.effect.name,
            joints=instance.joints,
            alternatives=_alternatives(instance, found),
            shown_by=instance.effect.shown_by,
        )
        for instance in named
    )


def _alternatives(instance: EffectInstance, found: SearchResult) -> tuple[Alternative, ...]:
    others = [_alternative(other, instance, 0.0) for other in found.names_of(instance)[1:]]
    told = found.evidence.get(instance.key)
    if told is not None and told.rival is not None and told.by is not None:
        others.append(_alternative(told.by, instance, max(told.rival.errors, 0.0)))
    return tuple(sorted((o for o in others if o.errors < CLEARLY), key=lambda one: one.errors))


def _alternative(other: EffectInstance, instance: EffectInstance, errors: float) -> Alternative:
    return Alternative(
        effect=other.effect.name,
        joints=other.joints,
        errors=errors,
        told_by=other.effect.shown_by,
        more_parameters=max(parameters_of([other]) - parameters_of([instance]), 0),
    )
