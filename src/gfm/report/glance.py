"""The top of a diagnosis's page: what it says, in ten seconds.

Shape letters: S samples of a series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from markupsafe import Markup, escape

from gfm.core.checks import Array
from gfm.diagnosis.evidence.adequacy import ADEQUATE_RATIO
from gfm.diagnosis.evidence.plots import MISFIT
from gfm.diagnosis.output.result import (
    Diagnosis,
    ErrorSummary,
    EvidencePlot,
    NamedEffect,
    Series,
    Suspect,
    Verdict,
)
from gfm.diagnosis.output.sentences import OUT_OF_TIME
from gfm.report import words
from gfm.report.figures import BLUE, GREY, kept_samples

#: Share by which a joint's error changes at least, or nothing happened there.
CHANGED = 0.02
#: Width and height of a small picture, its margin, and samples of a series that it shows.
WIDTH, HEIGHT, MARGIN, SAMPLES = 260.0, 110.0, 4.0, 160


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One joint's error, before and after.

    Attributes:
        joint: Name.
        error: Its numbers.
        before: Length, as a share of the longest bar.
        after: Likewise.
        floor: Where the noise floor stands on the same scale.
    """

    joint: str
    error: ErrorSummary
    before: float
    after: float
    floor: float


@dataclass(frozen=True, kw_only=True)
class Card:
    """One named effect with the picture that shows it, and its caption; empty without one."""

    effect: NamedEffect
    picture: Markup = field(default_factory=Markup)
    caption: str = ""


def bars(diagnosis: Diagnosis) -> list[Bar]:
    """Returns the joints whose error changed or is no noise, in their order."""
    shown = {name: e for name, e in diagnosis.joints.items() if not _is_quiet(e)}
    longest = max((max(e.before, e.after) for e in shown.values()), default=0.0) or 1.0
    return [
        Bar(
            joint=name,
            error=e,
            before=e.before / longest,
            after=e.after / longest,
            floor=min(e.noise_floor / longest, 1.0),
        )
        for name, e in shown.items()
    ]


def quiet_joints(diagnosis: Diagnosis) -> list[str]:
    """Returns the joints on which nothing is wrong and nothing changed."""
    return [name for name, error in diagnosis.joints.items() if _is_quiet(error)]


def _is_quiet(error: ErrorSummary) -> bool:
    same = abs(error.after - error.before) <= CHANGED * error.before
    return same and error.after <= ADEQUATE_RATIO * error.noise_floor


def cards(diagnosis: Diagnosis) -> list[Card]:
    """Returns the named effects, each with a small picture."""
    return [_card(effect, diagnosis.plots) for effect in diagnosis.effects]


def _card(effect: NamedEffect, plots: Sequence[EvidencePlot]) -> Card:
    where = effect.joints[0] if len(effect.joints) == 1 else ""
    own = [p for p in plots if p.effect == effect.effect and p.joint in (where, "") and p.series]
    if not own:
        return Card(effect=effect)
    return Card(effect=effect, picture=small_picture(own[0]), caption=_caption(own[0]))


def _caption(plot: EvidencePlot) -> str:
    """Returns what a picture shows, in half a line."""
    if plot.y_label == MISFIT:
        return f"error of rollouts over {plot.x_label}; point: the fitted value"
    return f"torque that the model lacks over {plot.x_label}; points: measured, line: fitted"


def small_picture(plot: EvidencePlot) -> Markup:
    """Returns a plot as a small SVG without axes: points, and lines above them."""
    drawn = [_thinned(one) for one in plot.series]
    x, y = (np.concatenate(part) for part in zip(*drawn, strict=True))
    finite = np.isfinite(x) & np.isfinite(y)
    if not finite.any():
        return Markup()
    across, up = _scale(x[finite], WIDTH), _scale(y[finite], HEIGHT)
    parts = []
    for series, (xs, ys) in sorted(zip(plot.series, drawn, strict=True), key=_points_first):
        known = np.isfinite(xs) & np.isfinite(ys)
        places = [(across(a), HEIGHT - up(b)) for a, b in zip(xs[known], ys[known], strict=True)]
        parts.append(_line(places) if series.style == "line" else _points(places))
    return Markup(
        '<svg class="small-picture" viewBox="0 0 {} {}" role="img"><title>{}</title>{}</svg>'
    ).format(f"{WIDTH:g}", f"{HEIGHT:g}", escape(plot.title), Markup("").join(parts))


