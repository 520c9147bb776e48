"""A campaign for people and programs: a policy on the robot, before and after what was learned."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from gfm.report.evaluation import Evaluation, evaluation_json, paths_picture
from gfm.report.figures import Picture
from gfm.report.page import render_page

SCHEMA = "gfm.transfer/1"
#: What was done to a policy, in words.
TITLES = {
    "placed": "unchanged, the tool placed by the corrected model",
    "told": "unchanged, the robot told of its payload",
    "adapted": "adapted to the corrected model",
    "corrected": "trained again on the corrected model",
    "nominal": "trained again on the nominal model",
    "randomised": "trained again on the nominal model with randomised dynamics",
}


@dataclass(frozen=True, kw_only=True)
class Treatment:
    """A policy on the robot after something was done to it.

    Attributes:
        name: What was done to it.
        evaluation: What came of it.
    """

    name: str
    evaluation: Evaluation

    @property
    def title(self) -> str:
        """What was done, in words."""
        return TITLES[self.name]


@dataclass(frozen=True, kw_only=True)
class Films:
    """Films of one target before and after.

    Attributes:
        goal: Its number.
        files: Beside the report, by what was done to the policy, in words.
        missing: Why there are none; empty where there are.
    """

    goal: int = 0
    files: Mapping[str, str] = field(default_factory=dict)
    missing: str = ""

    def __bool__(self) -> bool:
        """Says whether it is known what there is."""
        return bool(self.files or self.missing)


@dataclass(frozen=True, kw_only=True)
class Transfer:
    """What a campaign says.

    Attributes:
        before: The policy that began, on the robot.
        treatments: The same after what was done to it.
        diagnosis: Of the recordings of before, as its report.json has it.
        films: Of one target before and after.
        air_s: How long the arm was recorded by itself, in the air, s.
        provenance: Files, versions, seed and command.
    """

    before: Evaluation
    treatments: tuple[Treatment, ...]
    diagnosis: Mapping[str, Any]
    films: Films
    air_s: float = 0.0
    provenance: Mapping[str, object]

    @property
    def rows(self) -> list[tuple[str, Evaluation]]:
        """Every policy in words, with what came of it."""
        return [("as it came", self.before), *((t.title, t.evaluation) for t in self.treatments)]

    @property
    def sentence(self) -> str:
        """The result in one line."""
        told = "; ".join(f"{one.reached} of {one.of} {title}" for title, one in self.rows)
        return f"{self.before.task.name}, {self.before.where}: {told}"

    def pictures(self) -> list[Picture]:
        """Returns the ways of the object under every policy."""
        return [
            replace(paths_picture(one), title=f"Ways of the object: {title}")
            for title, one in self.rows
        ]


def transfer_json(transfer: Transfer) -> dict[str, object]:
    """Returns the document "gfm.transfer/1"."""
    return {
        "schema": SCHEMA,
        "sentence": transfer.sentence,
        "diagnosis": {
            name: transfer.diagnosis[name] for name in ("verdict", "sentence", "effects")
        },
        "air_s": transfer.air_s,
        "before": evaluation_json(transfer.before),
        "after": {one.name: evaluation_json(one.evaluation) for one in transfer.treatments},
        "provenance": dict(transfer.provenance),
    }


def transfer_texts(transfer: Transfer) -> dict[str, str]:
    """Returns the report's files by name."""
    document = json.dumps(transfer_json(transfer), indent=2, allow_nan=False)
    page = render_page("transfer.html.j2", transfer=transfer, pictures=transfer.pictures())
    return {"report.json": document + "\n", "report.html": page}


def print_transfer(console: Console, transfer: Transfer) -> None:
    """Prints what was found, and a line per policy."""
    console.print(Text(transfer.sentence, style="bold"))
    console.print(Text(str(transfer.diagnosis["sentence"])))
    table = Table("policy", "reached", "95 % interval", "most failures")
    for title, one in transfer.rows:
        low, high = one.interval
        table.add_row(
            title,
            f"{one.reached} of {one.of}",
            f"{low:.0%} to {high:.0%}",
            next(iter(one.failures), "–"),
        )
    console.print(table)
