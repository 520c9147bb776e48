"""Learns generalized forces through the services, and keeps the best of what was learned.

Warm start: forces by inverse dynamics along the training recordings, regressed onto the policy
network. From there MPO goes on in the learner, with actors in `gfm_fit`. Every now and then the
learner's policy is rolled out along the *training* recordings; the best one is kept, the warm start
among them. Held-out recordings are never looked at here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np

from gfm.core import Clock, CommandKind, GfmError, Trajectory, Weights
from gfm.core.checks import Array
from gfm.envs.fit_problem import FitProblem
from gfm.envs.gfm_fit import NAME
from gfm.envs.registry import EnvironmentSettings, fit_problem, make_environment
from gfm.envs.warm_start import warm_start_examples
from gfm.experiments.fit_curves import error_curves, learning_curves, metric_rows
from gfm.experiments.joint_control import ForceModel
from gfm.launch import Supervisor, actor_processes, learner_process
from gfm.recording.weights_file import write_weights
from gfm.report import TrainingCurve
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.rl.regression import RegressionSettings, fit_policy
from gfm.service.assets import load_assets
from gfm.sim.rollout import rollouts
from gfm.transport import ask
from gfm_wire import WeightsRequest

WARM_START, BEST = "warm_start.npz", "gfm.npz"
_POLL_NS = 500_000_000
_ASK_S = 30.0


@dataclass(frozen=True, kw_only=True)
class FitInputs:
    """Files that actors and learner read, too.

    Attributes:
        models: MJCF of the nominal model by kind of command.
        recordings: To be fitted.
        folder: For policies and checkpoints.
        seed: Of everything random.
        actors: Processes.
    """

    models: Mapping[CommandKind, Path]
    recordings: tuple[Path, ...]
    folder: Path
    seed: int
    actors: int

    @property
    def environment(self) -> EnvironmentSettings:
        """What the environment is told."""
        return EnvironmentSettings(
            models={kind: str(path) for kind, path in self.models.items()},
            recordings=tuple(str(path) for path in self.recordings),
        )

    @property
    def arguments(self) -> tuple[str, ...]:
        """The same as flags of actors and learner."""
        models = [("--model", f"{kind}={path}") for kind, path in self.models.items()]
        recordings = [("--recording", str(path)) for path in self.recordings]
        return ("--env", NAME, *(word for pair in (*models, *recordings) for word in pair))


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """One version of the policy.

    Attributes:
        weights: Its parameters; version 0 is the warm start.
        time_s: Since the services began to learn.
        error: Rollout position RMSE on the training recordings, rad.
    """

    weights: Weights
    time_s: float
    error: float


@dataclass(frozen=True, kw_only=True)
class FittedForces:
    """What came of the fit.

    Attributes:
        problem: The model, features and recordings that were fitted with.
        nominal_error: Training error without any forces, rad.
        snapshots: In order of time; the first is the warm start.
        curves: How the fit went.
    """

    problem: FitProblem
    nominal_error: float
    snapshots: tuple[Snapshot, ...]
    curves: tuple[TrainingCurve, ...]

    @property
    def best(self) -> Snapshot:
        """The one with the smallest training error."""
        return min(self.snapshots, key=lambda snapshot: snapshot.error)

    @property
    def forces(self) -> ForceModel:
        """The best policy, ready to be rolled out."""
        return force_model(self.problem, self.best.weights)

    @property
    def detail(self) -> str:
        """What was kept, and what learning added to the warm start, in words."""
        warm, best = self.snapshots[0], self.best
        learned = [one for one in self.snapshots if one.weights.version > 0]
        figures = f"training error {self.nominal_error:.3g} rad without forces, {warm.error:.3g}"
        if not learned:
            return f"warm start (inverse dynamics, regressed); {figures} with it"
        if best is warm:
            least = min(one.error for one in learned)
            return (
                f"warm start kept: reinforcement learning did not improve it; {figures} with the "
                f"warm start, {least:.3g} at best after learning"
            )
        return (
            f"warm start refined by {best.weights.version} learner steps; {figures} with the warm "
            f"start, {best.error:.3g} after learning"
        )


def force_model(problem: FitProblem, weights: Weights) -> ForceModel:
    """Returns the policy's mean as a generalized force model."""
    policy = GaussianPolicy.from_weights(weights)
    return ForceModel(model=problem.model, features=problem.features, policy=policy.mean_action)