def _points_first(pair: tuple[Series, tuple[Array, Array]]) -> bool:
    return pair[0].style == "line"


def _thinned(series: Series) -> tuple[Array, Array]:
    kept = kept_samples(np.asarray(series.y, float), series.style, SAMPLES)
    return np.asarray(series.x, float)[kept], np.asarray(series.y, float)[kept]


def _scale(values: Array, length: float) -> Callable[[float], float]:
    low, high = float(values.min()), float(values.max())
    span = (high - low) or 1.0
    return lambda value: MARGIN + (length - 2.0 * MARGIN) * (value - low) / span


def _line(places: Sequence[tuple[float, float]]) -> Markup:
    path = "L".join(f"{x:.1f} {y:.1f}" for x, y in places)
    return Markup('<path d="M{}" fill="none" stroke="{}" stroke-width="2"/>').format(path, BLUE)


def _points(places: Sequence[tuple[float, float]]) -> Markup:
    """Returns points as one path of dots: strokes of no length with round ends."""
    size = 8 if len(places) == 1 else 3
    path = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in places)
    colour = BLUE if len(places) == 1 else GREY
    return Markup(
        '<path d="{}" stroke="{}" stroke-width="{}" stroke-linecap="round" opacity="0.7"/>'
    ).format(path, colour, size)


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """Returns what to do now, most important first, each in plain words."""
    return [*_with_the_model(diagnosis), *_with_recordings(diagnosis)]


def _with_the_model(diagnosis: Diagnosis) -> Iterator[str]:
    verdict, error = diagnosis.verdict, diagnosis.error
    if diagnosis.effects and error.after > error.before:
        yield "Keep the model: on held-out recordings the corrected one is further off."
    elif diagnosis.effects:
        beside = " (keep corrected.effects.json beside it)" if diagnosis.corrected_effects else ""
        yield f"Use corrected.xml in place of the model{beside}."
    elif verdict is Verdict.NO_GAP:
        yield "Keep the model: these recordings show nothing to correct."
    elif verdict is Verdict.UNEXPLAINED:
        yield "Keep the model for now: no effect is sure enough to be put into it."
    if verdict in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED):
        left = words.times(error.after, error.noise_floor)
        yield (
            f"Expect errors of {words.quantity(error.after, error.unit)}: {left} the sensor noise"
            f"{_mostly_on(diagnosis)}. `gfm fit` learns the rest as forces."
        )


def _mostly_on(diagnosis: Diagnosis) -> str:
    left = {name: one.after for name, one in diagnosis.joints.items() if math.isfinite(one.after)}
    return f", most of it on {max(left, key=lambda name: left[name])}" if len(left) > 1 else ""


def _with_recordings(diagnosis: Diagnosis) -> Iterator[str]:
    if OUT_OF_TIME in diagnosis.notes:
        yield "Give the search more time (`--minutes`): it was not at its end."
    if diagnosis.verdict is Verdict.INSUFFICIENT_DATA:
        yield "Record again: `gfm excite` plans motions that show each effect."
    likely = [one for one in diagnosis.suspects if one.confidence is not None and one.decided_by]
    if likely:
        yield f"To decide what is doubtful, record this: {'; '.join(_motions(likely))}."
    doubtful = sum(finding.doubtful for finding in diagnosis.findings)
    if doubtful:
        what = "one doubt" if doubtful == 1 else f"{doubtful} doubts"
        yield f"Look at the recordings: there {'is' if doubtful == 1 else 'are'} {what} about them."


def _motions(suspects: Sequence[Suspect]) -> list[str]:
    """Returns the motions that would decide, each with the effects that it tells of."""
    by_motion: dict[str, list[str]] = {}
    for one in sorted(suspects, key=lambda one: -(one.confidence or 0.0)):
        by_motion.setdefault(one.decided_by, []).append(words.named(one))
    return [f"{motion} ({words.some(names)})" for motion, names in [*by_motion.items()][:3]]
