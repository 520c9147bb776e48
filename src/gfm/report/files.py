"""Reports on disk: all is rendered before the first file is written, each file in one move."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from gfm.core import CommandKind
from gfm.diagnosis.output.result import Diagnosis, ModelPair
from gfm.report.document import diagnosis_html, diagnosis_json, effect_json
from gfm.report.film import Film
from gfm.report.ranges import ranges_toml
from gfm.report.run import RunReport
from gfm.report.run_document import run_html, run_json

EFFECTS_SCHEMA = "gfm.effects/1"


def write_diagnosis(
    folder: Path, diagnosis: Diagnosis, film: Film | None = None
) -> tuple[Path, ...]:
    """Writes the diagnosis's files into `folder`, made where it is missing; returns their paths."""
    document, page = diagnosis_json(diagnosis), diagnosis_html(diagnosis, film)
    twins = [model_texts(f"corrected_{kind}", model) for kind, model in diagnosis.twins.items()]
    models = _corrected_texts(diagnosis) | {n: text for two in twins for n, text in two.items()}
    ranges = {"ranges.toml": ranges_toml(diagnosis.changes)} if diagnosis.changes else {}
    return write_texts(folder, _report_texts(document, page) | models | ranges)


def write_run(folder: Path, report: RunReport) -> tuple[Path, ...]:
    """Writes the run's files into `folder`, made where it is missing; returns their paths."""
    texts = _report_texts(run_json(report), run_html(report))
    return write_texts(folder, texts | _corrected_texts(report.diagnosis))


def write_models(folder: Path, models: Mapping[CommandKind, ModelPair]) -> dict[CommandKind, Path]:
    """Writes the corrected model of each kind of command; returns where they are."""
    for kind, model in models.items():
        write_texts(folder, model_texts(f"corrected_{kind}", model))
    return {kind: folder / f"corrected_{kind}.xml" for kind in models}


def model_texts(stem: str, model: ModelPair) -> dict[str, str]:
    """Returns a model's files by name: MJCF, and beside it what that cannot say."""
    texts = {f"{stem}.xml": model.xml}
    if model.effects:
        effects = [effect_json(effect) for effect in model.effects]
        texts[f"{stem}.effects.json"] = _json_text({"schema": EFFECTS_SCHEMA, "effects": effects})
    return texts


def write_texts(folder: Path, texts: Mapping[str, str]) -> tuple[Path, ...]:
    """Writes files by name, each in one move, into `folder`, made where it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        part = folder / f".{name}.part"
        part.write_text(text, encoding="utf-8")
        forget_effects(folder / name)
        part.replace(folder / name)
    return tuple(folder / name for name in texts)


def forget_effects(path: Path) -> None:
    """Removes what stands beside an older model under the name that a new one is about to get."""
    if path.suffix == ".xml":
        path.with_suffix(".effects.json").unlink(missing_ok=True)


def _report_texts(document: Mapping[str, object], page: str) -> dict[str, str]:
    return {"report.json": _json_text(document), "report.html": page}


def _corrected_texts(diagnosis: Diagnosis) -> dict[str, str]:
    model = ModelPair(xml=diagnosis.corrected_xml, effects=diagnosis.corrected_effects)
    return model_texts("corrected", model)


def _json_text(document: Mapping[str, object]) -> str:
    return json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False) + "\n"
