"""A plan of motions as `plan.json`, as tables of commands, and as one HTML page.

Shape letters: N control periods, J joints.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from gfm.excitation.plan import Plan, PlannedMotion
from gfm.report.document import jsonable
from gfm.report.figures import (
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    SKY,
    Picture,
    compact,
    kept_samples,
    points_per_series,
    styled,
)
from gfm.report.files import write_texts
from gfm.report.page import render_page

SCHEMA = "gfm.excitation/1"
#: Folder of the tables of commands, beside `plan.json`.
COMMANDS = "commands"
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, INK, GREY)


@dataclass(frozen=True, kw_only=True)
class PlanReport:
    """A plan with what was made of it.

    Attributes:
        plan: The motions.
        robot: What the model is called.
        recordings: Where each motion was recorded, by its name; empty where it was only planned.
        provenance: Files, hashes, versions, seed.
    """

    plan: Plan
    robot: str
    recordings: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, object] = field(default_factory=dict)


def write_plan(folder: Path, report: PlanReport) -> tuple[Path, ...]:
    """Writes a plan into `folder`, made where it is missing; returns the paths, tables last."""
    document = json.dumps(plan_json(report), indent=2, allow_nan=False, ensure_ascii=False)
    texts = {"plan.json": f"{document}\n", "plan.html": plan_html(report)}
    tables = {f"{one.motion.name}.csv": commands_csv(one) for one in report.plan.motions}
    return (*write_texts(folder, texts), *write_texts(folder / COMMANDS, tables))


def plan_json(report: PlanReport) -> dict[str, object]:
    """Returns the document "gfm.excitation/1"."""
    plan = report.plan
    limits = {
        name: {
            "start": plan.limits.start[j],
            "lower": plan.room.lower[j],
            "upper": plan.room.upper[j],
            "speed": plan.limits.speed[j],
            "acceleration": plan.limits.acceleration[j],
            "effort": plan.limits.effort[j],
            "moves": name in plan.limits.moving,
        }
        for j, name in enumerate(plan.limits.joint_names)
    }
    document = {
        "schema": SCHEMA,
        "robot": report.robot,
        "effects": plan.request.effects,
        "duration_s": plan.duration_s,
        "joints": limits,
        "motions": [_motion_json(report, one) for one in plan.motions],
        "blind_spots": [vars(spot) for spot in plan.blind_spots],
        "notes": plan.notes,
        "provenance": report.provenance,
    }
    return {key: jsonable(value) for key, value in document.items()}


def _motion_json(report: PlanReport, planned: PlannedMotion) -> dict[str, object]:
    motion, tracking = planned.motion, planned.motion.tracking
    document: dict[str, object] = {
        "name": motion.name,
        "commands": f"{COMMANDS}/{motion.name}.csv",
        "recording": report.recordings.get(motion.name),
        "purpose": motion.purpose,
        "command": motion.kind,
        "motion": planned.family.label,
        "words": planned.family.words,
        "shows": planned.family.shows,
        "period_s": motion.period_s,
        "duration_s": len(motion.position) * motion.period_s,
        "joints": [vars(one) for one in planned.reach],
        "notes": planned.notes,
    }
    if tracking is not None:
        document["stiffness"], document["damping"] = tracking.stiffness, tracking.damping
    return document


def commands_csv(planned: PlannedMotion) -> str:
    """Returns a motion as a table: time, then position, velocity and effort of every joint."""
    motion = planned.motion
    names = [
        f"{joint}.{signal}"
        for joint in motion.joint_names
        for signal in ("position", "velocity", "effort")
    ]
    time_s = motion.period_s * np.arange(len(motion.position))
    values = np.stack([motion.position, motion.velocity, planned.torque], axis=2)
    rows = np.column_stack([time_s, values.reshape(len(time_s), -1)])
    # Quoted where a name has a comma or a quote in it.
    header = ",".join(
        ['"' + n.replace('"', '""') + '"' if set(n) & set(',"') else n for n in names]
    )
    lines = [",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join([f"time_s,{header}", *lines]) + "\n"


def plan_html(report: PlanReport) -> str:
    """Returns the plan as one HTML page that needs nothing beside it."""
    plan = report.plan
    series = len(plan.motions) * len(plan.limits.moving)
    limit = points_per_series(series)
    return render_page(
        "plan.html.j2",
        report=report,
        plan=plan,
        minutes=math.ceil(plan.duration_s / 60.0),
        shown=[(one, motion_picture(one, limit)) for one in plan.motions],
    )


def motion_picture(planned: PlannedMotion, limit: int) -> Picture:
    """Returns the positions of the moving joints over time, each from where it begins."""
    motion, figure = planned.motion, go.Figure()
    time_s = motion.period_s * np.arange(len(motion.position), dtype=np.float64)
    for number, row in enumerate(planned.reach):
        way = motion.position[:, motion.joint_names.index(row.joint)]
        kept = kept_samples(way, "line", limit)
        figure.add_trace(
            go.Scatter(
                x=compact(np.asarray(time_s[kept])),
                y=compact(np.asarray(way[kept] - way[0])),
                name=html.escape(row.joint),
                mode="lines",
                line={"color": _COLOURS[number % len(_COLOURS)], "width": 1.5},
            )
        )
    styled(figure, height=320)
    figure.update_xaxes(title_text="time (s)")
    figure.update_yaxes(title_text="position from where it begins (rad)")
    return Picture(
        title=motion.name, caption=planned.family.words.capitalize() + ".", figure=figure
    )
