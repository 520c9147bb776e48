"""All names that reports tell with a confidence, and whether they are right."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from known_truth.score import is_right


@dataclass(frozen=True, kw_only=True)
class Told:
    """One name in one report.

    Attributes:
        case: Name and seed of the case: the same by whoever's hand it was simulated.
        effect: The name.
        confidence: With which it is told, 0..1.
        right: Whether it is hidden there.
        suspect: Whether it stands among the suspects, not the effects.
        evidence: Figures it rests on, as they are in the report; None where there are none.
    """

    case: str
    effect: str
    confidence: float
    right: bool
    suspect: bool
    evidence: Mapping[str, Any] | None


def all_told(folders: Sequence[Path]) -> tuple[list[Told], int]:
    """Returns what is told in all reports of folders as `diagnosis.py` makes, and their number."""
    reports = [
        path for folder in folders for path in sorted(folder.glob("diagnoses/*/report.json"))
    ]
    told: list[Told] = []
    for path in reports:
        truth = path.parents[2] / "truth" / f"{path.parent.name}.json"
        told += told_in(json.loads(truth.read_text()), json.loads(path.read_text()))
    return told, len(reports)


def told_in(truth: Mapping[str, Any], report: Mapping[str, Any]) -> list[Told]:
    """Returns what a report tells: every effect, and suspects that carry a confidence."""
    named = [(one, False) for one in report["effects"]]
    named += [(one, True) for one in report["suspects"] if one.get("confidence") is not None]
    return [
        Told(
            case=f"{truth['name']}@{truth.get('seed', 0)}",
            effect=one["effect"],
            confidence=float(one["confidence"]),
            right=is_right(one, truth, report),
            suspect=suspect,
            evidence=one.get("evidence"),
        )
        for one, suspect in named
    ]
