"""What changed from one set of recordings to the next: amounts, set by set, and a sentence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gfm.diagnosis.inference.constants import CLEARLY
from gfm.diagnosis.search.sets import Course
from gfm.effects import Key, find_effect

#: What people call effects whose names say less.
_CALLED = {"coulomb_friction": "dry friction", "actuator_gain": "drive torque"}


@dataclass(frozen=True, kw_only=True)
class SetAmount:
    """One amount of one effect in all sets, as added to what the model has.

    Attributes:
        effect: Name in the effect library.
        joints: Where it acts.
        parameter: Which of its amounts.
        unit: SI.
        course: Whether its effect repeats, drifts or changes from set to set.
        values: In each set if only this effect's amounts differ between sets, K of them.
        errors: Their standard errors, infinite where a set does not show the amount.
        seen: Whether each set would show if there were nothing of the effect.
        already: What the model has of it: with a value, what the robot has; None where that is no
            sum.
        mean: Over robots like those of the sets, by a random-effects estimate.
        spread: Standard deviation from set to set, by the same.
        low: What training should draw from.
        high: Likewise.
        credible: Whether its effect is more likely right than wrong, by one set at least.
    """

    effect: str
    joints: tuple[str, ...]
    parameter: str
    unit: str
    course: Course
    values: tuple[float, ...]
    errors: tuple[float, ...]
    seen: tuple[bool, ...]
    already: float | None
    mean: float
    spread: float
    low: float
    high: float
    credible: bool

    @property
    def key(self) -> Key:
        """The effect, and where."""
        return self.effect, self.joints


@dataclass(frozen=True, kw_only=True)
class Changes:
    """What changed.

    Attributes:
        sentence: The answer, for people.
        sets: Names of the recordings of each set, oldest first.
        amounts: Of all effects that one set at least supports.
    """

    sentence: str
    sets: tuple[tuple[str, ...], ...]
    amounts: tuple[SetAmount, ...]


def sentence_on_changes(amounts: Sequence[SetAmount]) -> str:
    """Returns the answer in words: what changed, what only seems to, and what could not be seen."""
    effects: dict[Key, list[SetAmount]] = {}
    for one in amounts:
        effects.setdefault(one.key, []).append(one)
    changed = [own for own in effects.values() if own[0].course is not Course.REPEATS]
    sure = [_change(own) for own in changed if own[0].credible]
    unsure = [_change(own) for own in changed if not own[0].credible]
    parts = ["; ".join(sure) or ("something changed" if unsure else "nothing changed")]
    if unsure:
        parts.append(f"doubtful by name: {'; '.join(unsure)}")
    parts += _unseen([own[0] for own in effects.values()])
    return " ".join(f"{part[0].upper()}{part[1:]}." for part in parts)


def _unseen(firsts: Sequence[SetAmount]) -> list[str]:
    """Returns what some sets show and others could not have shown."""
    same = [a for a in firsts if a.course is Course.REPEATS and a.credible and any(a.seen)]
    told: Mapping[str, list[str]] = {
        "earlier": [_what(a) for a in same if not all(a.seen[:-1])],
        "later": [_what(a) for a in same if not a.seen[-1]],
    }
    return [
        f"could not be seen in the {which} recordings: {', '.join(names)}"
        for which, names in told.items()
        if names
    ]


def _what(amount: SetAmount) -> str:
    name = _CALLED.get(amount.effect, amount.effect.replace("_", " "))
    return f"{name} of {', '.join(amount.joints)}" if amount.joints else name


def _change(own: Sequence[SetAmount]) -> str:
    """Returns in words how the amounts of one effect differ between sets."""
    apart = [one for one in own if abs(_difference(one)) > CLEARLY * np.hypot(*_ends(one.errors))]
    return ", ".join(_course(one) for one in apart or own[:1])


def _difference(amount: SetAmount) -> float:
    return amount.values[-1] - amount.values[0]


def _ends(errors: Sequence[float]) -> tuple[float, float]:
    return errors[0], errors[-1]


def _course(amount: SetAmount) -> str:
    """Returns in words how one amount differs between sets."""
    change = _difference(amount)
    unit = "" if amount.unit == "1" else f" {amount.unit}"
    values = np.array(amount.values) + (amount.already or 0.0)
    listed = " -> ".join(f"{value:.3g}" for value in values) + unit
    what = _what(amount)
    if len(find_effect(amount.effect).parameters) > 1:
        what = f"{amount.parameter.replace('_', ' ')} of {what}"
    if amount.course is Course.DRIFTS:
        what = f"{what} drifts:"
    elif len(values) > 2:
        return f"{what} varies ({listed})"
    if (amount.effect, amount.parameter) == ("payload", "mass"):
        return f"{abs(change):#.2g} kg {'more' if change > 0.0 else 'less'} at the tool"
    way = "up" if change > 0.0 else "down"
    some = min(values[0], values[-1]) > CLEARLY * max(_ends(amount.errors))
    if amount.already is not None and some:
        share = 100.0 * abs(values[-1] / values[0] - 1.0)
        return f"{what} {way} by {share:.0f} % ({listed})"
    return f"{what} {way} by {abs(change):.2g}{unit} ({listed})"
