"""A diagnosis as `report.json` and as one HTML page."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence

import numpy as np

from gfm.diagnosis.output.changes import Changes
from gfm.diagnosis.output.result import (
    SCHEMA,
    Diagnosis,
    ErrorSummary,
    NamedEffect,
    ParameterEstimate,
    RecordingSummary,
    Suspect,
)
from gfm.report import glance, words
from gfm.report.chain_document import chain_json
from gfm.report.figures import (
    Picture,
    evidence_picture,
    joint_error_picture,
    points_per_series,
    series_count,
)
from gfm.report.film import Film
from gfm.report.learned_document import learned_json
from gfm.report.page import render, render_page


def jsonable(value: object) -> object:
    """Returns the value as strict JSON has it: no NaN, no infinity, no array, text for the rest."""
    match value:
        case enum.Enum():
            return jsonable(value.value)
        case None | bool() | int() | str():
            return value
        case float():
            return value if math.isfinite(value) else None
        case np.generic() | np.ndarray():
            return jsonable(value.tolist())
        case Mapping():
            return {str(key): jsonable(one) for key, one in value.items()}
        case list() | tuple() | set() | frozenset():
            return [jsonable(one) for one in value]
        case _:
            return str(value)


def diagnosis_json(diagnosis: Diagnosis) -> dict[str, object]:
    """Returns the document "gfm.diagnosis/1": numbers are finite or null."""
    document = {
        "schema": SCHEMA,
        "verdict": diagnosis.verdict.value,
        "sentence": diagnosis.sentence,
        "effects": [effect_json(effect) for effect in diagnosis.effects],
        "suspects": [_suspect_json(suspect) for suspect in diagnosis.suspects],
        "error": _error_json(diagnosis.error),
        "error_as_measured": diagnosis.as_measured and _error_json(diagnosis.as_measured),
        "joints": [_joint_json(name, one) for name, one in diagnosis.joints.items()],
        "object": {name: _error_json(one) for name, one in diagnosis.object_error.items()},
        "recordings": [_recording_json(recording) for recording in diagnosis.recordings],
        "input_quality": [dict(vars(finding)) for finding in diagnosis.findings],
        "blind_spots": [dict(vars(spot)) for spot in diagnosis.blind_spots],
        "evidence": chain_json(diagnosis.chain),
        "gfm": learned_json(diagnosis),
        "changes": diagnosis.changes and _changes_json(diagnosis.changes),
        "notes": diagnosis.notes,
        "provenance": diagnosis.provenance,
    }
    return {key: jsonable(value) for key, value in document.items()}


def effect_json(effect: NamedEffect) -> dict[str, object]:
    """Returns one effect as `report.json` has it."""
    return {
        "effect": effect.effect,
        "joints": list(effect.joints),
        "parameters": {name: _estimate_json(one) for name, one in effect.parameters.items()},
        "confidence": jsonable(effect.confidence),
        "native": effect.native,
        "evidence": jsonable(effect.evidence),
        "equals": [{"effect": o.effect, "joints": list(o.joints)} for o in effect.equals],
    }


def _estimate_json(estimate: ParameterEstimate) -> dict[str, object]:
    known = {
        "value": jsonable(estimate.value),
        "unit": estimate.unit,
        "ci95": jsonable(words.known_interval(estimate)),
    }
    return known if estimate.spread is None else {**known, "spread": jsonable(estimate.spread)}


def diagnosis_html(diagnosis: Diagnosis, film: Film | None = None) -> str:
    """Returns the diagnosis as one HTML page that needs nothing beside it."""
    limit = points_per_series(series_count(diagnosis), film=film is not None)
    return render_page(
        "diagnosis.html.j2",
        diagnosis=diagnosis,
        verdict=words.VERDICTS[diagnosis.verdict],
        next_steps=glance.next_steps(diagnosis),
        bars=glance.bars(diagnosis),
        quiet=glance.quiet_joints(diagnosis),
        cards=glance.cards(diagnosis),
        film=film,
        error_picture=error_picture(diagnosis),
        evidence=evidence(diagnosis, limit),
    )


def diagnosis_snippet(diagnosis: Diagnosis) -> str:
    """Returns verdict, effects, errors and notes as HTML for a notebook: no script, no style."""
    verdict = words.VERDICTS[diagnosis.verdict]
    return render("snippet.html.j2", diagnosis=diagnosis, verdict=verdict)


def error_picture(diagnosis: Diagnosis) -> Picture | None:
    """Returns the picture of the before/after table; None where there is no joint to show."""
    if not diagnosis.joints:
        return None
    return joint_error_picture(diagnosis.joints, diagnosis.error.unit)


def evidence(diagnosis: Diagnosis, limit: int) -> Sequence[Picture]:
    """Returns the evidence plots that have anything in them, in their order."""
    return [evidence_picture(plot, limit) for plot in diagnosis.plots if plot.series]


def _error_json(error: ErrorSummary) -> dict[str, object]:
    return {**vars(error), "ratio": words.ratio(error.after, error.noise_floor)}


def _joint_json(joint: str, error: ErrorSummary) -> dict[str, object]:
    told = {"joint": joint, **_error_json(error)}
    del told["unit"]
    return told


def _changes_json(changes: Changes) -> dict[str, object]:
    return {**vars(changes), "amounts": [dict(vars(one)) for one in changes.amounts]}


def _suspect_json(suspect: Suspect) -> dict[str, object]:
    return dict(vars(suspect))


def _recording_json(recording: RecordingSummary) -> dict[str, object]:
    return dict(vars(recording))
