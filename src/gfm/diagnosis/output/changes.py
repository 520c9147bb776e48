"""What changed from one set of recordings to the next: amounts, set by set, and a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from gfm.diagnosis.inference.constants import CLEARLY
from gfm.diagnosis.search.sets import Course
from gfm.effects import Placed, find_effect

#: What people call effects whose names say less.
_CALLED = {"coulomb_friction": "dry friction", "actuator_gain": "drive torque"}


@dataclass(frozen=True, kw_only=True)
class SetAmount(Placed):
    """One amount of one effect in all sets, as added to what the model has.

    Attributes:
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
    effects = [list(own) for _, own in groupby(amounts, lambda one: one.key)]
    changed = [own for own in effects if own[0].course is not Course.REPEATS]
    sure = [_change(own) for own in changed if own[0].credible]
    unsure = [_change(own) for own in changed if not own[0].credible]
    parts = ["; ".join(sure) or ("something changed" if unsure else "nothing changed")]
    if unsure:
        parts.append(f"doubtful by name: {'; '.join(unsure)}")
    same = [own[0] for own in effects if own[0].course is Course.REPEATS and own[0].credible]
    hidden = {
        "earlier": [_what(a) for a in same if any(a.seen) and not all(a.seen[:-1])],
        "later": [_what(a) for a in same if any(a.seen) and not a.seen[-1]],
    }
    for which, names in hidden.items():
        if names:
            parts.append(f"could not be seen in the {which} recordings: {', '.join(names)}")
    return " ".join(f"{part[0].upper()}{part[1:]}." for part in parts)


def _what(amount: SetAmount) -> str:
    name = _CALLED.get(amount.effect, amount.effect.replace("_", " "))
    return f"{name} of {', '.join(amount.joints)}" if amount.joints else name


def _change(own: Sequence[SetAmount]) -> str:
    """Returns in words how the amounts of one effect differ between sets."""
    apart = [
        one
        for one in own
        if abs(one.values[-1] - one.values[0]) > CLEARLY * np.hypot(one.errors[0], one.errors[-1])
    ]
    return ", ".join(_course(one) for one in apart or own[:1])


def _course(amount: SetAmount) -> str:
    """Returns in words how one amount differs between sets."""
    values = np.array(amount.values) + (amount.already or 0.0)
    change = values[-1] - values[0]
    unit = "" if amount.unit == "1" else f" {amount.unit}"
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
    some = min(values[0], values[-1]) > CLEARLY * max(amount.errors[0], amount.errors[-1])
    much = f"{abs(change):.2g}{unit}"
    if amount.already is not None and some:
        much = f"{100.0 * abs(values[-1] / values[0] - 1.0):.0f} %"
    return f"{what} {'up' if change > 0.0 else 'down'} by {much} ({listed})"
