"""Motions that show what a model may lack: what `gfm.excite` and `gfm excite` propose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias, final

import mujoco

from gfm.api.answer import Diagnosis
from gfm.api.folders import check_folder
from gfm.api.models import Model, NominalModel, load_nominal, made_texts
from gfm.api.open_questions import open_questions, read_report
from gfm.api.provenance import provenance
from gfm.core import CommandKind
from gfm.effects import find_effect
from gfm.excitation.limits import Wishes, robot_limits
from gfm.excitation.plan import Plan, Request, make_plan
from gfm.report import PlanReport, diagnosis_json, write_plan
from gfm.report.files import write_texts

#: A diagnosis whose open questions are to be decided.
Asked: TypeAlias = str | Path | Diagnosis


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Excitation:
    """Motions to record.

    Attributes:
        report: The plan, and where it came from.
        model: By which they are possible.
        nominal: The same with what it was made from.
    """

    report: PlanReport
    model: mujoco.MjModel
    nominal: NominalModel

    @property
    def plan(self) -> Plan:
        """The motions, what to know of them, and what they could not show."""
        return self.report.plan

    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Writes plan.json, plan.html and a table of commands for each motion; returns the paths.

        Raises:
            BadInputError: a file is in the way of the folder.
        """
        check_folder(Path(folder))
        paths = write_plan(Path(folder), self.report)
        return (*paths, *write_texts(Path(folder), made_texts(self.nominal)))


def excite(
    model: Model,
    *,
    effects: Sequence[str] = (),
    report: Asked | None = None,
    kinds: Sequence[CommandKind | str] = (),
    seconds: float = 20.0,
    period_s: float = 0.02,
    seed: int = 0,
    clearance_m: float = 0.01,
    wishes: Wishes | None = None,
    words: Sequence[str] = ("gfm.excite",),
) -> Excitation:
    """Returns motions that make effects nameable, within the robot's limits, touching nothing.

    Args:
        model: Path of MJCF or URDF, or an `MjSpec`, or what `gfm.load_nominal` made of it; a
            list of them for several kinds of command.
        effects: To be shown, by name; by default all.
        report: A diagnosis, or its report.json, whose open questions are to be decided.
        kinds: Of commands; by default those of the models.
        seconds: Length of each motion.
        period_s: Between two commands.
        seed: Of phases, postures and orders.
        clearance_m: Distance to keep from everything.
        wishes: Limits beyond those in the models.
        words: What asked, for the plan's page.

    Raises:
        BadInputError: something given cannot be used, or no motion is possible.
    """
    nominal = load_nominal(model)
    models = {kind: spec.copy().compile() for kind, spec in nominal.specs.items()}
    wanted = [find_effect(name).name for name in (*effects, *_open(report))]
    request = Request(
        effects=tuple(dict.fromkeys(wanted)),
        kinds=tuple(CommandKind(one) for one in dict.fromkeys(kinds)) or tuple(models),
        seconds=seconds,
        period_s=period_s,
        seed=seed,
    )
    first = next(iter(models.values()))
    plan = make_plan(first, robot_limits(models, wishes), request, clearance_m=clearance_m)
    given = (Path(report),) if isinstance(report, str | Path) else ()
    files = {"model": nominal.files, "report": given}
    robot = next((path.stem for path in nominal.paths.values()), "robot")
    told = PlanReport(plan=plan, robot=robot, provenance=provenance(files, seed, words))
    return Excitation(report=told, model=first, nominal=nominal)


def _open(asked: Asked | None) -> list[str]:
    if asked is None:
        return []
    if isinstance(asked, Diagnosis):
        return open_questions(diagnosis_json(asked.answer), "of the diagnosis")
    return open_questions(read_report(Path(asked)), str(asked))
