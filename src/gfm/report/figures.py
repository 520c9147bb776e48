"""Pictures of a diagnosis: few enough points to open at once, axes with units, a caption each.

Shape letters: S samples of a series, K samples kept, J joints.
"""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.diagnosis.output.result import Diagnosis, ErrorSummary, EvidencePlot, Series
from gfm.report import words

SERIES_POINTS = 2000
# Packed, plotly.js takes 1.84 of the 2 MB that a report may have, and a point about 7 bytes.
PAGE_POINTS = 9_000
#: Points that a page has less with a film.
FILM_POINTS = 3_000

#: From here on only whole decades are written beside a logarithmic axis.
_MOST_DECADES = 1.5

INK = "#1f2328"
GREY = "#6e7781"
FLOOR = "rgba(110, 119, 129, 0.22)"
# Okabe and Ito: told apart by every kind of eye.
BLUE, ORANGE, GREEN, PURPLE, SKY = "#0072b2", "#d55e00", "#009e73", "#aa4499", "#56b4e9"
_LINES = (ORANGE, BLUE, GREEN, PURPLE, INK)
_POINTS = (GREY, SKY, "#cc9a06")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A plotly figure with its headline and what to look for in it."""

    title: str
    caption: str
    figure: go.Figure


def points_per_series(series: int, *, film: bool = False) -> int:
    """Returns how many points each of the page's series may keep."""
    points = PAGE_POINTS - (FILM_POINTS if film else 0)
    return max(60, min(SERIES_POINTS, points // max(1, series)))


def kept_samples(y: Array, style: str, limit: int) -> NDArray[np.intp]:
    """Returns the indices of at most `limit` samples to draw, increasing, shape (K,).

    Of a line, every stretch keeps its lowest and its highest sample, so that no peak is lost; of
    a cloud of points, every n-th is kept.

    Args:
        y: shape (S,).
        style: "line" or "points".
        limit: At least 4.
    """
    samples = len(y)
    if samples <= limit:
        return np.arange(samples)
    if style != "line":
        return np.linspace(0, samples - 1, limit).round().astype(np.intp)
    edges = np.linspace(0, samples, (limit - 2) // 2 + 1).astype(np.intp)
    low, high = np.where(np.isnan(y), np.inf, y), np.where(np.isnan(y), -np.inf, y)
    stretches = [slice(a, b) for a, b in pairwise(edges)]
    lowest = [part.start + int(np.argmin(low[part])) for part in stretches]
    highest = [part.start + int(np.argmax(high[part])) for part in stretches]
    return np.unique([0, *lowest, *highest, samples - 1])


def compact(values: Array) -> NDArray[np.floating]:
    """Returns the values in single precision where that cannot be seen; infinity becomes a gap."""
    finite = np.where(np.isfinite(values), values, np.nan)
    if not np.isfinite(finite).any():
        return finite.astype(np.float32)
    span = np.nanmax(finite) - np.nanmin(finite)
    visible = 1e-4 * span > np.spacing(np.float32(np.nanmax(np.abs(finite))))
    return finite.astype(np.float32) if visible or span == 0.0 else finite


def trace(series: Series, limit: int, **style: object) -> go.Scatter:
    """Returns the series as a plotly trace of at most `limit` points."""
    x, y = np.asarray(series.x, float), np.asarray(series.y, float)
    kept = kept_samples(y, series.style, limit)
    return go.Scatter(
        x=compact(x[kept]),
        y=compact(y[kept]),
        name=html.escape(series.label),
        mode="lines" if series.style == "line" else "markers",
        **style,
    )


def styled(figure: go.Figure, *, height: int, legend: bool = True) -> go.Figure:
    """Returns the figure in the house style: white, thin grid, legend above the plot."""
    axis = {
        "showgrid": True,
        "gridcolor": "#e6e8eb",
        "zerolinecolor": "#afb8c1",
        "linecolor": "#afb8c1",
        "automargin": True,
        "ticks": "outside",
        "tickcolor": "#afb8c1",
        "exponentformat": "power",
    }
    figure.update_layout(
        template=go.layout.Template(),
        height=height,
        margin={"l": 64, "r": 16, "t": 36 if legend else 12, "b": 48},
        font={"family": "system-ui, sans-serif", "size": 13, "color": INK},
        paper_bgcolor="white",
        plot_bgcolor="white",
        showlegend=legend,
        legend={"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"},
        hovermode="closest",
    )
    figure.update_xaxes(**axis)
    figure.update_yaxes(**axis)
    return figure


def evidence_picture(plot: EvidencePlot, limit: int) -> Picture:
    """Returns the picture of one piece of evidence, points below lines, a mark above."""
    figure = go.Figure()
    marks = _marks_on_lines(plot)
    for style, colours in (("points", _POINTS), ("line", _LINES)):
        for index, series in enumerate(
            one for one in plot.series if one.style == style and id(one) not in marks
        ):
            colour = colours[index % len(colours)]
            look: dict[str, object] = {"line": {"color": colour, "width": 2.5}}
            if style == "points":
                look = {"marker": {"color": colour, "size": 4, "opacity": 0.5}}
            figure.add_trace(trace(series, limit, **look))
    for series in marks.values():
        figure.add_trace(trace(series, limit, marker={"color": BLUE, "size": 10}))
    styled(figure, height=380)
    figure.update_xaxes(title_text=html.escape(plot.x_label))
    figure.update_yaxes(title_text=html.escape(plot.y_label))
    return Picture(title=plot.title, caption=words.look_for(plot), figure=figure)


def _marks_on_lines(plot: EvidencePlot) -> dict[int, Series]:
    """Returns the single points that stand on a plot's lines, by their identity."""
    if all(one.style != "line" for one in plot.series):
        return {}
    return {id(one): one for one in plot.series if one.style == "points" and len(one.x) == 1}


def joint_error_picture(joints: Mapping[str, ErrorSummary], unit: str) -> Picture:
    """Returns before and after per joint, the noise floor beside."""
    errors = joints.values()
    rows = (
        Dots(label="before: the model as given", colour=ORANGE, x=[one.before for one in errors]),
        Dots(label="after: the corrected model", colour=BLUE, x=[one.after for one in errors]),
        floor_dots([one.noise_floor for one in errors]),
    )
    caption = (
        "Look for the blue dots at the grey marks: there the corrected model predicts as well as "
        "the sensors can tell. A joint whose blue dot stays far to the right still misses "
        "something. The scale is logarithmic."
    )
    figure = dots_figure([*joints], rows, f"held-out position RMSE ({unit})")
    return Picture(title="Held-out error per joint", caption=caption, figure=figure)


@dataclass(frozen=True, kw_only=True)
class Dots:
    """One dot for every line of a picture."""

    label: str
    colour: str
    x: Sequence[float]
    symbol: str = "circle"


def floor_dots(floors: Sequence[float]) -> Dots:
    """Returns the noise floor of every joint as an upright mark."""
    return Dots(label="noise floor", colour=GREY, x=floors, symbol="line-ns-open")


def dots_figure(lines: Sequence[str], rows: Sequence[Dots], x_label: str) -> go.Figure:
    """Returns dots on one line per joint, logarithmic; what is not above 0 is left out."""
    figure = go.Figure()
    for row in rows:
        dots = go.Scatter(
            x=[value if value > 0.0 and math.isfinite(value) else None for value in row.x],
            y=[html.escape(line) for line in lines],
            name=row.label,
            mode="markers",
            marker={"color": row.colour, "size": 12, "symbol": row.symbol, "line": {"width": 2}},
        )
        figure.add_trace(dots)
    styled(figure, height=160 + 30 * len(lines))
    figure.update_traces(marker_line_color="white", selector={"marker.symbol": "circle"})
    # Ticks at 1, 2 and 5 of every decade, written out; of many decades these overlap on a phone.
    dtick = "D2" if _decades(rows) < _MOST_DECADES else 1
    figure.update_xaxes(type="log", dtick=dtick, tickformat=".3~g", title_text=html.escape(x_label))
    # An explicit type: joints that are called "1" and "2" are no numbers here.
    figure.update_yaxes(title_text="joint", type="category", autorange="reversed")
    return figure


def _decades(rows: Sequence[Dots]) -> float:
    shown = [value for row in rows for value in row.x if value > 0.0 and math.isfinite(value)]
    return math.log10(max(shown) / min(shown)) if shown else 0.0


def series_count(diagnosis: Diagnosis) -> int:
    """Returns how many long series the diagnosis draws."""
    return sum(len(plot.series) for plot in diagnosis.plots)
