"""What `gfm run` does: the whole loop once, with real services, in one folder.

Services are processes of their own; this one drives, diagnoses, compares and reports. The loop on a
task, which has a robot of its own, is closed beside all that. The file in which the simulated robot
sealed what it hides is opened after everything else is decided.
"""

from __future__ import annotations

import shutil
import signal
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import final

from rich.console import Console
from rich.text import Text

from gfm.api.models import NominalModel, load_nominal
from gfm.api.provenance import command_line, provenance
from gfm.api.recordings import read_recordings
from gfm.core import (
    BadInputError,
    Clock,
    CommandKind,
    ConfigError,
    MonotonicClock,
    Trajectory,
)
from gfm.diagnosis.data.segmentation import measure_noise
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.correction import model_pair
from gfm.diagnosis.output.result import Diagnosis
from gfm.excitation.motion import Purpose
from gfm.excitation.waypoints import motions
from gfm.experiments.drive import Driven, drive, sawyer_ranges
from gfm.experiments.drive_request import DriveRequest
from gfm.experiments.findings import Findings, system_facts
from gfm.experiments.fit import FitInputs, FittedForces, ForceFit
from gfm.experiments.joint_control import JointControlTest, ModelErrors, make_test
from gfm.experiments.policy_flags import PLACED
from gfm.experiments.progress import Phase, RunProgress
from gfm.experiments.run_settings import RunSettings
from gfm.experiments.sealed import unseal
from gfm.experiments.slsqp import Identified, identify
from gfm.experiments.task_beside import TaskBeside
from gfm.experiments.transfer import TransferRequest
from gfm.launch import (
    LOCKSTEP,
    Supervisor,
    own_system,
    replay_process,
    robot_processes,
    router_process,
    watching,
)
from gfm.policies import ROBOT
from gfm.report import ModelKind, RunReport, print_run, write_models, write_run
from gfm.report.files import model_texts, write_texts
from gfm.report.transfer import Transfer
from gfm.sim.plant import check_joints
from gfm.sim.sawyer import JOINT_NAMES, sawyer_spec
from gfm_wire import Role

KINDS = (CommandKind.POSITION, CommandKind.VELOCITY)
START, DRIVE, MEASURE, IDENTIFY, DIAGNOSE, LEARN, LEARN_REST, TASK, EVALUATE = (
    "start the services",
    "drive and record the robot",
    "measure the nominal model",
    "identify gain and damping (SLSQP)",
    "diagnose",
    "learn generalized forces",
    "learn what the named effects leave",
    "close the loop on a task",
    "compare the models and report",
)
_EXPECTED_S = {
    START: 2.0,
    DRIVE: 110.0,
    MEASURE: 2.0,
    IDENTIFY: 6.0,
    DIAGNOSE: 35.0,
    LEARN: 40.0,
    LEARN_REST: 20.0,
    TASK: 60.0,
    EVALUATE: 5.0,
}
#: Learning ends so long before the budget does, and is not begun for less than the second, s.
_RESERVE_S, _LEAST_LEARNING_S = 50.0, 20.0
#: Longest time that is spent on learning, s.
_MOST_LEARNING_S = 20.0
#: The task, how many of its goals, attempts at each, and minutes for what their recordings tell.
_TASK, _GOALS, _TRIALS, _MINUTES = "position_matching", 4, 2, 3.0


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """What was driven.

    Attributes:
        paths: Of the recordings, by purpose.
        training: To find effects in and to fit.
        held_out: To measure errors on.
    """

    paths: Mapping[Purpose, tuple[Path, ...]]
    training: list[Trajectory]
    held_out: list[Trajectory]


def close_the_loop(settings: RunSettings, console: Console) -> RunReport:
    """Runs the loop, writes its report and prints it.

    Raises:
        BadInputError: a setting cannot be used; where the robot says so, the folder is removed.
        GfmError: a service failed.
    """
    # SIGTERM ends a run as Ctrl-C does: by leaving the block that owns the processes.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    report = _Run(settings, console, MonotonicClock()).report()
    paths = write_run(settings.folder, report)
    print_run(console, report)
    for path in paths:
        console.print(Text(str(path)), soft_wrap=True)
    return report


