"""What training should draw from: amounts of a robot, from several sets of recordings, as TOML."""

from __future__ import annotations

import json

from gfm.diagnosis.output.changes import Changes, SetAmount

SCHEMA = "gfm.ranges/1"
_HEAD = """\
# What recordings of one robot say of its amounts, to be added to the model that was diagnosed (not
# to corrected.xml). Training draws each amount between low and high: see docs/tasks.md.
"""


def ranges_toml(changes: Changes) -> str:
    """Returns a file with the range of every amount that is more likely right than wrong."""
    by_effect: dict[object, list[SetAmount]] = {}
    for one in changes.amounts:
        if one.credible:
            by_effect.setdefault(one.key, []).append(one)
    tables = [_table(own) for own in by_effect.values()]
    return _HEAD + "\n".join([f"schema = {_text(SCHEMA)}\n", *tables])


def _table(own: list[SetAmount]) -> str:
    first = own[0]
    lines = [
        "[[effects]]",
        f"effect = {_text(first.effect)}",
        f"joints = {_text(first.joints)}",
        f"course = {_text(first.course.value)}",
        "[effects.parameters]",
    ]
    for one in own:
        numbers = {"mean": one.mean, "spread": one.spread, "low": one.low, "high": one.high}
        pairs = ", ".join(f"{name} = {value!r}" for name, value in numbers.items())
        lines.append(f"{one.parameter} = {{ {pairs}, unit = {_text(one.unit)} }}")
    return "\n".join(lines) + "\n"


def _text(value: object) -> str:
    """Returns text, or a list of texts, as TOML has it: as JSON."""
    return json.dumps(value, ensure_ascii=False)
