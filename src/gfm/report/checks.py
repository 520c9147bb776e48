"""Checks of a model and recordings against each other, as values and as tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from rich import box
from rich.table import Table
from rich.text import Text

from gfm.report.page import render

SCHEMA = "gfm.doctor/1"


class Level(StrEnum):
    """What a check means for a diagnosis: it begins, it goes on in doubt, it says no or nothing."""

    OK = "ok"
    WARN = "warn"
    REFUSE = "refuse"


_STYLES = {Level.OK: "green", Level.WARN: "yellow", Level.REFUSE: "bold red"}


@dataclass(frozen=True, kw_only=True)
class Check:
    """One line of an examination.

    Attributes:
        name: What was checked.
        level: What that means.
        found: In words with figures.
        advice: What to do; empty where all is well.
        details: More than a line has room for; told in JSON.
    """

    name: str
    level: Level
    found: str
    advice: str = ""
    details: tuple[str, ...] = ()


def checks_table(checks: Sequence[Check]) -> Table:
    """Returns one row a check; words fold, so that nothing is lost at 80 columns."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1))
    table.add_column("")
    table.add_column("check", no_wrap=True)
    table.add_column("found, and what to do", overflow="fold")
    for one in checks:
        level = Text(str(one.level), style=_STYLES[one.level])
        words = Text(one.found)
        if one.advice:
            words.append(f"\n→ {one.advice}", style="dim")
        table.add_row(level, Text(one.name), words)
    return table


def checks_json(checks: Sequence[Check]) -> dict[str, object]:
    """Returns the document "gfm.doctor/1"."""
    rows = [{**vars(one), "level": str(one.level)} for one in checks]
    return {"schema": SCHEMA, "ok": can_begin(checks), "checks": rows}


def checks_html(checks: Sequence[Check]) -> str:
    """Returns the table as HTML for a notebook: no script, no style."""
    return render("checks.html.j2", checks=checks, total=total(checks))


def can_begin(checks: Sequence[Check]) -> bool:
    """Returns whether a diagnosis would begin."""
    return all(one.level is not Level.REFUSE for one in checks)


def total(checks: Sequence[Check]) -> str:
    """Returns what checks come to, in one line."""
    count = {level: sum(one.level is level for one in checks) for level in Level}
    told = f"{count[Level.OK]} ok, {count[Level.WARN]} to know, {count[Level.REFUSE]} refused"
    advice = "a diagnosis can begin" if can_begin(checks) else "mend what is refused first"
    return f"{told}: {advice}"
