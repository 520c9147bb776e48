"""How the fit of a GFM went: reward, error, losses and KL divergence over wall-clock time."""

from __future__ import annotations

import html
from collections.abc import Sequence
from itertools import cycle

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from gfm.report.figures import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    Picture,
    compact,
    kept_samples,
    styled,
)
from gfm.report.run import CurveGroup, TrainingCurve

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, INK)
_PANELS = {
    CurveGroup.REWARD: "reward",
    CurveGroup.ERROR: "error of open-loop rollouts",
    CurveGroup.LOSS: "loss",
    CurveGroup.KL: "KL divergence",
}
# Spans orders of magnitude: the constraint on the covariance is far below that on the mean.
_LOGARITHMIC = {CurveGroup.KL}


def training_picture(curves: Sequence[TrainingCurve], limit: int) -> Picture:
    """Returns the fit of the GFM over wall-clock time, one panel per group of curves."""
    groups = [group for group in _PANELS if any(curve.group == group for curve in curves)]
    rows = (len(groups) + 1) // 2
    figure = make_subplots(rows=rows, cols=2, vertical_spacing=0.3 / rows, horizontal_spacing=0.12)
    for index, group in enumerate(groups):
        _fill_panel(figure, index, [curve for curve in curves if curve.group == group], limit)
    styled(figure, height=110 + 290 * rows)
    figure.update_xaxes(title_text="wall-clock time (s)")
    figure.update_layout(margin_t=64, **_legends(figure, len(groups)))
    caption = (
        "Look for a reward that rises and levels off, an error that falls below that of the "
        "nominal model, and a KL divergence that settles at its limit: far above it the policy "
        "jumps, far below it the policy stands still. Hover a point for its learner step."
    )
    return Picture(title="How the GFM's fit went", caption=caption, figure=figure)


def _fill_panel(figure: go.Figure, index: int, curves: Sequence[TrainingCurve], limit: int) -> None:
    place = {"row": index // 2 + 1, "col": index % 2 + 1}
    for curve, colour in zip(curves, cycle(_COLOURS), strict=False):
        line = _trace(curve, colour, limit)
        figure.add_trace(line.update(legend=_legend_name(index)), **place)
    group = curves[0].group
    units = ", ".join(sorted({curve.unit for curve in curves} - {"", "1"}))
    label = f"{_PANELS[group]} ({units})" if units else _PANELS[group]
    scale = {"type": "log", "dtick": 1} if group in _LOGARITHMIC else {}
    figure.update_yaxes(title_text=html.escape(label), **scale, **place)


def _trace(curve: TrainingCurve, colour: str, limit: int) -> go.Scatter:
    kept = kept_samples(np.asarray(curve.value, float), "line", limit)
    return go.Scatter(
        x=compact(curve.wall_clock_s[kept]),
        y=compact(curve.value[kept]),
        customdata=curve.learner_steps[kept].astype(np.int32),
        hovertemplate="%{y:.4g} at learner step %{customdata}",
        name=html.escape(curve.label),
        mode="lines",
        line={"color": colour, "width": 2},
    )


def _legend_name(panel: int) -> str:
    return f"legend{panel + 1}" if panel else "legend"


def _legends(figure: go.Figure, panels: int) -> dict[str, object]:
    """Returns one legend for each panel, above it."""
    legends: dict[str, object] = {}
    for panel in range(panels):
        plot = figure.get_subplot(panel // 2 + 1, panel % 2 + 1)
        place = {"x": plot.xaxis.domain[0], "y": plot.yaxis.domain[1], "yanchor": "bottom"}
        legends[_legend_name(panel)] = {**place, "orientation": "h", "font_size": 12}
    return legends
