"""Whether confidences are what they say: of names told with 0.8, eight of ten are right.

    python benchmarks/reliability.py runs/known_truth runs/known_truth_other [--today]

Counts every name of an effect, and every suspect that carries a confidence, in the reports that
`diagnosis.py` made where the truth is known.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import calibrate
import numpy as np
from known_truth.told import Told, all_told

from gfm.diagnosis.inference.constants import CONFIDENCE, LEAST_CONFIDENCE

DOCS = Path(__file__).parents[1] / "docs"
PAGE, FIGURE = DOCS / "results" / "confidences.md", DOCS / "images" / "reliability.svg"
BINS = 10
#: From this on a name is told for sure, and above this it is claimed.
SURE, CLAIMED = 0.9, 0.5
#: Of a normal distribution, for intervals of 95 %.
_Z = 1.96
#: Of right and wrong names, to tell what chance makes of a calibration error.
_DRAWS = 400
#: Of the diagram: side and margin, in pixels.
_SIDE, _MARGIN = 320, 50


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Names whose confidence lies in one range.

    Attributes:
        low: The least confidence that belongs here.
        high: From which on names belong to the next.
        count: How many names.
        right: How many of them are right.
        mean: Their mean confidence.
    """

    low: float
    high: float
    count: int
    right: int
    mean: float

    @property
    def share(self) -> float:
        """Share of right names."""
        return self.right / self.count


def bins_of(told: Sequence[Told]) -> list[Bin]:
    """Returns the bins that hold names; a confidence of 1 belongs to the last."""
    made = []
    for low, high in pairwise(i / BINS for i in range(BINS + 1)):
        here = [t for t in told if low <= t.confidence < high or t.confidence == high == 1.0]
        if here:
            mean = sum(t.confidence for t in here) / len(here)
            right = sum(t.right for t in here)
            made.append(Bin(low=low, high=high, count=len(here), right=right, mean=mean))
    return made


def calibration_error(bins: Sequence[Bin]) -> float:
    """Returns the expected calibration error (Naeini et al. 2015), 0..1; nought of nothing."""
    total = sum(b.count for b in bins)
    return sum(b.count * abs(b.share - b.mean) for b in bins) / total if total else 0.0


def error_by_chance(told: Sequence[Told]) -> tuple[float, float]:
    """Returns the calibration error that true confidences would show: mean and upper 95 %.

    With few names, shares of right ones scatter about confidences that are what they say.
    """
    rng = random.Random(0)
    errors = sorted(
        calibration_error(
            bins_of([replace(one, right=rng.random() < one.confidence) for one in told])
        )
        for _ in range(_DRAWS)
    )
    return sum(errors) / _DRAWS, errors[int(0.95 * _DRAWS)]


def wilson(right: int, count: int) -> tuple[float, float]:
    """Returns the 95 % interval of a share (Wilson 1927)."""
    share, spread = right / count, _Z**2 / count
    middle = share + 0.5 * spread
    half = _Z * math.sqrt(share * (1.0 - share) / count + 0.25 * spread / count)
    return max((middle - half) / (1.0 + spread), 0.0), min((middle + half) / (1.0 + spread), 1.0)


def share_of(told: Sequence[Told]) -> str:
    """Returns how many of some names are right."""
    if not told:
        return "none told"
    right = sum(t.right for t in told)
    return f"{right} of {len(told)} ({100 * right / len(told):.0f} %)"


def table(bins: Sequence[Bin]) -> str:
    """Returns one line per bin."""
    lines = [
        "| confidence | names | mean confidence | right | 95 % interval |",
        "|---|---|---|---|---|",
    ]
    for b in bins:
        low, high = wilson(b.right, b.count)
        lines.append(
            f"| {b.low:.1f}-{b.high:.1f} | {b.count} | {b.mean:.2f} | {b.share:.2f} "
            f"| {low:.2f}-{high:.2f} |"
        )
    return "\n".join(lines)


def figures(told: Sequence[Told]) -> str:
    """Returns the numbers of some names in one table."""
    wrong = [t for t in told if not t.right]
    claimed = [t for t in wrong if t.confidence > CLAIMED]
    chance, upper = error_by_chance(told)
    share = f" ({100 * len(claimed) / len(wrong):.0f} %)" if wrong else ""
    rows = (
        ("names", str(len(told))),
        ("expected calibration error", f"{calibration_error(bins_of(told)):.3f}"),
        ("the same if confidences were true: mean, 95 %", f"{chance:.3f}, {upper:.3f}"),
        ("right, of all", share_of(told)),
        (
            f"right, of those told with {SURE:g} to 1",
            share_of([t for t in told if t.confidence >= SURE]),
        ),
        (
            f"right, of those told with more than {CLAIMED:g}",
            share_of([t for t in told if t.confidence > CLAIMED]),
        ),
        (
            f"wrong names told with more than {CLAIMED:g}",
            f"{len(claimed)} of {len(wrong)}{share}",
        ),
    )
    return "\n".join(["| | |", "|---|---|", *(f"| {name} | {value} |" for name, value in rows)])


