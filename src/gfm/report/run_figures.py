"""Pictures of a whole run: joint control, residuals over time, how the GFM's fit went.

Shape letters: T samples of a rollout, J joints.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from gfm.core.checks import Array
from gfm.diagnosis.result import Series
from gfm.report.figures import (
    BLUE,
    FLOOR,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    Picture,
    compact,
    kept_samples,
    series_count,
    styled,
    trace,
)
from gfm.report.run import (
    Comparison,
    CurveGroup,
    HeldOutRollout,
    ModelKind,
    RunReport,
    TrainingCurve,
)
from gfm.report.words import number

MODEL_TITLES = {
    ModelKind.NOMINAL: "nominal",
    ModelKind.IDENTIFIED: "identified (SLSQP)",
    ModelKind.HYBRID: "hybrid (GFM)",
    ModelKind.CORRECTED: "corrected (named effect)",
}
_MODEL_COLOURS = {
    ModelKind.NOMINAL: ORANGE,
    ModelKind.IDENTIFIED: PURPLE,
    ModelKind.HYBRID: GREEN,
    ModelKind.CORRECTED: BLUE,
}
_CURVE_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, INK)


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """One panel of the training figure."""

    group: CurveGroup
    title: str
    logarithmic: bool


_PANELS = (
    _Panel(group=CurveGroup.REWARD, title="reward", logarithmic=False),
    _Panel(group=CurveGroup.ERROR, title="held-out error", logarithmic=False),
    _Panel(group=CurveGroup.LOSS, title="losses", logarithmic=False),
    _Panel(group=CurveGroup.KL, title="KL divergence", logarithmic=True),
)


def run_series_count(report: RunReport) -> int:
    """Returns how many long series the whole run draws."""
    rollouts = sum(
        (len(one.joints) + 1) * len(one.predicted) + len(one.joints) + 3 for one in report.rollouts
    )
    return series_count(report.diagnosis) + rollouts + len(report.training)


def rollout_rmse(measured: Array, predicted: Array) -> float:
    """Returns the root mean square of their difference where both are known, rad; NaN if never."""
    squares = np.square(measured - predicted)
    known = np.isfinite(squares)
    return float(np.sqrt(squares[known].mean())) if known.any() else float("nan")


def joint_control_picture(rollout: HeldOutRollout, limit: int) -> Picture:
    """Returns the base joint over time: what was asked, what it did, what each model predicts."""
    figure = go.Figure()
    lines = {"setpoint": (rollout.setpoint, GREY, 1.5, "dot")}
    lines["measured"] = (rollout.measured, INK, 3.0, "solid")
    for model, predicted in rollout.predicted.items():
        error = rollout_rmse(rollout.measured[:, 0], predicted[:, 0])
        label = f"{MODEL_TITLES[model]}, RMSE {number(error)} rad"
        lines[label] = (predicted, _MODEL_COLOURS[model], 2.0, "solid")
    for label, (values, colour, width, dash) in lines.items():
        if values is not None:
            series = Series(label=label, x=rollout.time_s, y=values[:, 0], style="line")
            look = {"color": colour, "width": width, "dash": dash}
            figure.add_trace(trace(series, limit, line=look))
    styled(figure, height=460)
    figure.update_xaxes(title_text="time (s)")
    figure.update_yaxes(title_text=f"position of {html.escape(rollout.joints[0])} (rad)")
    caption = (
        "Every model starts in the measured state, gets the recorded commands and is never "
        "corrected on the way. Look for the line that stays on the black one to the end, also "
        "where the motion stops or turns round. Drag to zoom in, double-click to zoom out."
    )
    title = f"Joint control: {rollout.joints[0]} in held-out recording {rollout.recording}"
    return Picture(title=title, caption=caption, figure=figure)


def residual_picture(rollout: HeldOutRollout, comparison: Comparison, limit: int) -> Picture:
    """Returns measured minus predicted over time, one panel per joint."""
    rows = len(rollout.joints)
    figure = make_subplots(
        rows=rows,
        cols=1,
        shared_xaxes=True,
        vertical_spacing=0.18 / rows,
        subplot_titles=[html.escape(joint) for joint in rollout.joints],
    )
    floors = dict(zip(comparison.joints, comparison.joint_noise_floors, strict=True))
    for row, joint in enumerate(rollout.joints, start=1):
        floor = floors.get(joint, float("nan"))
        if np.isfinite(floor):
            figure.add_hrect(y0=-floor, y1=floor, fillcolor=FLOOR, line_width=0, row=row, col=1)
        _add_residuals(figure, rollout, row, limit)
    styled(figure, height=110 + 125 * rows)
    figure.update_yaxes(title_text="rad", nticks=4)
    figure.update_xaxes(title_text="time (s)", row=rows, col=1)
    figure.update_annotations(x=0.0, xanchor="left", font_size=13)
    figure.update_layout(legend_y=1.0 + 24.0 / (110 + 125 * rows), margin_t=64)
    caption = (
        "Position measured minus predicted, in rad; the grey band is plus and minus the noise "
        "floor, and every joint has a scale of its own. Look for lines that stay in the band. One "
        "that drifts, steps at reversals or follows the motion shows what that model still lacks."
    )
    title = f"Residual per joint in held-out recording {rollout.recording}"
    return Picture(title=title, caption=caption, figure=figure)


def _add_residuals(figure: go.Figure, rollout: HeldOutRollout, row: int, limit: int) -> None:
    for model, predicted in rollout.predicted.items():
        residual = rollout.measured[:, row - 1] - predicted[:, row - 1]
        series = Series(label=MODEL_TITLES[model], x=rollout.time_s, y=residual, style="line")
        line = trace(
            series,
            limit,
            line={"color": _MODEL_COLOURS[model], "width": 1.5},
            legendgroup=model.value,
            showlegend=row == 1,
        )
        figure.add_trace(line, row=row, col=1)


def training_picture(curves: Sequence[TrainingCurve], limit: int) -> Picture:
    """Returns the fit of the GFM over wall-clock time, one panel per group of curves."""
    panels = [panel for panel in _PANELS if any(one.group == panel.group for one in curves)]
    rows = (len(panels) + 1) // 2
    figure = make_subplots(rows=rows, cols=2, subplot_titles=[panel.title for panel in panels])
    for index, panel in enumerate(panels):
        place = {"row": index // 2 + 1, "col": index % 2 + 1}
        inside = [one for one in curves if one.group == panel.group]
        for curve, colour in zip(inside, _CURVE_COLOURS * len(inside), strict=False):
            figure.add_trace(_training_trace(curve, colour, limit, index), **place)
        units = sorted({one.unit for one in inside} - {""})
        figure.update_yaxes(title_text=html.escape(", ".join(units) or "1"), **place)
        if panel.logarithmic:
            figure.update_yaxes(type="log", **place)
    styled(figure, height=90 + 270 * rows)
    figure.update_xaxes(title_text="wall-clock time (s)")
    figure.update_layout(margin_t=32, **_panel_legends(figure, len(panels)))
    caption = (
        "Look for a reward that rises and levels off, an error that falls below that of the "
        "nominal model, and a KL divergence that settles at its limit: far above it the policy "
        "jumps, far below it the policy stands still. Hover a point for its learner step."
    )
    return Picture(title="How the GFM's fit went", caption=caption, figure=figure)


def _training_trace(curve: TrainingCurve, colour: str, limit: int, panel: int) -> go.Scatter:
    kept = kept_samples(np.asarray(curve.value, float), "line", limit)
    return go.Scatter(
        x=compact(curve.wall_clock_s[kept]),
        y=compact(curve.value[kept]),
        customdata=curve.learner_steps[kept].astype(np.int32),
        hovertemplate="%{y:.4g} at learner step %{customdata}",
        name=html.escape(curve.label),
        legend=_legend_name(panel),
        mode="lines",
        line={"color": colour, "width": 2},
    )


def _legend_name(panel: int) -> str:
    return f"legend{panel + 1}" if panel else "legend"


def _panel_legends(figure: go.Figure, panels: int) -> dict[str, object]:
    """Returns one legend per panel, in its upper right corner."""
    legends: dict[str, object] = {}
    for panel in range(panels):
        row, col = panel // 2 + 1, panel % 2 + 1
        plot = figure.get_subplot(row, col)
        corner = {"x": plot.xaxis.domain[1], "y": plot.yaxis.domain[1]}
        look = {"orientation": "v", "bgcolor": "rgba(255, 255, 255, 0.75)", "font_size": 12}
        legends[_legend_name(panel)] = {**corner, **look, "xanchor": "right", "yanchor": "top"}
    return legends
