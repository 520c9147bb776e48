"""Pictures of the models of a run: errors, joint control, residuals over time.

Shape letters: T samples of a rollout, J joints.
"""

from __future__ import annotations

import html

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from gfm.core.checks import Array
from gfm.diagnosis.output.result import Series
from gfm.report.figures import (
    BLUE,
    FLOOR,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    Dots,
    Picture,
    dots_figure,
    floor_dots,
    series_count,
    styled,
    trace,
)
from gfm.report.run import (
    Comparison,
    HeldOutRollout,
    ModelKind,
    RunReport,
)
from gfm.report.words import number

MODEL_TITLES = {
    ModelKind.NOMINAL: "nominal",
    ModelKind.IDENTIFIED: "identified (SLSQP)",
    ModelKind.HYBRID: "hybrid (GFM)",
    ModelKind.CORRECTED: "corrected (named effect)",
    ModelKind.CORRECTED_HYBRID: "corrected + GFM",
}
_MODEL_COLOURS = {
    ModelKind.NOMINAL: ORANGE,
    ModelKind.IDENTIFIED: PURPLE,
    ModelKind.HYBRID: GREEN,
    ModelKind.CORRECTED: BLUE,
    ModelKind.CORRECTED_HYBRID: SKY,
}


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


def model_error_picture(comparison: Comparison) -> Picture:
    """Returns every model's held-out error per joint, the noise floor beside."""
    rows = [
        Dots(label=MODEL_TITLES[row.model], colour=_MODEL_COLOURS[row.model], x=row.joints)
        for row in comparison.models
    ]
    rows.append(floor_dots(comparison.joint_noise_floors))
    caption = (
        "Look for the colour that is farthest to the left on every line; at the grey mark a model "
        "predicts as well as the sensors can tell. The scale is logarithmic."
    )
    figure = dots_figure(comparison.joints, rows, "held-out position RMSE (rad)")
    return Picture(title="Held-out error per joint and model", caption=caption, figure=figure)


def joint_control_picture(rollout: HeldOutRollout, limit: int) -> Picture:
    """Returns the base joint over time: what was asked, what it did, what each model predicts."""
    figure = go.Figure()
    lines = {"setpoint": (rollout.setpoint, GREY, 1.5, "dot")}
    # A broad line below the others: a model that is right runs inside it.
    lines["measured"] = (rollout.measured, INK, 6.0, "solid")
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
        "corrected on the way. Look for the line that stays inside the black one to the end, also "
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
        "that drifts, steps at reversals or follows the motion shows what that model still lacks. "
        "Click a name above the picture to hide a model, double-click to see it alone."
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
