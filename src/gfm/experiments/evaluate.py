"""What `gfm evaluate` does: reads policy and model, tests, reports."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from rich.console import Console

from gfm.api.films.renderer import NoFilmError
from gfm.api.provenance import command_line, provenance
from gfm.core import BadInputError, CommandKind, ConfigError, EnvironmentSpec, Weights
from gfm.envs.arm import ArmProblem
from gfm.envs.control_settings import ControlSettings
from gfm.envs.evaluation import SimulatedAttempts, evaluate
from gfm.envs.matching import Matching
from gfm.envs.matching_task import TASKS
from gfm.envs.registry import EnvironmentSettings, arm_problem, furnished
from gfm.envs.sensing import Sensing
from gfm.experiments.film import write_film
from gfm.policies import shipped_policy
from gfm.recording.weights_file import read_weights
from gfm.report.evaluation import (
    Evaluation,
    evaluation_json,
    evaluation_texts,
    print_evaluation,
)
from gfm.report.files import write_texts
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.service.assets import Complete, load_assets

_POLICY = ("policy.npz", "checkpoints/policy.npz")


@dataclass(frozen=True, kw_only=True)
class EvaluationRequest:
    """What is asked for.

    Attributes:
        task: Name of the environment.
        policy: Of a file, or of a folder that holds one; by default the one that comes with gfm.
        model: MJCF for velocity commands; None for the nominal cell.
        forces: Generalized force models.
        sensed: Whether the policy sees what a robot's sensors tell, late and with noise, instead
            of what there is.
        trials: Attempts per goal.
        seed: Of the starts.
        as_json: Whether to print JSON.
        out: Folder for report and films; None for neither.
    """

    task: str
    policy: Path | None = None
    model: Path | None = None
    forces: tuple[Path, ...] = ()
    sensed: bool = False
    trials: int = 5
    seed: int = 0
    as_json: bool = False
    out: Path | None = None

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise ConfigError(f"--trials is {self.trials}, expected at least 1")


def evaluate_policy(request: EvaluationRequest) -> Evaluation:
    """Tests a policy, writes the report where that is wanted, and prints it.

    Raises:
        BadInputError: policy, model and task do not go together.
    """
    task = TASKS[request.task]
    path = policy_path(request.policy or shipped_policy(request.task))
    weights = read_weights(path)
    arm = load_arm(request)
    policy = policy_for(path, weights, Matching(task, arm, 1).spec)
    attempts = evaluate(
        task, arm, policy.mean_action, trials=request.trials, seed=request.seed, nthread=2
    )
    models = (request.model,) if request.model else ()
    files = {"policy": (path,), "model": models, "forces": request.forces}
    evaluation = Evaluation(
        task=task,
        attempts=attempts,
        trials=request.trials,
        provenance={
            "policy_version": weights.version,
            **provenance(files, request.seed, command_line()),
        },
    )
    if request.out is not None:
        evaluation = _with_films(evaluation, attempts, arm, request.out)
        write_texts(request.out, evaluation_texts(evaluation))
    if request.as_json:
        sys.stdout.write(json.dumps(evaluation_json(evaluation), indent=2, allow_nan=False) + "\n")
    else:
        print_evaluation(Console(), evaluation)
    return evaluation


def policy_path(given: Path) -> Path:
    """Returns the policy's file: the one given, or the one in a folder of a run."""
    if not given.is_dir():
        return given
    for name in _POLICY:
        if (given / name).is_file():
            return given / name
    raise BadInputError(f"policy {given}: a folder without {' or '.join(_POLICY)}")


def load_arm(request: EvaluationRequest, complete: Complete | None = None) -> ArmProblem:
    """Returns the cell that a request names.

    Args:
        request: Names it.
        complete: Makes a model fit for the task; by default it only furnishes the cell.
    """
    settings = EnvironmentSettings(
        models={CommandKind.VELOCITY: str(request.model)} if request.model else {},
        control=ControlSettings(
            ensemble=tuple(str(path) for path in request.forces),
            sensing=Sensing() if request.sensed else None,
        ),
    )
    assets = load_assets(settings, complete or partial(furnished, request.task))
    return arm_problem(request.task, settings, assets)


def policy_for(path: Path, weights: Weights, spec: EnvironmentSpec) -> GaussianPolicy:
    """Returns the policy, if it was made for the environment.

    Raises:
        BadInputError: it was made for another one, or is no policy.
    """
    policy = GaussianPolicy.from_weights(weights)
    got = policy.observation_size, policy.action_size
    if weights.spec_digest != spec.digest or got != (spec.policy_size, spec.action_size):
        raise BadInputError(
            f"policy {path}: maps {got[0]} observations to {got[1]} actions (spec "
            f"{weights.spec_digest or 'unknown'}), expected {spec.policy_size} to "
            f"{spec.action_size} for {spec.name} (spec {spec.digest}): is it for another task?"
        )
    return policy


def _with_films(
    evaluation: Evaluation, attempts: SimulatedAttempts, arm: ArmProblem, out: Path
) -> Evaluation:
    """Films the best and the worst attempt; where that cannot be done, notes it once."""
    films = []
    for label, index in (("best", attempts.best), ("worst", attempts.worst)):
        path = out / f"{label}.mp4"
        qpos = attempts.qpos[: int(attempts.steps[index]) + 1, index]
        goal = attempts.goals[attempts.goal[index]]
        try:
            write_film(path, arm.nominal, qpos, goal, evaluation.task.tolerance_m)
        except NoFilmError as error:
            return replace(evaluation, notes=(*evaluation.notes, str(error)))
        films.append(path.name)
    return replace(evaluation, films=tuple(films))
