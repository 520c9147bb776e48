"""What a person reads: one offline HTML page, `report.json`, and tables for a terminal."""

from gfm.report.document import diagnosis_html, diagnosis_json, diagnosis_snippet
from gfm.report.files import write_diagnosis, write_models, write_run
from gfm.report.plan_document import PlanReport, plan_html, plan_json, write_plan
from gfm.report.run import (
    Comparison,
    CurveGroup,
    HeldOutRollout,
    HiddenEffect,
    HiddenParameter,
    ModelError,
    ModelKind,
    PhaseTime,
    RunReport,
    SystemFacts,
    TrainingCurve,
)
from gfm.report.run_document import run_html, run_json
from gfm.report.terminal import print_diagnosis, print_run

__all__ = [
    "Comparison",
    "CurveGroup",
    "HeldOutRollout",
    "HiddenEffect",
    "HiddenParameter",
    "ModelError",
    "ModelKind",
    "PhaseTime",
    "PlanReport",
    "RunReport",
    "SystemFacts",
    "TrainingCurve",
    "diagnosis_html",
    "diagnosis_json",
    "diagnosis_snippet",
    "plan_html",
    "plan_json",
    "print_diagnosis",
    "print_run",
    "run_html",
    "run_json",
    "write_diagnosis",
    "write_models",
    "write_plan",
    "write_run",
]
