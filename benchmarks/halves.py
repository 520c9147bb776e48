"""Whether two halves of a robot's recordings agree on what all of them together named.

    python benchmarks/halves.py --data ../shared/data/measured --out runs/measured

Reads the reports that `measured.py` has left in the folder. Training recordings are dealt out in
turn; what was named, and what is a suspect, is fitted to each half anew, from the amounts of all. A
half bears a name out if it predicts clearly better with it; both agree on an amount if the
difference is within what is told beside it (the 95 % interval, or the spread where the model stays
wrong) of both together. Nothing is searched for: what a half alone would name instead is not asked.
What acts now and then is taken as it was told: a few segments judge it, which a half may lack.

What both halves bear out is written beside the report (`halves.json`): `calibrate.py` reads it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
from known_truth.told import HALVES
from measured import RIGS, Rig, find_model
from parts import commit, print_or_write

from gfm.api.models import load_specs
from gfm.api.recordings import read_recordings
from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import LONG, all_segments, prepared
from gfm.diagnosis.found import SETTLED_S
from gfm.diagnosis.inference.amounts import amounts, free_parameters
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.output.claims import SPREAD_WIDTH, widths_of
from gfm.diagnosis.search.hypothesis import nominal_hypothesis, settled_hypothesis
from gfm.diagnosis.search.moves.reduce import gains_of_each
from gfm.effects import EffectInstance, Key, find_effect
from gfm.service.effects_file import read_effects

_HEAD = """# Halves of measured recordings

Do two disjoint halves of a robot's recordings agree on what all of them together named? Written by

    python benchmarks/halves.py --data DIR --out runs/measured

at {commit}. Training recordings are dealt out in turn; what was named is fitted to each half anew,
beginning with the amounts of all; so are suspects (a confidence below one half), beside the names.
"Standard errors": by how many of its own each half predicts better with the effect; more than two
bear the name out. Behind the amounts stands what is told
beside them: the 95 % interval, or the spread where the model stays wrong; "inf" where a half does
not tell.
"""


@dataclass(frozen=True, kw_only=True)
class Half:
    """What half of the recordings says of effects.

    Attributes:
        gains: By how much it predicts better with each.
        values: Amounts, by effect and parameter.
        widths: What is told beside them: half of a 95 % interval, or a spread, likewise.
    """

    gains: Mapping[Key, Difference]
    values: Mapping[tuple[Key, str], float]
    widths: Mapping[tuple[Key, str], float]


def told_by(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    effects: Sequence[EffectInstance],
) -> Half:
    """Returns what some recordings say of effects, those fitted to them that act all the time."""
    rare = [one for one in effects if one.effect.intermittent]
    effects = [one for one in effects if one not in rare]
    problem = prepared(all_segments(specs, recordings, given=rare, windows_s=LONG), SETTLED_S)
    nominal = nominal_hypothesis(problem).nominal
    here = settled_hypothesis(problem, effects, nominal)
    fitted = here.fit
    free = [(fitted.effects[i].key, name) for i, name in free_parameters(fitted.effects)]
    widths, holds = widths_of(fitted, here.problem)
    told = 1.0 if holds else SPREAD_WIDTH
    return Half(
        gains={one.key: gain for gain, one in gains_of_each(here)},
        values=dict(zip(free, amounts(fitted.effects).tolist(), strict=True)),
        widths=dict(zip(free, (told * widths).tolist(), strict=True)),
    )


def rows_of(
    halves: tuple[Half, Half], effects: Sequence[EffectInstance], told: Mapping[Key, float]
) -> Iterator[str]:
    """Yields a line of a table for every amount."""
    for (key, name), first in halves[0].values.items():
        second = halves[1].values[key, name]
        widths = [half.widths[key, name] for half in halves]
        gains = [half.gains[key] for half in halves]
        borne = "yes" if all(gain.clear for gain in gains) else "**no**"
        agree = "yes" if abs(first - second) <= math.hypot(*widths) else "**no**"
        amount = next(e.values[name] for e in effects if e.key == key)
        both = " | ".join(
            f"{value:.4g} ± {width:.2g}"
            for value, width in zip((first, second), widths, strict=True)
        )
        yield (
            f"| {key[0]} on {', '.join(key[1])} | {told[key]:.2f} | {name} {amount:.4g} | {both} "
            f"| {' / '.join(f'{gain.errors:.1f}' for gain in gains)} | {borne} | {agree} |"
        )


def suspects_in(document: Mapping[str, Any]) -> list[EffectInstance]:
    """Returns the suspects of a report that were found: those that have amounts."""
    return [
        EffectInstance(
            effect=find_effect(one["effect"]), joints=tuple(one["joints"]), values=one["amounts"]
        )
        for one in document["suspects"]
        if one.get("amounts")
    ]


def borne_out(halves: tuple[Half, Half]) -> list[dict[str, Any]]:
    """Returns of each effect that was asked whether both halves predict clearly better with it."""
    first, second = halves
    return [
        {"effect": key[0], "joints": key[1], "borne_out": gain.clear and second.gains[key].clear}
        for key, gain in first.gains.items()
    ]


def section(rig: Rig, name: str, data: Path, folder: Path) -> str:
    """Returns one robot's part of the page, and leaves beside its report what both halves say."""
    document = json.loads((folder / "diagnosis" / "report.json").read_text())
    paths = sorted((folder / "recordings").glob("*.mcap"))
    training = [one for one in paths if not any(part in one.name for part in rig.held_out)]
    effects = [*read_effects(folder / "diagnosis" / "report.json"), *suspects_in(document)]
    every = document["effects"] + document["suspects"]
    told = {(e["effect"], tuple(e["joints"])): e.get("confidence") for e in every}
    recordings = read_recordings(training)
    specs = load_specs([find_model(rig, data)])
    halves = (
        told_by(specs, recordings[::2], effects),
        told_by(specs, recordings[1::2], effects),
    )
    (folder / "diagnosis" / HALVES).write_text(json.dumps(borne_out(halves)), encoding="utf-8")
    rows = "\n".join(rows_of(halves, effects, told))
    return f"""## {name}

{len(recordings[::2])} and {len(recordings[1::2])} recordings.

| name | confidence | amount | first half | second half | standard errors | borne out | agree |
|---|---|---|---|---|---|---|---|
{rows}
"""


def main() -> int:
    """Compares the halves of the sets that have a report."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--set", action="append", choices=sorted(RIGS), dest="sets")
    parser.add_argument("--page", type=Path, metavar="FILE")
    asked = parser.parse_args()
    there = [n for n in RIGS if (asked.out / n / "diagnosis" / "report.json").exists()]
    sections = [
        section(RIGS[name], name, asked.data, asked.out / name) for name in asked.sets or there
    ]
    print_or_write(f"{_HEAD.format(commit=commit())}\n" + "\n".join(sections), asked.page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
