"""What an answer is worth where something is known of a robot, and the table of all answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from public.source import Place, PublicSet

#: Confidence above which a name counts as claimed; gfm corrects a model with no other.
CLAIMED = 0.5


@dataclass(frozen=True, kw_only=True)
class Judged:
    """One answer.

    Attributes:
        set_name: Of which set.
        who: Whose answer.
        known: How many effects the publishers identified.
        right: Which of them were named.
        false: What else was named, beside what may well be there.
        verdict: In a word.
        before: Held-out position RMSE of the nominal model, rad.
        after: The same of the corrected model, rad.
        floor: Sensor noise, rad.
        wall_s: Time that it took.
        cpu_s: Of that, what a processor worked on it.
    """

    set_name: str
    who: str
    known: int
    right: tuple[Place, ...]
    false: tuple[Place, ...]
    verdict: str
    before: float
    after: float
    floor: float
    wall_s: float
    cpu_s: float

    @property
    def abstained(self) -> bool:
        """Whether nothing was named."""
        return not self.right and not self.false


def judged(
    one: PublicSet, who: str, report: Mapping[str, Any], *, wall_s: float, cpu_s: float
) -> Judged:
    """Returns what a report is worth.

    An effect on several joints counts on each of them.

    Args:
        one: The set.
        who: Whose report it is.
        report: `report.json`, or what a peer makes in its form.
        wall_s: Time that it took.
        cpu_s: Of that, what a processor worked on it.
    """
    named = [
        (effect["effect"], joint)
        for effect in report["effects"]
        if effect["confidence"] > CLAIMED
        for joint in effect["joints"]
    ]
    error = report["error"]
    return Judged(
        set_name=one.name,
        who=who,
        known=len(one.known),
        right=tuple(place for place in named if place in one.known),
        false=tuple(place for place in named if place not in one.known | one.allowed),
        verdict=report["verdict"],
        before=error["before"],
        after=error["after"],
        floor=error["noise_floor"],
        wall_s=wall_s,
        cpu_s=cpu_s,
    )


def table(answers: Sequence[Judged]) -> str:
    """Returns all answers as a table."""
    rows = [
        "| set | who | verdict | right of known | false names | before, rad | after, rad | noise | "
        "took, s | CPU, s |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in answers:
        right = f"{len(one.right)} of {one.known}" if one.known else "nothing to find"
        named = "names nothing" if one.abstained else _places(one.false)
        rows.append(
            f"| {one.set_name} | {one.who} | {one.verdict} | {right} | {named} "
            f"| {one.before:.4f} | {one.after:.4f} | {one.floor:.1g} "
            f"| {one.wall_s:.0f} | {one.cpu_s:.0f} |"
        )
    return "\n".join(rows)


def _places(places: Sequence[Place]) -> str:
    by_effect: dict[str, list[str]] = {}
    for effect, joint in places:
        by_effect.setdefault(effect, []).append(joint)
    said = [f"{effect} ({', '.join(joints)})" for effect, joints in by_effect.items()]
    return "; ".join(said) or "none"
