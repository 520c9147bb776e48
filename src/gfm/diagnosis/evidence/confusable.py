"""What else explains as much: the names that the data cannot rule out, by named effect.

Two names are equal where the runner-up leaves hardly more of what the best one explains, and close
where it leaves little more; neither, where the best leaves noise and the other clearly more. Which
motion would tell them apart is what shows either of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gfm.diagnosis.former.adequate import ruled_out
from gfm.diagnosis.former.attribution import Attribution, Round, price
from gfm.diagnosis.inference.fitting import LEAST_GAIN, Fit
from gfm.diagnosis.search.naming import twins
from gfm.effects import EffectInstance

#: A runner-up is equal, or close, when it leaves so little more of what the best explains.
EQUAL, CLOSE = 0.01, 0.05


@dataclass(frozen=True, kw_only=True)
class Alternative:
    """Another name for what was found.

    Attributes:
        effect: Name.
        joints: Where.
        lost: Share of what the named effect explains that it leaves; 0 for the same law under
            another name.
        told_by: The motion that shows it, in words.
        more_parameters: How many more it has: what explains as much with more of them is no rival.
    """

    effect: str
    joints: tuple[str, ...]
    lost: float
    told_by: str
    more_parameters: int = 0

    @property
    def equal(self) -> bool:
        """Whether the recordings do not tell it from the named effect."""
        return self.lost < EQUAL


@dataclass(frozen=True, kw_only=True)
class ConfusableSet:
    """A named effect with its alternatives.

    Attributes:
        effect: Name.
        joints: Where.
        alternatives: Nearest first.
        shown_by: The motion that shows it itself, in words.
        weighed: Whether others were fitted in its place: what was found together with another
            effect, or on another joint first, was not.
    """

    effect: str
    joints: tuple[str, ...]
    alternatives: tuple[Alternative, ...]
    shown_by: str
    weighed: bool = True


def confusable_sets(
    found: Attribution, named: Sequence[EffectInstance]
) -> tuple[ConfusableSet, ...]:
    """Returns the set of every named effect, with no alternative where nothing comes close."""
    taken = {instance.key for instance in named}
    return tuple(
        ConfusableSet(
            effect=instance.effect.name,
            joints=instance.joints,
            alternatives=_alternatives(instance, found.rounds, taken),
            shown_by=instance.effect.shown_by,
            weighed=any(_won(this, instance) for this in found.rounds),
        )
        for instance in named
    )


def _alternatives(
    instance: EffectInstance, rounds: Sequence[Round], taken: set[tuple[str, tuple[str, ...]]]
) -> tuple[Alternative, ...]:
    others = [other for other, _ in twins([instance])]
    found = [_alternative(other, 0.0) for other in others]
    names = {instance.key, *(other.key for other in others)}
    for this in rounds:
        if not _won(this, instance):
            continue
        best = this.fits[0]
        found += [
            _alternative(f.effects[-1], lost, round((price(f) - price(best)) / LEAST_GAIN))
            for f in this.fits[1:]
            if (lost := _lost(f, best, this.before)) < CLOSE
            and f.effects[-1].key not in names | taken
            and not ruled_out(f, best)
        ]
    return tuple(sorted(found, key=lambda one: one.lost))


def _won(this: Round, instance: EffectInstance) -> bool:
    """Returns whether an effect was accepted in a round alone, by any of its names."""
    names = {instance.key, *(other.key for other, _ in twins([instance]))}
    alone = this.accepted is not None and not this.together
    return alone and this.fits[0].effects[-1].key in names


def _lost(fitted: Fit, best: Fit, before: float) -> float:
    """Returns the share of what the best fit explains that another one leaves."""
    return max((fitted.cost - best.cost) / max(before - best.cost, 1e-9), 0.0)


def _alternative(instance: EffectInstance, lost: float, more: int = 0) -> Alternative:
    return Alternative(
        effect=instance.effect.name,
        joints=instance.joints,
        lost=lost,
        told_by=instance.effect.shown_by,
        more_parameters=max(more, 0),
    )
