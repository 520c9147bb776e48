"""What `gfm excite` does: a model and a question in, motions out; driven where asked for."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gfm.api.excitation import excite as propose
from gfm.api.folders import check_folder
from gfm.api.models import load_nominal, made_texts
from gfm.api.provenance import command_line
from gfm.core import Clock, CommandKind, ConfigError, MonotonicClock, Observation
from gfm.excitation.limits import RobotLimits, Wishes
from gfm.excitation.motion import Purpose
from gfm.excitation.plan import Plan
from gfm.excitation.programme import FAMILIES, Family
from gfm.excitation.safety import SafetyCheck
from gfm.experiments.drive import Driven, drive
from gfm.launch import RunAddress
from gfm.report import PlanReport, write_plan
from gfm.report.files import write_texts
from gfm.report.words import joints_title
from gfm.transport import Transport
from gfm_wire import Role


@dataclass(frozen=True, kw_only=True)
class ExciteRequest:
    """What is asked for.

    Attributes:
        models: One model per kind of command.
        out: Folder to write to.
        effects: To be shown.
        report: Of a diagnosis whose open questions are to be decided, or None.
        kinds: Of commands; empty for those of the models.
        seconds: Length of each motion.
        seed: Of everything random.
        period_s: Between two commands.
        clearance_m: Distance to keep.
        wishes: Limits beyond those in the models.
        robot: The run of the robot's bridge; None to plan only.
        actuators: What joints without an actuator get.
    """

    models: tuple[Path, ...]
    out: Path
    effects: tuple[str, ...] = ()
    report: Path | None = None
    kinds: tuple[CommandKind, ...] = ()
    seconds: float = 20.0
    seed: int = 0
    period_s: float = 0.02
    clearance_m: float = 0.01
    wishes: Wishes
    robot: RunAddress | None = None
    actuators: str | None = None

    def __post_init__(self) -> None:
        check_folder(self.out)


def excite(request: ExciteRequest, answer: Console, progress: Console) -> None:
    """Plans, drives where that is asked for, writes and prints.

    Raises:
        BadInputError: something given cannot be used; nothing was written, and nothing moved.
        UnreachableError: no bridge, or no robot behind it.
        RefusedError: the bridge said no.
    """
    with progress.status("planning"):  # gone where something is refused: that is one line
        excitation = propose(
            load_nominal(request.models, request.actuators),
            effects=request.effects,
            report=request.report,
            kinds=request.kinds,
            seconds=request.seconds,
            period_s=request.period_s,
            seed=request.seed,
            clearance_m=request.clearance_m,
            wishes=request.wishes,
            words=command_line(),
        )
    model, report = excitation.model, excitation.report
    if request.robot is None:
        paths = excitation.save(request.out)
    else:
        with request.robot.open(Role.DRIVER, name="excite") as transport:
            paths, report = drive_plan(
                transport, MonotonicClock(), report, request, model=model, progress=progress
            )
        write_texts(request.out, made_texts(excitation.nominal))
    print_plan(answer, report, request.models, request.actuators)
    for path in paths[:2]:
        answer.print(Text(str(path)), soft_wrap=True)


def drive_plan(
    transport: Transport,
    clock: Clock,
    report: PlanReport,
    request: ExciteRequest,
    *,
    model: mujoco.MjModel,
    progress: Console,
    idle: Callable[[], None] | None = None,
) -> tuple[tuple[Path, ...], PlanReport]:
    """Drives and records a plan; returns what was written, and the plan with its recordings.

    The plan is written before the robot moves: whoever watches can look at what comes.
    """
    plan = report.plan

    def before(observation: Observation) -> None:
        check_way(model, plan.limits, observation.position, request.clearance_m)
        write_plan(request.out, report)

    driven: list[Driven] = []
    motions = [one.motion for one in plan.motions]
    for one in drive(transport, clock, motions, idle=idle, before=before):
        driven.append(one)
        words = f"  {len(driven)} of {len(motions)}: {one.path}, {one.reports} measurements"
        progress.print(Text(words, style="dim"), soft_wrap=True)
    recorded = PlanReport(
        plan=plan,
        robot=report.robot,
        recordings={one.name: str(one.path) for one in driven},
        provenance=report.provenance,
    )
    return write_plan(request.out, recorded), recorded


def check_way(
    model: mujoco.MjModel, limits: RobotLimits, position: np.ndarray, clearance_m: float
) -> None:
    """Raises ConfigError where the straight way from a position to the first motion touches."""
    check = SafetyCheck(model, limits, clearance_m=clearance_m)
    fault = check.way(position, limits.start)
    if fault is not None:
        raise ConfigError(
            f"on the straight way from where the robot is to where motions begin, {fault.words}; "
            "bring it closer to that pose first, or name another keyframe with --pose"
        )


def print_plan(
    console: Console,
    report: PlanReport,
    models: Sequence[Path],
    actuators: str | None = None,
) -> None:
    """Prints which motion shows what, what to know, and how to go on."""
    plan = report.plan
    table = Table(box=box.SIMPLE, title=f"{len(plan.motions)} motions, {plan.duration_s:.0f} s")
    for column in ("motion", "command", "shows"):
        table.add_column(column, overflow="fold")
    for family in dict.fromkeys(one.family for one in plan.motions):
        kinds = [str(one.motion.kind) for one in plan.motions if one.family is family]
        table.add_row(family.label, ", ".join(kinds), _shows(family))
    console.print(table)
    for note in plan.notes:
        console.print(Text(f"note: {note}"), soft_wrap=True)
    for spot in plan.blind_spots:
        words = f"not shown, even so: {spot.effect} ({joints_title(spot.joints)}): {spot.why}"
        console.print(Text(words), soft_wrap=True)
    if report.recordings:
        console.print(
            Text(f"next: {diagnose_words(plan, report, models, actuators)}"), soft_wrap=True
        )


def diagnose_words(
    plan: Plan, report: PlanReport, models: Sequence[Path], actuators: str | None = None
) -> str:
    """Returns the command line that diagnoses what was recorded."""
    paths = {
        purpose: [
            report.recordings[one.motion.name]
            for one in plan.motions
            if one.family.purpose is purpose
        ]
        for purpose in Purpose
    }
    given = [word for model in models for word in ("--model", str(model))]
    given += ["--actuators", actuators] if actuators else []
    held_out = ["--holdout", *paths[Purpose.HELDOUT]]
    return shlex.join(["gfm", "diagnose", *paths[Purpose.TRAINING], *held_out, *given, "--out"]) + (
        " DIR"
    )


def print_families(console: Console) -> None:
    """Prints which motion shows which effect."""
    table = Table(box=box.SIMPLE)
    for column in ("motion", "what the robot does", "shows"):
        table.add_column(column, overflow="fold")
    for family in FAMILIES:
        table.add_row(family.label, family.words, _shows(family))
    console.print(table)


def _shows(family: Family) -> str:
    return ", ".join(family.shows) or "held out: errors are measured on it"