@final
class ForceFit:
    """A fit under way: `start`, then `wait` and `snapshot` until time is up, then `finish`."""

    def __init__(self, inputs: FitInputs, clock: Clock) -> None:
        """Fits the warm start and writes it for the learner."""
        self._inputs, self._clock = inputs, clock
        settings = inputs.environment
        assets = load_assets(settings)
        self._trajectories: Sequence[Trajectory] = assets.trajectories
        self._problem = fit_problem(settings, assets)
        spec = make_environment(NAME, settings, num_envs=1, seed=0, assets=assets).spec
        weights = self._warm_start(spec.digest)
        write_weights(inputs.folder / WARM_START, weights)
        self._nominal_error = training_error(self._problem, self._trajectories, None)
        self._snapshots = [Snapshot(weights=weights, time_s=0.0, error=self._error(weights))]
        self._began_ns, self._began_utc_s = clock.now_ns(), clock.utc_ns() * 1e-9

    def _warm_start(self, spec_digest: str) -> Weights:
        examples = warm_start_examples(self._problem, self._trajectories)
        fitted = fit_policy(*examples, RegressionSettings(), self._inputs.seed)
        return Weights(
            version=0,
            created_ns=self._clock.utc_ns(),
            spec_digest=spec_digest,
            tensors=fitted.tensors,
        )

    def start(self, supervisor: Supervisor) -> None:
        """Starts learner and actors in a running system."""
        folder, seed = self._inputs.folder, self._inputs.seed
        learner = (
            *("--init", str(folder / WARM_START), "--seed", str(seed)),
            *("--checkpoint-dir", str(folder)),
            *self._inputs.arguments,
        )
        self._began_ns = self._clock.now_ns()
        self._began_utc_s = self._clock.utc_ns() * 1e-9
        supervisor.add(
            learner_process(learner),
            *actor_processes(self._inputs.actors, seed, self._inputs.arguments),
        )

    @property
    def time_s(self) -> float:
        """Since learner and actors were started."""
        return (self._clock.now_ns() - self._began_ns) * 1e-9

    def wait(self) -> str:
        """Waits a moment; returns how learning goes, in words."""
        self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        rows = metric_rows(self._inputs.folder)
        first, last = self._snapshots[0].error, self._snapshots[-1].error
        errors = f"training error {first:.3g} rad at first, {last:.3g} now"
        if not rows:
            return f"waiting for sequences; {errors}"
        newest = rows[-1]
        return f"step {newest['learner_step']:.0f}, reward {newest['reward_mean']:.3f}, {errors}"

    def snapshot(self, supervisor: Supervisor) -> Snapshot:
        """Asks the learner for its policy and measures it on the training recordings."""
        answer = ask(
            supervisor.transport,
            "weights/current",
            WeightsRequest(spec_digest=self._snapshots[0].weights.spec_digest),
            timeout_s=_ASK_S,
            clock=self._clock,
        )
        if not isinstance(answer, Weights):
            raise GfmError(f"the learner answered {type(answer).__name__}, expected Weights")
        snapshot = Snapshot(weights=answer, time_s=self.time_s, error=self._error(answer))
        self._snapshots.append(snapshot)
        return snapshot

    def finish(self) -> FittedForces:
        """Returns the outcome, and writes the best policy."""
        points = [(s.time_s, s.weights.version, s.error) for s in self._snapshots]
        fitted = FittedForces(
            problem=self._problem,
            nominal_error=self._nominal_error,
            snapshots=tuple(self._snapshots),
            curves=(
                *learning_curves(metric_rows(self._inputs.folder), self._began_utc_s),
                *error_curves(points, self._nominal_error),
            ),
        )
        write_weights(self._inputs.folder / BEST, fitted.best.weights)
        return fitted

    def _error(self, weights: Weights) -> float:
        forces = force_model(self._problem, weights)
        return training_error(self._problem, self._trajectories, forces)


def training_error(
    problem: FitProblem, trajectories: Sequence[Trajectory], forces: ForceModel | None
) -> float:
    """Returns the position RMSE of whole open-loop rollouts, rad."""
    predictions = rollouts(
        problem.model,
        trajectories,
        policy=None if forces is None else forces.policy,
        features=None if forces is None else forces.features,
    )
    errors: list[Array] = [
        trajectory.position[prediction.first :] - prediction.position
        for trajectory, prediction in zip(trajectories, predictions, strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
