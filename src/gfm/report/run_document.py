"""A whole run as `report.json` and as one HTML page; the diagnosis is a part of both."""

from __future__ import annotations

from gfm.core import Status
from gfm.report import words
from gfm.report.document import diagnosis_json, evidence, jsonable
from gfm.report.figures import Picture, points_per_series
from gfm.report.page import render_page
from gfm.report.reveal import Reveal, reveal
from gfm.report.run import SCHEMA, Comparison, HiddenEffect, RunReport, SystemFacts, TrainingCurve
from gfm.report.run_figures import (
    MODEL_TITLES,
    joint_control_picture,
    model_error_picture,
    residual_picture,
    run_series_count,
)
from gfm.report.training_figure import training_picture
from gfm.report.transfer import transfer_json


def run_json(report: RunReport) -> dict[str, object]:
    """Returns the document "gfm.run/1": numbers are finite or null."""
    document = {
        "schema": SCHEMA,
        "run_id": report.run_id,
        "robot": report.robot,
        "simulated": report.simulated,
        "comparison": _comparison_json(report.comparison),
        "training": [_curve_json(curve) for curve in report.training],
        "revealed": None if report.hidden is None else _reveal_json(revealed(report)),
        "system": _system_json(report.system),
        "task": None if report.task is None else transfer_json(report.task),
        "diagnosis": diagnosis_json(report.diagnosis),
    }
    return {key: jsonable(value) for key, value in document.items()}


def revealed(report: RunReport) -> Reveal:
    """Returns the verdict against the sealed file."""
    return reveal(report.diagnosis.effects, report.hidden or ())


def run_html(report: RunReport) -> str:
    """Returns the run as one HTML page that needs nothing beside it."""
    limit = points_per_series(run_series_count(report))
    return render_page(
        "run.html.j2",
        report=report,
        diagnosis=report.diagnosis,
        verdict=words.VERDICTS[report.diagnosis.verdict],
        model_titles=MODEL_TITLES,
        comparison_lines=report.comparison.lines(),
        error_picture=model_error_picture(report.comparison),
        evidence=evidence(report.diagnosis, limit),
        control_pictures=[joint_control_picture(one, limit) for one in report.rollouts],
        residual_pictures=_residual_pictures(report, limit),
        task_pictures=[] if report.task is None else report.task.pictures(),
        training=training_picture(report.training, limit) if report.training else None,
        reveal=None if report.hidden is None else revealed(report),
    )


def _residual_pictures(report: RunReport, limit: int) -> list[Picture]:
    return [residual_picture(one, report.comparison, limit) for one in report.rollouts]


def _comparison_json(comparison: Comparison) -> dict[str, object]:
    return {
        "unit": "rad",
        "noise_floor": comparison.noise_floor,
        "joint_noise_floors": dict(
            zip(comparison.joints, comparison.joint_noise_floors, strict=True)
        ),
        "models": [
            {
                "model": row.model.value,
                "detail": row.detail,
                "overall": row.overall,
                "ratio": words.ratio(row.overall, comparison.noise_floor),
                "joints": dict(zip(comparison.joints, row.joints, strict=True)),
            }
            for row in comparison.models
        ],
    }


def _curve_json(curve: TrainingCurve) -> dict[str, object]:
    ends = {"first": curve.value[0], "last": curve.value[-1]} if len(curve.value) else {}
    return {"label": curve.label, "group": curve.group, "unit": curve.unit, **ends}


def _reveal_json(result: Reveal) -> dict[str, object]:
    return {
        "hidden": [_hidden_json(check.hidden) for check in result.checks],
        "name_matches": result.names_right,
        "joint_matches": result.joints_right,
        "surplus": [{"effect": one.effect, "joints": one.joints} for one in result.surplus],
    }


def _hidden_json(hidden: HiddenEffect) -> dict[str, object]:
    parameters = {name: vars(value) for name, value in hidden.parameters.items()}
    return {"effect": hidden.effect, "joints": hidden.joints, "parameters": parameters}


def _system_json(system: SystemFacts) -> dict[str, object]:
    return {
        **vars(system),
        "processes": [_process_json(status) for status in system.processes],
        "phases": [vars(phase) for phase in system.phases],
    }


def _process_json(status: Status) -> dict[str, object]:
    return {"role": status.role, "name": status.name, "pid": status.pid, "host": status.host}