@final
class _Run:
    """The state of one run: what each phase leaves for the next ones."""

    def __init__(self, settings: RunSettings, console: Console, clock: Clock) -> None:
        self._settings, self._clock = settings, clock
        self._nominal = nominal_arm(settings.models)
        for line in self._nominal.about:
            console.print(Text(line), soft_wrap=True)
        left_out = {LEARN, LEARN_REST} if settings.skip_gfm else set[str]()
        left_out |= {TASK} if settings.skip_task else set()
        self._reserve_s = _RESERVE_S + (0.0 if settings.skip_task else _EXPECTED_S[TASK])
        phases = [Phase(name=n, expected_s=s) for n, s in _EXPECTED_S.items() if n not in left_out]
        self._progress = RunProgress(phases, console=console, clock=clock)

    def report(self) -> RunReport:
        """Runs all phases."""
        with self._progress, closing(self._task_beside()) as beside:
            with self._supervisor() as supervisor:
                self._start(supervisor)
                if not self._settings.skip_task:
                    beside.start()
                recorded = self._drive(supervisor)
                test, nominal = self._measure(recorded)
                identified = self._identify(recorded)
                diagnosis, corrected = self._diagnose(recorded)
                fitted = self._learn(supervisor, recorded)
                rest = self._learn_rest(recorded, corrected) if diagnosis.effects else None
                facts = system_facts(supervisor)
            task = self._on_task(beside)
            return self._compare(
                Findings(
                    test=test,
                    nominal=nominal,
                    identified=identified,
                    diagnosis=diagnosis,
                    fitted=fitted,
                    rest=rest,
                    facts=facts,
                    task=task,
                )
            )

    @property
    def _sealed(self) -> Path:
        return self._settings.folder.absolute() / "sealed.json"

    @property
    def _models(self) -> dict[CommandKind, Path]:
        folder = self._settings.folder / "models"
        return {kind: folder / f"sawyer_{kind}.xml" for kind in KINDS}

    def _supervisor(self) -> Supervisor:
        folder, seed = self._settings.folder.absolute(), self._settings.seed
        robot = (
            *("--hidden-effect", self._settings.hidden_effect),
            *("--seed", str(seed), "--sealed", str(self._sealed)),
            *LOCKSTEP,
        )
        bridge = ("--recordings", str(folder / "recordings"), *LOCKSTEP)
        processes = (router_process(), replay_process(), *robot_processes(bridge, robot))
        system = own_system("loop", folder, processes)
        return Supervisor(system, folder / "logs", clock=self._clock)

    def _start(self, supervisor: Supervisor) -> None:
        with self._progress.phase(START):
            self._progress.say("replay, robot bridge, simulated Sawyer")
            try:
                supervisor.start()
            except BadInputError:
                supervisor.stop()
                shutil.rmtree(self._settings.folder)  # it was new, and holds logs alone
                raise
            for kind, path in self._models.items():
                pair = model_pair(self._nominal.specs[kind], self._nominal.effects)
                write_texts(path.parent, model_texts(path.stem, pair))

    def _drive(self, supervisor: Supervisor) -> Recorded:
        chosen = motions(
            sawyer_ranges(), seed=self._settings.seed, duration_s=self._settings.motion_s
        )

        driven: list[Driven] = []
        idle = watching(supervisor, self._clock)
        with (
            self._progress.phase(DRIVE),
            supervisor.spec.address.open(Role.DRIVER, name="run") as driver,
        ):
            self._progress.say(chosen[0].name, share=0.0)
            for one in drive(driver, self._clock, chosen, idle=idle):
                driven.append(one)
                ahead = chosen[len(driven) : len(driven) + 1]
                now = ahead[0].name if ahead else "reading the recordings"
                self._progress.say(now, share=len(driven) / len(chosen))
            paths = {p: tuple(d.path for d in driven if d.purpose is p) for p in Purpose}
            return Recorded(
                paths=paths,
                training=read_recordings(paths[Purpose.TRAINING]),
                held_out=read_recordings(paths[Purpose.HELDOUT]),
            )

    def _measure(self, recorded: Recorded) -> tuple[JointControlTest, ModelErrors]:
        with self._progress.phase(MEASURE):
            self._progress.say("open-loop rollouts of the held-out recordings")
            noise = measure_noise(recorded.training)
            specs, given = self._nominal.specs, self._nominal.effects
            test = make_test(specs, recorded.held_out, noise, given)
            return test, test.model_errors(ModelKind.NOMINAL, (), "as published")

    def _identify(self, recorded: Recorded) -> Identified:
        with self._progress.phase(IDENTIFY):
            self._progress.say("gain and damping of every joint, on training recordings")
            specs, given = self._nominal.specs, self._nominal.effects
            return identify(specs, recorded.training, given=given)

    def _diagnose(self, recorded: Recorded) -> tuple[Diagnosis, Mapping[CommandKind, Path]]:
        """Returns the diagnosis and the files of the corrected models."""
        files = {
            "model": tuple(self._models.values()),
            "recording": recorded.paths[Purpose.TRAINING],
            "held-out recording": recorded.paths[Purpose.HELDOUT],
        }
        with self._progress.phase(DIAGNOSE):
            diagnosis = diagnose(
                self._nominal.specs,
                recorded.training,
                recorded.held_out,
                report=self._progress.say,
                provenance=provenance(files, self._settings.seed, command_line()),
                given=self._nominal.effects,
            )
        return diagnosis, write_models(self._settings.folder / "models", diagnosis.twins)

    def _learn(self, supervisor: Supervisor, recorded: Recorded) -> FittedForces | None:
        if self._settings.skip_gfm:
            return None
        with self._progress.phase(LEARN):
            self._progress.say("warm start: inverse dynamics, regressed")
            fit = ForceFit(self._fit_inputs(recorded, self._models, "checkpoints"), self._clock)
            left_s = self._settings.budget_s - self._reserve_s - self._progress.time_s
            if left_s >= _LEAST_LEARNING_S:
                self._progress.say("starting learner and actors")
                fit.start(supervisor)
                fit.follow(supervisor, min(left_s, _MOST_LEARNING_S), self._learning)
            return fit.finish()

    def _learn_rest(
        self, recorded: Recorded, corrected: Mapping[CommandKind, Path]
    ) -> FittedForces | None:
        """Returns forces for what the corrected model still lacks, by the warm start alone."""
        if self._settings.skip_gfm:
            return None
        with self._progress.phase(LEARN_REST):
            self._progress.say("inverse dynamics of the corrected model, regressed")
            inputs = self._fit_inputs(recorded, corrected, "checkpoints/corrected")
            return ForceFit(inputs, self._clock).finish()

    def _task_beside(self) -> TaskBeside:
        """Returns what drives a robot with an object, before and after, beside the other phases."""
        request = TransferRequest(
            drive=DriveRequest(
                task=_TASK,
                robot_config=ROBOT,
                goals=_GOALS,
                trials=_TRIALS,
                seed=self._settings.seed,
                out=self._settings.folder / "task",
            ),
            minutes=_MINUTES,
            air_s=0.0,  # what this robot hides shows in attempts, too, and ten minutes are short
            treatments=(PLACED,),
        )
        return TaskBeside(request, self._settings.folder / "logs" / "task.log", self._clock)

    def _on_task(self, beside: TaskBeside) -> Transfer | None:
        """Returns what a policy does on a robot with an object, before and after."""
        if self._settings.skip_task:
            return None
        with self._progress.phase(TASK):
            return beside.result(self._progress.say)

    def _fit_inputs(
        self, recorded: Recorded, models: Mapping[CommandKind, Path], folder: str
    ) -> FitInputs:
        return FitInputs(
            models=models,
            recordings=recorded.paths[Purpose.TRAINING],
            folder=self._settings.folder / folder,
            seed=self._settings.seed,
            actors=self._settings.actors,
        )

    def _learning(self, words: str, share: float) -> None:
        self._progress.say(words, share=share)

    def _compare(self, findings: Findings) -> RunReport:
        with self._progress.phase(EVALUATE):
            self._progress.say("open-loop rollouts of the held-out recordings")
            models = findings.models()
        return findings.report(
            self._settings.folder.name, models, self._progress.durations_s(), unseal(self._sealed)
        )


def nominal_arm(models: Sequence[Path]) -> NominalModel:
    """Returns the arm in the files `models`; the published one without any.

    Raises:
        BadInputError: a file cannot be used, or the files are no such arm.
    """
    if not models:
        specs = {kind: sawyer_spec(command=kind) for kind in KINDS}
        return NominalModel(specs=specs, paths={}, effects=(), files=(), about=())
    nominal = load_nominal(models)
    if set(nominal.specs) != set(KINDS):
        raise ConfigError(
            f"models for {', '.join(sorted(nominal.specs))} commands; expected one for each of "
            f"{', '.join(sorted(KINDS))}: the arm is driven in both modes"
        )
    for spec in nominal.specs.values():
        check_joints(spec, JOINT_NAMES)
    return nominal
