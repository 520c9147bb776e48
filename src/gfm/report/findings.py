"""Findings on recordings as a page tells them: what says the same is one row of a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gfm.report import words
from gfm.signals.finding import EVERYWHERE, Finding


@dataclass(frozen=True, kw_only=True)
class FindingRow:
    """The same finding in several recordings or joints, as one row of a table.

    Attributes:
        what: The property.
        recordings: Where it was found.
        joints: Of which joints; empty where it is the whole recording's.
        low: The least value.
        high: The greatest one.
        spread: Of a single value, where it is known.
        unit: Of both.
        consequence: What it means.
        doubtful: Whether it puts results in doubt.
    """

    what: str
    recordings: tuple[str, ...]
    joints: tuple[str, ...]
    low: float
    high: float
    spread: float | None
    unit: str
    consequence: str
    doubtful: bool


def gathered(findings: Iterable[Finding]) -> tuple[FindingRow, ...]:
    """Returns findings that say the same as one row each, doubtful ones first."""
    groups: dict[tuple[str, str, str, bool], list[Finding]] = {}
    for one in findings:
        groups.setdefault((one.what, one.unit, one.consequence, one.doubtful), []).append(one)
    rows = [
        FindingRow(
            what=what,
            recordings=tuple(dict.fromkeys(one.recording for one in group)),
            joints=tuple(dict.fromkeys(one.joint for one in group if one.joint is not None)),
            low=min(one.value for one in group),
            high=max(one.value for one in group),
            spread=group[0].spread if len(group) == 1 else None,
            unit=unit,
            consequence=consequence,
            doubtful=doubtful,
        )
        for (what, unit, consequence, doubtful), group in groups.items()
    ]
    return tuple(sorted(rows, key=lambda row: not row.doubtful))


def finding_amount(row: FindingRow) -> str:
    """Returns the value of a finding with its spread, or between what values it lies."""
    if row.spread is not None:
        return f"{words.number(row.low)} ± {words.quantity(row.spread, row.unit)}"
    if words.number(row.low) == words.number(row.high):
        return words.quantity(row.low, row.unit)
    return f"{words.number(row.low)} … {words.quantity(row.high, row.unit)}"


def delays_found(findings: Sequence[Finding]) -> list[str]:
    """Returns by how much the joints are late, and what that means, in lines."""
    return [
        f"{f'{words.some(row.joints)}: ' if row.joints else ''}{row.what} "
        f"{finding_amount(row)}: {row.consequence}"
        for row in gathered(findings)
        if row.recordings == (EVERYWHERE,) and row.unit == "ms"
    ]


def doubts_found(findings: Sequence[Finding]) -> int:
    """Returns how many different things put the input in doubt."""
    return len({(one.what, one.consequence) for one in findings if one.doubtful})
