"""A recording as one page: what was told and what was measured, over time."""

from __future__ import annotations

import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.report import figures
from gfm.report.figures import Picture
from gfm.report.page import render_page

_COLOURS = (
    figures.BLUE,
    figures.ORANGE,
    figures.GREEN,
    figures.PURPLE,
    figures.SKY,
    "#cc9a06",
    figures.INK,
)
_SIGNALS = {
    CommandKind.POSITION: "position (rad)",
    CommandKind.VELOCITY: "velocity (rad/s)",
    CommandKind.EFFORT: "effort (N m)",
}
_PANEL_PX, _DELAYS_PX, _MARGINS_PX = 300, 220, 110


@dataclass(frozen=True, kw_only=True)
class _Line:
    """One line of a panel.

    Attributes:
        name: In the legend, where it stands once for all panels.
        time_s: shape (S,).
        value: shape (S,).
        dash: As plotly calls it; what was told is drawn as steps.
        what: Is shown where the pointer is.
    """

    name: str
    time_s: Array
    value: Array
    dash: str = "solid"
    what: str = "measured"


def recording_html(recording: Trajectory, delays: Mapping[str, Mapping[str, int]]) -> str:
    """Returns the page; it needs nothing beside it.

    Args:
        recording: What is shown.
        delays: Of the bridge that wrote it: how many of each kind, in words, were how long;
            empty where it does not say.
    """
    return render_page(
        "recording.html.j2",
        recording=recording,
        signals=recording_picture(recording),
        delays=delay_picture(delays) if delays else None,
    )


def delay_picture(delays: Mapping[str, Mapping[str, int]]) -> Picture:
    """Returns how many delays of each kind were how long: a panel for each kind."""
    rows = len(delays)
    figure = make_subplots(rows=rows, cols=1, subplot_titles=list(delays))
    for row, counts in enumerate(delays.values(), 1):
        bars = go.Bar(x=list(counts), y=list(counts.values()), marker_color=figures.BLUE)
        figure.add_trace(bars, row, 1)
        figure.update_yaxes(title_text="count", row=row, col=1)
    figures.styled(figure, height=_MARGINS_PX + _DELAYS_PX * rows, legend=False)
    figure.update_layout(margin_t=64)
    caption = "Each bar counts what was longer than the bar before it says, and at most this long."
    return Picture(title="How punctual the bridge was", caption=caption, figure=figure)


def recording_picture(recording: Trajectory) -> Picture:
    """Returns all signals over time: a panel for each quantity, a colour for each joint."""
    panels = dict(_panels(recording))
    count = sum(len(lines) for lines in panels.values())
    limit = figures.points_per_series(count)
    rows = len(panels)
    figure = make_subplots(rows=rows, cols=1, shared_xaxes=True, vertical_spacing=0.12 / rows)
    shown: set[str] = set()
    for row, (title, lines) in enumerate(panels.items(), 1):
        colours = dict(zip(dict.fromkeys(line.name for line in lines), cycle(_COLOURS)))
        for line in lines:
            figure.add_trace(
                _trace(line, colours[line.name], limit, legend=line.name not in shown), row, 1
            )
            shown.add(line.name)
        figure.update_yaxes(title_text=html.escape(title), row=row, col=1)
    figures.styled(figure, height=_MARGINS_PX + _PANEL_PX * rows)
    figure.update_layout(margin_t=64)
    figure.update_xaxes(title_text="time since the first measurement (s)", row=rows, col=1)
    caption = (
        "Solid: measured. Dashed: what the robot was told, after every limit. Dotted: what was "
        "asked for. Click a name to hide it, twice to see it alone; drag to look closer."
    )
    return Picture(title="What was told, and what was measured", caption=caption, figure=figure)


def _panels(recording: Trajectory) -> Iterator[tuple[str, list[_Line]]]:
    measured = {
        CommandKind.POSITION: recording.position,
        CommandKind.VELOCITY: recording.velocity,
        CommandKind.EFFORT: recording.effort,
    }
    for kind, title in _SIGNALS.items():
        lines = list(_measured(recording, measured[kind]))
        if recording.command_kind is kind:
            lines += _told(recording)
        if lines:
            yield title, lines
    if (track := recording.object_track) is not None:
        time_s = np.asarray((track.stamp_ns - recording.stamp_ns[0]) * 1e-9)
        for title, names, values in (
            ("object's place (m)", "xyz", track.position),
            ("object's quaternion", ("qw", "qx", "qy", "qz"), track.quaternion),
        ):
            columns = zip(names, values.T, strict=True)
            yield title, [_Line(name=f"object's {n}", time_s=time_s, value=v) for n, v in columns]


def _measured(recording: Trajectory, values: Array | None) -> Iterator[_Line]:
    if values is not None:
        for name, column in zip(recording.joint_names, values.T, strict=True):
            yield _Line(name=name, time_s=recording.time_s, value=column)


def _told(recording: Trajectory) -> Iterator[_Line]:
    time_s = recording.command_time_s
    for what, dash, values in (
        ("told", "dash", recording.command),
        ("asked for", "dot", recording.requested),
    ):
        if values is not None:
            for name, column in zip(recording.joint_names, values.T, strict=True):
                if name not in recording.uncommanded:
                    yield _Line(name=name, time_s=time_s, value=column, dash=dash, what=what)


def _trace(line: _Line, colour: str, limit: int, *, legend: bool) -> go.Scatter:
    kept = figures.kept_samples(line.value, "line", limit)
    told = line.dash != "solid"
    return go.Scatter(
        x=figures.compact(line.time_s[kept]),
        y=figures.compact(line.value[kept]),
        name=html.escape(line.name),
        legendgroup=line.name,
        showlegend=legend,
        mode="lines",
        line={
            "color": colour,
            "width": 1.5,
            "dash": line.dash,
            "shape": "hv" if told else "linear",
        },
        hovertemplate=f"%{{y:.4g}} {line.what}",
    )
