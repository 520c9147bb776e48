"""Reports on disk: all is rendered before the first file is written, each file in one move."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from gfm.diagnosis.result import Diagnosis
from gfm.report.document import diagnosis_html, diagnosis_json, effect_json
from gfm.report.run import RunReport
from gfm.report.run_document import run_html, run_json

EFFECTS_SCHEMA = "gfm.effects/1"


def write_diagnosis(folder: Path, diagnosis: Diagnosis) -> tuple[Path, ...]:
    """Writes the diagnosis's files into `folder`, made where it is missing; returns their paths."""
    document, page = diagnosis_json(diagnosis), diagnosis_html(diagnosis)
    return _write(folder, _report_texts(document, page) | _model_texts(diagnosis))


def write_run(folder: Path, report: RunReport) -> tuple[Path, ...]:
    """Writes the run's files into `folder`, made where it is missing; returns their paths."""
    texts = _report_texts(run_json(report), run_html(report))
    return _write(folder, texts | _model_texts(report.diagnosis))


def _report_texts(document: Mapping[str, object], page: str) -> dict[str, str]:
    return {"report.json": _json_text(document), "report.html": page}


def _model_texts(diagnosis: Diagnosis) -> dict[str, str]:
    texts = {"corrected.xml": diagnosis.corrected_xml}
    if diagnosis.corrected_effects:
        effects = [effect_json(effect) for effect in diagnosis.corrected_effects]
        texts["corrected.effects.json"] = _json_text({"schema": EFFECTS_SCHEMA, "effects": effects})
    return texts


def _json_text(document: Mapping[str, object]) -> str:
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _write(folder: Path, texts: Mapping[str, str]) -> tuple[Path, ...]:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        part = folder / f".{name}.part"
        part.write_text(text, encoding="utf-8")
        part.replace(folder / name)
    return tuple(folder / name for name in texts)
