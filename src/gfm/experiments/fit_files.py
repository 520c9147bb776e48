"""What `gfm fit` does: recordings and a model in, generalized forces and their worth out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gfm.api.folders import check_new_folder
from gfm.api.models import NominalModel, load_nominal, model_paths
from gfm.api.provenance import command_line, provenance
from gfm.api.recordings import check_together, read_recordings
from gfm.api.refusals import check_usable
from gfm.api.sources import check_different
from gfm.core import Clock, ConfigError, MonotonicClock
from gfm.diagnosis.data.segmentation import measure_noise
from gfm.experiments.fit import (
    FORCES,
    WARM,
    Beginning,
    FitInputs,
    FittedForces,
    ForceFit,
    force_model,
)
from gfm.experiments.joint_control import JointControlTest, ModelErrors, make_test
from gfm.experiments.progress import Phase, RunProgress
from gfm.launch import Supervisor, own_system, replay_process, router_process
from gfm.report import ModelKind
from gfm.report.files import write_texts
from gfm.sim.hybrid import HybridModel
from gfm.sim.replay import make_replay

SCHEMA = "gfm.fit/1"
REPORT = "fit.json"
_BEGIN, _LEARN, _COMPARE = "make the first policy", "learn", "compare on held-out recordings"
_RANGES = {"learning_s": (0.0, 86400.0), "actors": (1, 64), "seed": (0, 2**31)}


@dataclass(frozen=True, kw_only=True)
class FitRequest:
    """What is to be fitted.

    Attributes:
        recordings: What the simulation should follow.
        holdout: What errors are measured on; empty for the last one of the recordings.
        models: One model per kind of command.
        out: A new folder for everything.
        learning_s: Reinforcement learning, s; 0 for the first policy alone.
        began: What with.
        period_s: Between two decisions about forces.
        actors: Processes.
        seed: Of everything random.
        actuators: What joints without an actuator get.
    """

    recordings: tuple[Path, ...]
    holdout: tuple[Path, ...]
    models: tuple[Path, ...]
    out: Path
    learning_s: float = 240.0
    began: Beginning = WARM
    period_s: float = 0.02
    actors: int = 1
    seed: int = 0
    actuators: str | None = None

    def __post_init__(self) -> None:
        for name, (least, most) in _RANGES.items():
            value = getattr(self, name)
            if not least <= value <= most:
                raise ConfigError(f"{name} is {value:g}, expected {least:g} to {most:g}")
        check_new_folder(self.out)
        if not self.holdout and len(self.recordings) < 2:
            raise ConfigError(
                "1 recording and none to hold out; expected at least 2, or --holdout: forces that "
                "follow what they were fitted to say nothing about other motions"
            )


@dataclass(frozen=True, kw_only=True)
class Point:
    """A policy on its way.

    Attributes:
        time_s: Since the fit began.
        learner_step: Steps of the learner until then.
        training: Open-loop position RMSE on the recordings that are followed, rad.
        held_out: The same on those held out.
    """

    time_s: float
    learner_step: int
    training: float
    held_out: float


def fit_files(request: FitRequest, clock: Clock | None = None) -> None:
    """Fits, writes the forces and the report, and prints what they are worth.

    Raises:
        BadInputError: something given cannot be used; nothing was written.
        GfmError: a service failed.
    """
    clock = clock or MonotonicClock()
    training, held_out = request.recordings, request.holdout
    if not held_out:
        training, held_out = training[:-1], training[-1:]
    robot = load_nominal(request.models, request.actuators)
    test, nominal = _test(robot, training, held_out)
    _check_replays(robot, training, request.period_s)
    phases = [Phase(name=_BEGIN, expected_s=30.0), Phase(name=_COMPARE, expected_s=10.0)]
    if request.learning_s > 0.0:
        phases.insert(1, Phase(name=_LEARN, expected_s=request.learning_s))
    with RunProgress(phases, console=Console(stderr=True), clock=clock) as progress:
        fitted = _fit(request, robot, training, progress, clock)
        with progress.phase(_COMPARE):
            points = [_point(test, fitted, i) for i in range(len(fitted.snapshots))]
            hybrid = _errors(test, fitted)
    files = {"model": robot.files, "recording": training, "held-out recording": held_out}
    report = {
        "schema": SCHEMA,
        "unit": "rad",
        "noise_floor": float(np.sqrt(np.mean(test.problem.noise.position**2))),
        "models": [_row(test, nominal), _row(test, hybrid)],
        "curve": [asdict(point) for point in points],
        "forces": FORCES,
        "provenance": provenance(files, request.seed, command_line()),
    }
    text = json.dumps(report, indent=2, allow_nan=False) + "\n"
    (path,) = write_texts(request.out, {REPORT: text})
    _print(Console(), test, nominal, hybrid)
    for written in (request.out / FORCES, path):
        Console().print(Text(str(written)), soft_wrap=True)


def _test(
    robot: NominalModel, training: Sequence[Path], held_out: Sequence[Path]
) -> tuple[JointControlTest, ModelErrors]:
    """Returns what forces are compared on, and the nominal model on it."""
    paths = [*training, *held_out]
    recordings = read_recordings(paths)
    check_different(paths)
    read = list(zip(paths, recordings, strict=True))
    check_together(robot.specs, read)
    check_usable(robot.specs, read[: len(training)], read[len(training) :])
    noise = measure_noise(recordings[: len(training)])
    test = make_test(robot.specs, recordings[len(training) :], noise, robot.effects)
    return test, test.model_errors(ModelKind.NOMINAL, (), "as given")


def _check_replays(robot: NominalModel, training: Sequence[Path], period_s: float) -> None:
    """Raises BadInputError where a recording cannot be followed, period by period."""
    recordings = read_recordings(training)
    model = HybridModel(
        models={kind: spec.copy().compile() for kind, spec in robot.specs.items()},
        joint_names=recordings[0].joint_names,
        control_period_s=period_s,
        effects=robot.effects,
    )
    for recording in recordings:
        make_replay(model, recording)


def _fit(
    request: FitRequest,
    robot: NominalModel,
    training: Sequence[Path],
    progress: RunProgress,
    clock: Clock,
) -> FittedForces:
    inputs = FitInputs(
        models=model_paths(robot, request.out),
        recordings=tuple(training),
        folder=request.out,
        seed=request.seed,
        actors=request.actors,
        control_period_s=request.period_s,
        began=request.began,
    )
    with progress.phase(_BEGIN):
        progress.say(request.began.words)
        fit = ForceFit(inputs, clock)
    if request.learning_s > 0.0:
        processes = (router_process(), replay_process())
        system = own_system("fit", request.out, processes)
        with (
            progress.phase(_LEARN),
            Supervisor(system, request.out / "logs", clock=clock) as supervisor,
        ):
            supervisor.start()
            fit.start(supervisor)
            fit.follow(
                supervisor,
                request.learning_s,
                lambda words, share: progress.say(words, share=share),
            )
    return fit.finish()


def _point(test: JointControlTest, fitted: FittedForces, index: int) -> Point:
    snapshot, problem = fitted.snapshots[index], fitted.problem
    forces = force_model(problem, snapshot.weights)
    errors = test.hybrid_errors(ModelKind.HYBRID, forces, problem.model, "")
    return Point(
        time_s=snapshot.time_s,
        learner_step=snapshot.weights.version,
        training=snapshot.error,
        held_out=errors.overall,
    )


def _errors(test: JointControlTest, fitted: FittedForces) -> ModelErrors:
    """Returns what is kept on the held-out recordings."""
    model = fitted.problem.model
    return test.hybrid_errors(ModelKind.HYBRID, fitted.forces, model, fitted.detail)


def _row(test: JointControlTest, errors: ModelErrors) -> dict[str, object]:
    joints = dict(zip(test.problem.joints, errors.joints, strict=True))
    return {
        "model": str(errors.model),
        "detail": errors.detail,
        "overall": errors.overall,
        "joints": joints,
    }


def _print(
    console: Console, test: JointControlTest, nominal: ModelErrors, hybrid: ModelErrors
) -> None:
    table = Table(title="Held-out position error (rad, RMSE of open-loop rollouts)")
    for name in ("joint", "nominal", "with the forces", "noise"):
        table.add_column(name, justify="left" if name == "joint" else "right")
    noise = test.problem.noise.position
    rows = zip(test.problem.joints, nominal.joints, hybrid.joints, noise, strict=True)
    floor = float(np.sqrt(np.mean(noise**2)))
    for name, *figures in [("all joints", nominal.overall, hybrid.overall, floor), *rows]:
        table.add_row(str(name), *(f"{float(figure):.3g}" for figure in figures))
    console.print(table)
    console.print(Text(hybrid.detail))
