"""What `gfm fit` and `gfm.fit` do: recordings and a model in, forces and their worth out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from gfm.api.folders import check_new_folder
from gfm.api.models import Model, NominalModel, load_nominal, model_paths
from gfm.api.provenance import provenance
from gfm.api.recordings import check_together, read_recordings
from gfm.api.refusals import check_usable
from gfm.api.sources import check_different
from gfm.core import Clock, ConfigError, MonotonicClock, Trajectory
from gfm.envs.pushes import MOVES_M, make_pushes
from gfm.experiments.fit import (
    FORCES,
    WARM,
    Beginning,
    FitInputs,
    FittedForces,
    ForceFit,
    Snapshot,
    force_model,
)
from gfm.experiments.fit_answer import Fit
from gfm.experiments.fit_judge import Judge, Judged, make_judge
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
        models: Of the robot; one per kind of command.
        out: A new folder for everything.
        learning_s: Reinforcement learning, s; 0 for the first policy alone.
        began: What with.
        period_s: Between two decisions about forces.
        actors: Processes.
        seed: Of everything random.
        actuators: What joints without an actuator get.
        words: What asked, for the report.
    """

    recordings: tuple[Path, ...]
    holdout: tuple[Path, ...]
    models: Model
    out: Path
    learning_s: float = 240.0
    began: Beginning = WARM
    period_s: float = 0.02
    actors: int = 1
    seed: int = 0
    actuators: str | None = None
    words: Sequence[str] = ("gfm.fit",)

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
        training: Error on the recordings that are followed, see `FittedForces.unit`.
        held_out: On those held out: open-loop position RMSE, rad.
        object_m: The same of an object's place, m; None where there is none.
    """

    time_s: float
    learner_step: int
    training: float
    held_out: float
    object_m: float | None = None


def fit_files(request: FitRequest, console: Console, clock: Clock | None = None) -> Fit:
    """Fits, writes the forces and the report, and returns what they are worth.

    Args:
        request: What is to be fitted.
        console: Where progress is shown.
        clock: By which it is timed.

    Raises:
        BadInputError: something given cannot be used; nothing was written.
        GfmError: a service failed.
    """
    clock = clock or MonotonicClock()
    training, held_out = request.recordings, request.holdout
    if not held_out:
        training, held_out = training[:-1], training[-1:]
    robot = load_nominal(request.models, request.actuators)
    judge = _judge(robot, training, held_out, request.period_s)
    phases = [Phase(name=_BEGIN, expected_s=30.0), Phase(name=_COMPARE, expected_s=10.0)]
    if request.learning_s > 0.0:
        phases.insert(1, Phase(name=_LEARN, expected_s=request.learning_s))
    with RunProgress(phases, console=console, clock=clock) as progress:
        fitted = _fit(request, robot, training, progress, clock)
        with progress.phase(_COMPARE):
            points = [_point(judge, fitted, one) for one in fitted.snapshots]
            nominal = judge.errors(None, fitted.problem)
            hybrid = judge.errors(fitted.forces, fitted.problem)
    files = {"model": robot.files, "recording": training, "held-out recording": held_out}
    report = {
        "schema": SCHEMA,
        "unit": "rad",
        "noise_floor": float(np.sqrt(np.mean(judge.noise**2))),
        "models": [
            _row(judge, ModelKind.NOMINAL, nominal, "as given"),
            _row(judge, ModelKind.HYBRID, hybrid, fitted.detail),
        ],
        "curve": [asdict(point) for point in points],
        "forces": FORCES,
        "provenance": provenance(files, request.seed, request.words),
    }
    text = json.dumps(report, indent=2, allow_nan=False) + "\n"
    (path,) = write_texts(request.out, {REPORT: text})
    return Fit(
        joint_names=judge.joint_names,
        noise=tuple(map(float, judge.noise)),
        before=nominal,
        after=hybrid,
        detail=fitted.detail,
        forces=request.out / FORCES,
        report=path,
    )


def _judge(
    robot: NominalModel, training: Sequence[Path], held_out: Sequence[Path], period_s: float
) -> Judge:
    """Returns what forces are compared on.

    Raises:
        BadInputError: models and recordings cannot be used, or do not belong together.
    """
    paths = [*training, *held_out]
    recordings = read_recordings(paths)
    check_different(paths)
    read = list(zip(paths, recordings, strict=True))
    check_together(robot.specs, read)
    fitted, kept = recordings[: len(training)], recordings[len(training) :]
    check_usable(robot.specs, read[: len(training)], read[len(training) :])
    model = HybridModel(
        models={kind: spec.copy().compile() for kind, spec in robot.specs.items()},
        joint_names=recordings[0].joint_names,
        control_period_s=period_s,
        effects=robot.effects,
    )
    for recording in fitted:
        make_replay(model, recording)
    if model.layout.has_object:
        for what, some in (("recording", fitted), ("held-out recording", kept)):
            _check_pushed(model, what, some)
    return make_judge(robot, fitted, kept, pushes=model.layout.has_object)


def _check_pushed(model: HybridModel, what: str, recordings: Sequence[Trajectory]) -> None:
    """Raises BadInputError where no object is recorded, or none moves."""
    if not make_pushes(model, recordings):
        raise ConfigError(
            f"in no {what} the object rests and then moves by {1e3 * MOVES_M:g} mm; the model has "
            "a free object, expected recordings in which it is pushed from rest"
        )


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


def _point(judge: Judge, fitted: FittedForces, snapshot: Snapshot) -> Point:
    found = judge.errors(force_model(fitted.problem, snapshot.weights), fitted.problem)
    return Point(
        time_s=snapshot.time_s,
        learner_step=snapshot.weights.version,
        training=snapshot.error,
        held_out=found.overall,
        object_m=None if found.pushed is None else found.pushed.place_m,
    )


def _row(judge: Judge, kind: ModelKind, errors: Judged, detail: str) -> dict[str, object]:
    row = {
        "model": str(kind),
        "detail": detail,
        "overall": errors.overall,
        "joints": dict(zip(judge.joint_names, errors.joints, strict=True)),
    }
    if errors.pushed is None:
        return row
    place_m, yaw_rad = errors.pushed.place_m, errors.pushed.yaw_rad
    return row | {"object": {"place_m": place_m, "yaw_rad": yaw_rad}}
