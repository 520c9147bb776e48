"""What the arm does by itself in a campaign: motions above the basket, commanded as positions.

An attempt shows the arm next to things that it touches, and what pushes back hides what the model
lacks of the arm; under a load that nobody told of an attempt is over after a second. In the air
nothing pushes, and by positions the arm bears whatever its drives can hold.

Shape letters: J joints.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from rich.console import Console
from rich.text import Text

from gfm.api.models import load_specs
from gfm.api.provenance import command_line, provenance
from gfm.core import BadInputError, Clock, CommandKind, MonotonicClock
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.matching_task import TASKS
from gfm.excitation.limits import Wishes, robot_limits
from gfm.excitation.motion import Purpose
from gfm.excitation.plan import Plan, Request, make_plan
from gfm.experiments.attempt_start import AttemptStart
from gfm.experiments.attempt_view import RobotView
from gfm.experiments.drive import record_motion, sawyer_ranges
from gfm.experiments.drive_policy import on_robot
from gfm.experiments.drive_request import DriveRequest
from gfm.experiments.driver import Driver
from gfm.experiments.evaluate import EvaluationRequest, load_arm
from gfm.experiments.person import Person
from gfm.report import PlanReport, write_plan
from gfm.sim.sawyer import JOINT_NAMES, READY

#: How far above where attempts begin the tool is where motions begin, and how far the arm keeps
#: from everything, m. By both the tool keeps some 10 cm from the basket: an encoder's offset of
#: 0.05 rad, which hardly an attempt survives, moves it by 4 cm.
HEIGHT_M, CLEARANCE_M = 0.3, 0.03
#: Of where the arm may be driven without a basket below it, and of its accelerations: beyond, the
#: bridge, which looks ahead to where the arm can stop, would change what is commanded.
WIDTH_SHARE, ACCELERATION_SHARE = 0.7, 0.4


@dataclass(frozen=True, kw_only=True)
class AirMotions:
    """Recordings of them.

    Attributes:
        training: To learn from.
        held_out: That judge.
        seconds: How long the robot moved, s.
    """

    training: tuple[Path, ...] = ()
    held_out: tuple[Path, ...] = ()
    seconds: float = 0.0

    def __bool__(self) -> bool:
        """Says whether there are any."""
        return bool(self.training)


def air_motions(request: DriveRequest, model: Path, seconds: float, console: Console) -> AirMotions:
    """Returns recordings of the arm in the air; has them made where they are not there.

    Args:
        request: The robot; its folder is for the motions.
        model: Of the cell, for commands of positions.
        seconds: Length of each motion.
        console: Told what is happening.

    Raises:
        BadInputError: the robot cannot be what is asked for, or no motion is possible.
        RefusedError: the bridge says no.
        UnreachableError: the robot does not answer.
        KeyboardInterrupt: somebody ended it.
    """
    if made := recorded_in(request.out):
        return made
    arm = load_arm(EvaluationRequest(task=request.task))
    spec = load_specs(model)[CommandKind.POSITION]
    told = PlanReport(
        plan=air_plan(spec.compile(), arm, seconds, request.seed),
        robot=model.stem,
        provenance=provenance({"model": (model,)}, request.seed, command_line()),
    )
    write_plan(request.out, told)  # whoever watches can look at what comes
    recordings = _driven(request, told.plan, arm, MonotonicClock(), console)
    if len(recordings) < len(told.plan.motions):
        raise KeyboardInterrupt
    write_plan(request.out, replace(told, recordings=recordings))
    if not (made := recorded_in(request.out)):
        raise BadInputError(
            f"{request.out}: the bridge says that it recorded {next(iter(recordings.values()))}; "
            "expected that file on this machine"
        )
    return made


def air_plan(model: mujoco.MjModel, arm: ArmProblem, seconds: float, seed: int) -> Plan:
    """Returns motions that show what an arm may lack, above where attempts begin.

    Args:
        model: Of the cell, for commands of positions.
        arm: By which the tool is placed.
        seconds: Length of each.
        seed: Of phases, postures and orders.

    Raises:
        ConfigError: no motion is possible.
    """
    around = sawyer_ranges()
    half_width = WIDTH_SHARE * around.half_width
    acceleration = ACCELERATION_SHARE * around.acceleration
    start = RobotView(arm).raised(READY, HEIGHT_M)
    limits = robot_limits(
        {CommandKind.POSITION: model},
        Wishes(
            pose="ready",
            speed=dict(zip(JOINT_NAMES, around.speed.tolist(), strict=True)),
            acceleration=dict(zip(JOINT_NAMES, acceleration.tolist(), strict=True)),
        ),
    )
    limits = replace(
        limits,
        start=start,
        lower=np.maximum(limits.lower, start - half_width),
        upper=np.minimum(limits.upper, start + half_width),
    )
    asked = Request(
        kinds=(CommandKind.POSITION,), seconds=seconds, period_s=CONTROL_PERIOD_S, seed=seed
    )
    return make_plan(model, limits, asked, clearance_m=CLEARANCE_M)


def _driven(
    request: DriveRequest, plan: Plan, arm: ArmProblem, clock: Clock, console: Console
) -> Mapping[str, str]:
    """Returns where motions were recorded, by name; fewer than there are where that was ended."""
    recordings: dict[str, str] = {}

    def all_of_them(driver: Driver, person: Person) -> None:
        start = AttemptStart(TASKS[request.task], RobotView(arm), driver, person)
        begin = plan.limits.start
        while not (
            start.lift() and driver.go_to(JOINT_NAMES, begin, CONTROL_PERIOD_S, person.interrupts)
        ):
            if not person.resumes(start.rest):
                return
        for one in plan.motions:
            if person.interrupts() and not person.resumes(start.rest):
                return
            # The folder may be the bridge's, and that of one that was broken off keeps its name.
            name = f"{one.motion.name}_{clock.utc_ns() // 1_000_000}"
            made = record_motion(driver, replace(one.motion, name=name))
            recordings[one.motion.name] = str(made.path)
            words = f"{len(recordings)} of {len(plan.motions)}: {one.family.words}"
            console.print(Text(words), soft_wrap=True)

    on_robot(request, clock, arm.zero, all_of_them)
    return recordings


def recorded_in(folder: Path) -> AirMotions:
    """Returns what was recorded in a folder of `air_motions`; none where that is not all of it."""
    path = folder / "plan.json"
    if not path.is_file():
        return AirMotions()
    document = json.loads(path.read_text())
    recordings = [(Path(one["recording"] or ""), one["purpose"]) for one in document["motions"]]
    if not all(recording.is_file() for recording, _ in recordings):
        return AirMotions()
    return AirMotions(
        training=tuple(one for one, purpose in recordings if purpose == Purpose.TRAINING),
        held_out=tuple(one for one, purpose in recordings if purpose == Purpose.HELDOUT),
        seconds=float(document["duration_s"]),
    )