def diagram(bins: Sequence[Bin]) -> str:
    """Returns the reliability diagram as SVG: share of right names over mean confidence."""

    def x(value: float) -> float:
        return round(_MARGIN + _SIDE * value, 1)

    def y(value: float) -> float:
        return round(10 + _SIDE * (1.0 - value), 1)

    size = _SIDE + _MARGIN + 10
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size}" height="{size}" '
        f'viewBox="0 0 {size} {size}" font-family="sans-serif" font-size="11">',
        f'<rect width="{size}" height="{size}" fill="#ffffff"/>',
        f'<rect x="{x(0)}" y="{y(1)}" width="{_SIDE}" height="{_SIDE}" fill="none" stroke="#000"/>',
        f'<path d="M{x(0)} {y(0)}L{x(1)} {y(1)}" stroke="#999" stroke-dasharray="4 3"/>',
    ]
    for tick in (0.0, 0.2, 0.4, 0.6, 0.8, 1.0):
        parts += [
            f'<text x="{x(tick)}" y="{y(0) + 15}" text-anchor="middle">{tick:g}</text>',
            f'<text x="{x(0) - 6}" y="{y(tick) + 4}" text-anchor="end">{tick:g}</text>',
        ]
    for b in bins:
        low, high = wilson(b.right, b.count)
        parts += [
            f'<path d="M{x(b.mean)} {y(low)}L{x(b.mean)} {y(high)}" stroke="#1f77b4"/>',
            f'<circle cx="{x(b.mean)}" cy="{y(b.share)}" r="4" fill="#1f77b4"/>',
            f'<text x="{x(b.mean) + 6}" y="{y(b.share) + 4}">{b.count}</text>',
        ]
    middle = y(0.5)
    parts += [
        f'<text x="{x(0.5)}" y="{y(0) + 35}" text-anchor="middle">mean confidence</text>',
        f'<text x="14" y="{middle}" text-anchor="middle" transform="rotate(-90 14 {middle})">'
        "share of right names</text>",
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def document(told: Sequence[Told], reports: int, figure: str, made: str = "") -> str:
    """Returns the page.

    Args:
        told: All names.
        reports: In how many reports.
        figure: Where the diagram lies, from the page.
        made: How reports and page were made.
    """
    named = [t for t in told if not t.suspect]
    suspected = [t for t in told if t.suspect]
    sections = [
        "# Whether confidences are what they say",
        f"Names told about robots (reports: {reports}). On a simulated one a name is right if it "
        "or one that is told with it is hidden there on these joints, or if physics cannot tell "
        "it from the truth and the truth stands beside it as its equal; on a measured one, if both "
        "halves of the recordings bear it out.",
        *([made] if made else []),
        f"![share of right names over confidence; bars are 95 % intervals, numbers count names]"
        f"({figure})",
        "## Effects and suspects",
        table(bins_of(told)),
        figures(told),
        "## Effects only",
        table(bins_of(named)),
        figures(named),
    ]
    if suspected:
        sections += ["## Suspects only", table(bins_of(suspected)), figures(suspected)]
    return "\n\n".join(sections) + "\n"


def by_todays_weights(told: Sequence[Told]) -> list[Told]:
    """Returns names with the confidences that today's weights make of their evidence.

    Those without evidence are left out.
    """
    anew = []
    for one in told:
        row = calibrate.features(one.evidence)
        if row is not None:
            (sure,) = calibrate.confidence(row[None], np.array(CONFIDENCE))
            anew.append(replace(one, confidence=float(sure), suspect=sure < LEAST_CONFIDENCE))
    return anew


def commits(folders: Sequence[Path]) -> list[str]:
    """Returns the commits at which the reports were made."""
    files = [path for folder in folders for path in folder.glob("diagnoses/*/made.json")]
    return sorted({json.loads(path.read_text())["commit"] for path in files})


def main() -> None:
    """Collects what reports tell, prints tables, writes page and diagram."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="+", type=Path, metavar="DIR")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    parser.add_argument(
        "--today", action="store_true", help="weigh the evidence of reports by today's weights"
    )
    asked = parser.parse_args()
    told, reports = all_told(asked.folders)
    told = by_todays_weights(told) if asked.today else told
    ours = asked.page == PAGE
    figure = FIGURE if ours else asked.page.with_suffix(".svg")
    for file in (asked.page, figure):
        file.parent.mkdir(parents=True, exist_ok=True)
    figure.write_text(diagram(bins_of(told)), encoding="utf-8")
    flags = ["--today"] if asked.today else []
    words = shlex.join(["python", "benchmarks/reliability.py", *map(str, asked.folders), *flags])
    made = f"Written by `{words}`, diagnosed at {', '.join(commits(asked.folders))}."
    if asked.today:
        weights = ", ".join(f"{weight:g}" for weight in CONFIDENCE)
        made += f" Confidences are those of the evidence by the weights {weights}."
    text = document(told, reports, "../images/reliability.svg" if ours else figure.name, made)
    asked.page.write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
