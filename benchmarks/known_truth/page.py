"""The results as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from statistics import median

from known_truth.score import Score

#: Held-out error after the correction, in noise floors, from which much is left.
MOST_FLOORS = 1.5
_BESIDE, _EVERYWHERE = "one effect beside one outside", "one effect on every joint"
_WRONG = "a wrong name with confidence"


def share(scores: Sequence[Score], holds: Callable[[Score], bool]) -> str:
    """Returns how many of the cases something holds of."""
    if not scores:
        return "–"
    count = sum(holds(one) for one in scores)
    return f"{count} of {len(scores)} ({100 * count / len(scores):.0f} %)"


def summary(scores: Sequence[Score]) -> str:
    """Returns the numbers of the whole suite, beside what is asked for."""
    kind = {
        c: [s for s in scores if s.category == c]
        for c in ("single", "pair", "none", "outside", "poor", "beside", "everywhere")
    }
    effects = [*kind["single"], *kind["pair"]]
    errors = [e for s in effects for e in s.errors]
    covered = [c for s in effects for c in s.covered]
    large = [s for s in scores if s.setup.startswith("spatial")]
    asked: list[tuple[str, str, str, Callable[[Score], bool]]] = [
        ("one effect: the right one first", "95 %", "single", lambda s: s.effect),
        ("one effect: on the right joint", "95 %", "single", lambda s: s.joint),
        ("one effect: nothing else named", "", "single", lambda s: s.complete and s.surplus == 0),
        ("two effects: both named", "85 %", "pair", lambda s: s.complete),
        ("two effects: both, nothing else", "", "pair", lambda s: s.complete and s.surplus == 0),
        ("none: nothing named", "99 %", "none", lambda s: s.surplus == 0),
        (
            "outside the vocabulary: a name with confidence",
            "at most 5 %",
            "outside",
            lambda s: s.claimed,
        ),
        (f"poor excitation: {_WRONG}", "", "poor", lambda s: s.claimed),
        (f"{_BESIDE}: the known one named, on the right joint", "", "beside", lambda s: s.complete),
        (f"{_BESIDE}: {_WRONG}", "", "beside", lambda s: s.claimed),
        (f"{_EVERYWHERE}: named on all of them", "", "everywhere", lambda s: s.complete),
        (f"{_EVERYWHERE}: {_WRONG}", "", "everywhere", lambda s: s.claimed),
    ]
    rows = [
        *((words, wanted, share(kind[c], holds)) for words, wanted, c, holds in asked),
        ("parameters: median relative error", "5 %", _percent(errors)),
        ("95 % intervals that hold the truth", "90 to 99 %", _share_of(covered)),
        (
            "spreads, where no interval would hold, that hold it",
            "",
            _share_of([c for s in scores for c in s.spread]),
        ),
        (
            "held-out error after / noise floor, one or two effects, median",
            "at most 1.1",
            _floors(effects),
        ),
        (
            "held-out error larger than before",
            "never",
            share(scores, lambda s: s.after > s.before),
        ),
        (
            "time, seven joints, median (largest)",
            "90 s",
            _times([s.wall_s for s in large]),
        ),
    ]
    lines = ["| | wanted | found |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {a} | {b} | {c} |" for a, b, c in rows)])


def _floors(scores: Sequence[Score]) -> str:
    """Returns the median of held-out errors after the correction, in noise floors."""
    return f"{median(s.after / s.floor for s in scores):.2f}" if scores else "–"


def _percent(errors: Sequence[float]) -> str:
    return f"{100 * median(errors):.1f} % ({len(errors)} parameters)" if errors else "–"


def _share_of(covered: Sequence[bool]) -> str:
    if not covered:
        return "–"
    return f"{100 * sum(covered) / len(covered):.0f} % of {len(covered)}"


def _times(wall_s: Sequence[float]) -> str:
    return f"{median(wall_s):.0f} s ({max(wall_s):.0f} s)" if wall_s else "–"


def by_setup(scores: Sequence[Score]) -> str:
    """Returns one line per robot."""
    lines = [
        "| robot and commands | one effect: right | right joint | two: both | none: nothing "
        "| outside: claimed | after / floor | time (s) |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for setup in dict.fromkeys(s.setup for s in scores):
        here = [s for s in scores if s.setup == setup]
        single, pair, none, outside = (
            [s for s in here if s.category == c] for c in ("single", "pair", "none", "outside")
        )
        lines.append(
            f"| {setup} | {share(single, lambda s: s.effect)} | {share(single, lambda s: s.joint)} "
            f"| {share(pair, lambda s: s.complete)} | {share(none, lambda s: s.surplus == 0)} "
            f"| {share(outside, lambda s: s.claimed)} | {_floors([*single, *pair])} "
            f"| {median(s.wall_s for s in here):.0f} |"
        )
    return "\n".join(lines)


def beside(scores: Sequence[Score], peers: Mapping[str, Sequence[Score]]) -> str:
    """Returns one line per peer, and one of the diagnosis on the same cases.

    Each is compared on the cases that it answered.
    """
    lines = [
        "| | cases | one effect: right, on the right joint | two: both | none: nothing "
        "| after / floor, median | time (s), median |",
        "|---|---|---|---|---|---|---|",
    ]
    asked = {one.name for answers in peers.values() for one in answers}
    if not asked:
        return "Not asked in this run (--peers)."
    rows = {"gfm diagnose": [s for s in scores if s.name in asked], **peers}
    lines += [_beside(name, answers) for name, answers in rows.items() if answers]
    return "\n".join(lines)


def _beside(name: str, answers: Sequence[Score]) -> str:
    single, pair, none = (
        [s for s in answers if s.category == c] for c in ("single", "pair", "none")
    )
    return (
        f"| {name} | {len(answers)} | {share(single, lambda s: s.effect and s.joint)} "
        f"| {share(pair, lambda s: s.complete)} | {share(none, lambda s: s.surplus == 0)} "
        f"| {_floors([*single, *pair])} "
        f"| {median(s.wall_s for s in answers):.0f} |"
    )


def by_effect(scores: Sequence[Score]) -> str:
    """Returns one line per effect, of the cases that hide it alone."""
    lines = [
        "| effect | right | right joint | median error of parameters | intervals that hold |",
        "|---|---|---|---|---|",
    ]
    single = [s for s in scores if s.category == "single"]
    for effect in sorted({s.hidden.split("(")[0] for s in single}):
        here = [s for s in single if s.hidden.startswith(f"{effect}(")]
        lines.append(
            f"| {effect} | {share(here, lambda s: s.effect)} | {share(here, lambda s: s.joint)} "
            f"| {_percent([e for s in here for e in s.errors])} "
            f"| {_share_of([c for s in here for c in s.covered])} |"
        )
    return "\n".join(lines)


def is_wrong(one: Score) -> bool:
    """Returns whether a case did not go as it should: names, or much that is left unexplained."""
    worse = one.after > one.before
    left = one.after > MOST_FLOORS * one.floor
    match one.category:
        case "single":
            return worse or left or not (one.effect and one.joint) or one.surplus > 0
        case "pair":
            return worse or left or not one.complete or one.surplus > 0
        case "none":
            return worse or one.surplus > 0
        case _:
            return worse or one.claimed


def cases(scores: Sequence[Score]) -> str:
    """Returns one line per case."""
    lines = [
        "| case | hidden | named (confidence) | verdict | before (rad) | after / floor | s |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {one.name} | {one.hidden} | {one.named} | {one.verdict} | {one.before:.2e} "
        f"| {one.after / one.floor:.2f} | {one.wall_s:.0f} |"
        for one in scores
    ]
    return "\n".join(lines)
