"""All names that reports tell with a confidence, and whether they are right."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from known_truth.score import is_right

#: Beside the report on a measured robot: which of its names both halves of the recordings bear out.
HALVES = "halves.json"


@dataclass(frozen=True, kw_only=True)
class Told:
    """One name in one report.

    Attributes:
        case: Name and seed of the case: the same by whoever's hand it was simulated.
        effect: The name.
        confidence: With which it is told, 0..1.
        right: Whether it is hidden there; on a measured robot, whether both halves bear it out.
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
    """Returns what is told in all reports of folders, and their number.

    Folders are as `diagnosis.py` makes them, or as `measured.py` does and `halves.py` judges them.
    """
    reports = [
        path for folder in folders for path in sorted(folder.glob("diagnoses/*/report.json"))
    ]
    told: list[Told] = []
    for path in reports:
        truth = path.parents[2] / "truth" / f"{path.parent.name}.json"
        told += told_in(json.loads(truth.read_text()), json.loads(path.read_text()))
    judged = [path for folder in folders for path in sorted(folder.glob(f"*/diagnosis/{HALVES}"))]
    for path in judged:
        report = json.loads(path.with_name("report.json").read_text())
        told += told_of_measured(path.parents[1].name, json.loads(path.read_text()), report)
    return told, len(reports) + len(judged)


def told_in(truth: Mapping[str, Any], report: Mapping[str, Any]) -> list[Told]:
    """Returns what a report tells of a robot whose truth is known."""
    case = f"{truth['name']}@{truth.get('seed', 0)}"
    return [_told(case, one, is_right(one, truth, report), report) for one in _sure_of(report)]


def told_of_measured(
    robot: str, halves: Sequence[Mapping[str, Any]], report: Mapping[str, Any]
) -> list[Told]:
    """Returns what a report tells of a measured robot, as far as halves were asked about it."""
    borne = {(one["effect"], *one["joints"]): bool(one["borne_out"]) for one in halves}
    asked = [one for one in _sure_of(report) if (one["effect"], *one["joints"]) in borne]
    return [_told(robot, one, borne[one["effect"], *one["joints"]], report) for one in asked]


def _sure_of(report: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Returns every effect, and the suspects that carry a confidence."""
    suspects = [one for one in report["suspects"] if one.get("confidence") is not None]
    return [*report["effects"], *suspects]


def _told(case: str, one: Mapping[str, Any], right: bool, report: Mapping[str, Any]) -> Told:
    return Told(
        case=case,
        effect=one["effect"],
        confidence=float(one["confidence"]),
        right=right,
        suspect=one not in report["effects"],
        evidence=one.get("evidence"),
    )
