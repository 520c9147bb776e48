"""How a report compares with the truth."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from known_truth.outside import is_strange

#: Confidence from which a name counts as claimed.
CLAIMED = 0.5
#: Rest angles and phases are judged in units of this, rad: relative to nought they say nothing.
_RADIAN = 1.0

Report = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Score:
    """One case.

    Attributes:
        name: Of the case.
        setup: Robot and kind of commands.
        category: single, pair, none, outside, poor, beside or everywhere (see Plan).
        hidden: What there is, in words.
        named: What was named, in words, strongest first.
        verdict: In one word.
        effect: Whether the first name is right.
        joint: Whether it is on the right joints.
        complete: Whether all that is hidden and has a name was named, and on the right joints.
        surplus: How many names are of nothing that is there.
        claimed: Whether one of these was named with confidence.
        errors: Relative errors of the parameters of what was named rightly.
        covered: Whether their intervals hold the truth, where there are intervals.
        spread: Whether their spreads do, where no interval would hold.
        before: Held-out position RMSE of the nominal model, rad.
        after: The same of the corrected model, rad.
        floor: Sensor noise, rad; of another hand with what its discrepancy changes.
        wall_s: Time that it took.
    """

    name: str
    setup: str
    category: str
    hidden: str
    named: str
    verdict: str
    effect: bool
    joint: bool
    complete: bool
    surplus: int
    claimed: bool
    errors: tuple[float, ...]
    covered: tuple[bool, ...]
    spread: tuple[bool, ...]
    before: float
    after: float
    floor: float
    wall_s: float


def score(truth: Report, report: Report, wall_s: float) -> Score:
    """Returns how a report compares with the truth.

    What cannot be told apart counts as right if the truth stands among the suspects as its equal.
    A name that is told with others is not wrong if one of them is there; it is right, as the first
    name, only where physics cannot tell the two apart.
    """
    there, named = truth["effects"], report["effects"]
    pairs = [(hidden, one) for hidden in there for one in named if _means(one, hidden, report)]
    strange = [one for one in named if not is_right(one, truth, report)]
    first = named[0] if named else None
    errors, covered, spread = _parameters(pairs)
    return Score(
        name=truth["name"],
        setup=truth["setup"],
        category=truth["category"],
        hidden=in_words(there),
        named=in_words(named),
        verdict=report["verdict"],
        effect=first is not None and any(_named(first, h, report) for h in there),
        joint=first is not None and any(_on(first, h, report) for h in there),
        complete={id(h) for h in there if not is_strange(h["effect"])} <= {id(h) for h, _ in pairs},
        surplus=len(strange),
        claimed=any(one["confidence"] > CLAIMED for one in strange),
        errors=errors,
        covered=covered,
        spread=spread,
        before=report["error"]["before"],
        after=report["error"]["after"],
        floor=report["error"]["noise_floor"] * _floors(truth),
        wall_s=wall_s,
    )


def _floors(truth: Report) -> float:
    """Returns what a right model leaves at best, in units of the sensor noise."""
    asked: float = truth.get("discrepancy", {}).get("asked", 0.0)
    return math.hypot(1.0, asked)


def _joints(one: Report) -> frozenset[str]:
    return frozenset(one["joints"])


def _same(one: Report, other: Report) -> bool:
    return bool(one["effect"] == other["effect"]) and _joints(one) == _joints(other)


def _is_equal(one: Report, hidden: Report, report: Report) -> bool:
    """Returns whether `one` is the truth under another name, and the report says so."""
    told = any(_same(s, hidden) and "equal" in s["reason"] for s in report["suspects"])
    return told and any(_same(one, equal) for equal in hidden["equals"])


def _means(one: Report, hidden: Report, report: Report) -> bool:
    return _same(one, hidden) or _is_equal(one, hidden, report)


def is_right(one: Report, truth: Report, report: Report) -> bool:
    """Returns whether a name, one of those told with it, or a suspect is hidden, on its joints.

    That is what a confidence says. What physics cannot tell apart counts as in `score`.
    """
    names = (one, *one.get("equals", ()))
    return any(_means(n, hidden, report) for hidden in truth["effects"] for n in names)


def _named(one: Report, hidden: Report, report: Report) -> bool:
    return bool(one["effect"] == hidden["effect"]) or _is_equal(one, hidden, report)


def _on(one: Report, hidden: Report, report: Report) -> bool:
    return _joints(one) == _joints(hidden) or _is_equal(one, hidden, report)


def _parameters(
    pairs: Sequence[tuple[Report, Report]],
) -> tuple[tuple[float, ...], tuple[bool, ...], tuple[bool, ...]]:
    """Returns errors, whether intervals hold the truth, and whether spreads do."""
    errors, covered, spread = [], [], []
    for hidden, one in pairs:
        if one["effect"] != hidden["effect"]:
            continue
        for name, true in hidden["parameters"].items():
            if name in hidden["unseen"] or name not in one["parameters"]:
                continue
            told = one["parameters"][name]
            errors.append(relative_error(name, told["value"], hidden["parameters"]))
            if told["ci95"] is not None:
                low, high = told["ci95"]
                covered.append(low <= told["value"] + _miss(name, told["value"], true) <= high)
            elif "spread" in told:
                spread.append(abs(_miss(name, told["value"], true)) <= told["spread"])
    return tuple(errors), tuple(covered), tuple(spread)


def _miss(name: str, value: float, true: float) -> float:
    """Returns true minus told; of a phase, within half a turn."""
    return math.remainder(true - value, 2.0 * math.pi) if name == "phase" else true - value


def relative_error(name: str, value: float, true: Mapping[str, float]) -> float:
    """Returns an estimate's error relative to what it is: vectors to their length."""
    if name in ("phase", "rest_angle"):
        size = _RADIAN
    elif name in ("com_x", "com_y", "com_z"):
        size = math.hypot(*(true[axis] for axis in ("com_x", "com_y", "com_z")))
    elif name in ("tilt_x", "tilt_y"):
        size = math.hypot(true["tilt_x"], true["tilt_y"])
    else:
        size = abs(true[name])
    return abs(_miss(name, value, true[name])) / size


def in_words(effects: Sequence[Report]) -> str:
    """Returns effects as a table cell."""
    listed = []
    for one in effects:
        joints = one["joints"] if len(one["joints"]) < 7 else ["all"]
        sure = f" {one['confidence']:.2f}" if "confidence" in one else ""
        listed.append(f"{one['effect']}({', '.join(joints)}){sure}")
    return "; ".join(listed) or "nothing"
