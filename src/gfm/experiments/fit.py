"""Learns generalized forces through the services, and keeps the best of what was learned.

The warm start (`gfm.experiments.fit_warm`) comes first. From there MPO goes on in the learner, with
actors in `gfm_fit`. Every now and then the learner's policy is rolled out along the *training*
recordings; the best one is kept, the warm start among them, or no force at all where none of them
does any good. Where an object is pushed, its place in pushes from rest counts
(`gfm.envs.pushes`). Held-out recordings are never looked at here.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np

from gfm.core import Clock, CommandKind, GfmError, Trajectory, UnreachableError, Weights
from gfm.core.checks import Array32
from gfm.envs.fit_problem import FitProblem
from gfm.envs.gfm_fit import NAME
from gfm.envs.pushes import errors_under, make_pushes
from gfm.envs.registry import EnvironmentSettings, make_environment
from gfm.experiments.fit_curves import error_curves, learning_curves, metric_rows
from gfm.experiments.fit_warm import WarmStart, warm_start
from gfm.experiments.joint_control import ForceModel
from gfm.launch import (
    Keeper,
    SupervisionConfig,
    Supervisor,
    actor_processes,
    learner_process,
)
from gfm.recording.weights_file import write_weights
from gfm.report import TrainingCurve
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.rl.regression import RegressionSettings
from gfm.service.assets import load_assets
from gfm.service.force_files import write_forces
from gfm.sim.rollout import rollout_errors
from gfm.transport import Transport, ask
from gfm_wire import Role, WeightsRequest

#: Policies; and the best one with all that is needed to use it elsewhere.
WARM_START, BEST, FORCES = "warm_start.npz", "gfm.npz", "forces.npz"
#: Control periods of an episode.
HORIZON = 40
_POLL_NS = 500_000_000
#: Between two looks at the policy, s.
SNAPSHOT_S = 15.0
_ASK_S = 30.0

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """What learning begins with, and how it goes on from there.

    Attributes:
        words: What the first policy is called.
        critic_first_steps: In which only the critic learns: the policy is the first one still.
        learning: The learner's other settings, lines of TOML.
        regression: How the first policy is regressed; without epochs it has learned nothing.
    """

    words: str
    critic_first_steps: int
    learning: str
    regression: RegressionSettings = field(default_factory=RegressionSettings)

    @property
    def settings(self) -> str:
        """The learner's settings, as TOML."""
        return f"[learning]\ncritic_first_steps = {self.critic_first_steps}\n{self.learning}"


#: A policy that is close to its goal: the critic, which has to tell small differences, goes first,
#: and the policy follows it in small steps with a steady stddev.
WARM = Beginning(
    words="warm start (missing forces, regressed)",
    critic_first_steps=1500,
    learning="""\
policy_learning_rate = 1e-4
samples = 20
initial_log_alpha_mean = 3.0
limits = { epsilon_mean = 3e-3, epsilon_stddev = 1e-6 }
""",
)
#: One that may be anywhere.
COLD = Beginning(
    words="policy that had learned nothing",
    critic_first_steps=200,
    learning="""\
policy_learning_rate = 3e-4
samples = 20
""",
    regression=RegressionSettings(epochs=0),
)


@dataclass(frozen=True, kw_only=True)
class FitInputs:
    """Files that actors and learner read, too.

    Attributes:
        models: MJCF of the nominal model by kind of command.
        recordings: To be fitted.
        folder: For policies and checkpoints.
        seed: Of everything random.
        actors: Processes.
        control_period_s: Between two decisions about forces. The paper's 50 ms are too long for
            friction that reverses and torque that repeats along the way; commands come every 20 ms.
        horizon: Control periods per episode.
        began: With the regressed policy or, as in the paper, with one that has learned nothing.
    """

    models: Mapping[CommandKind, Path]
    recordings: tuple[Path, ...]
    folder: Path
    seed: int
    actors: int
    control_period_s: float = 0.02
    horizon: int = HORIZON
    began: Beginning = WARM

    @property
    def environment(self) -> EnvironmentSettings:
        """What the environment is told."""
        return EnvironmentSettings(
            models={kind: str(path) for kind, path in self.models.items()},
            recordings=tuple(str(path) for path in self.recordings),
            control_period_s=self.control_period_s,
            horizon=self.horizon,
        )


def environment_flags(settings: EnvironmentSettings) -> tuple[str, ...]:
    """Returns what actors and learner are told of the environment."""
    pairs = [
        ("--env", NAME),
        *(("--model", f"{kind}={path}") for kind, path in settings.models.items()),
        *(("--recording", path) for path in settings.recordings),
        *(("--forced-joint", name) for name in settings.forced_joints),
        *(("--scale", str(x)) for x in settings.scale or ()),
        ("--control-period-s", str(settings.control_period_s)),
        ("--joint-nm", str(settings.joint_nm)),
        ("--object-n", str(settings.object_n)),
        ("--object-nm", str(settings.object_nm)),
        ("--horizon", str(settings.horizon)),
    ]
    return tuple(word for pair in pairs for word in pair)


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """One version of the policy.

    Attributes:
        weights: Its parameters; version 0 is the warm start.
        time_s: Since the fit began.
        error: On the training recordings, in the unit of the fit.
    """

    weights: Weights
    time_s: float
    error: float


@dataclass(frozen=True, kw_only=True)
class FittedForces:
    """What came of the fit.

    Attributes:
        problem: The model, features and recordings that were fitted with.
        about: Where forces act and what they depend on, in words.
        began: What learning began with.
        unit: Of training errors: rad, of the joints' positions in rollouts of whole recordings; or
            m, of an object's place in pushes from rest.
        nominal_error: Training error without any forces.
        lacking: Whether that is more than noise on any joint, or of the object's place.
        foretells: Whether the first policy foretells anything of recordings that it was not
            regressed on.
        snapshots: In order of time; the first is the one that learning began with.
        curves: How the fit went.
    """

    problem: FitProblem
    about: str
    began: Beginning
    unit: str
    nominal_error: float
    lacking: bool
    foretells: bool
    snapshots: tuple[Snapshot, ...]
    curves: tuple[TrainingCurve, ...]

    @property
    def best(self) -> Snapshot:
        """The one with the smallest training error."""
        return min(self.snapshots, key=lambda snapshot: snapshot.error)

    @property
    def helps(self) -> bool:
        """Whether there was something to learn, and the best one is better than no force.

        A first policy that foretells nothing is better by chance.
        """
        known = self.foretells or self.best is not self.snapshots[0]
        return self.lacking and known and self.best.error < self.nominal_error

    @property
    def kept(self) -> Weights:
        """The best policy; where it does not help, with its mean made zero."""
        weights = self.best.weights
        return weights if self.helps else silent(weights)

    @property
    def forces(self) -> ForceModel:
        """What is kept, ready to be rolled out."""
        return force_model(self.problem, self.kept)

    @property
    def detail(self) -> str:
        """What was kept, and what learning added to the first policy, in words."""
        if not self.lacking:
            left = f"{self.nominal_error:.3g} {self.unit} in training recordings"
            return f"no force kept: nothing but noise is left on any joint ({left})"
        first, best = self.snapshots[0], self.best
        waited = self.began.critic_first_steps
        learned = [one for one in self.snapshots if one.weights.version > waited]
        outcome, after = self.began.words, ""
        if not self.helps:
            outcome = "no force kept: none did any good"
        elif learned and best is first:
            outcome = f"{self.began.words} kept: reinforcement learning did not improve it"
            after = f", {min(one.error for one in learned):.3g} at best after learning"
        elif learned:
            outcome = f"{self.began.words} refined by {best.weights.version} learner steps"
            after = f", {best.error:.3g} after learning"
        return (
            f"{outcome}; training error {self.nominal_error:.3g} {self.unit} without forces, "
            f"{first.error:.3g} at first{after}; {self.about}"
        )


def silent(weights: Weights) -> Weights:
    """Returns the policy whose mean is zero everywhere."""
    mean = {name: np.zeros_like(weights.tensors[name]) for name in ("mean.weight", "mean.bias")}
    return replace(weights, tensors={**weights.tensors, **mean})


def force_model(problem: FitProblem, weights: Weights | Mapping[str, Array32]) -> ForceModel:
    """Returns the policy's mean as a generalized force model."""
    policy = GaussianPolicy.from_weights(weights)
    return ForceModel(model=problem.model, features=problem.features, policy=policy.mean_action)


@final
class ForceFit:
    """A fit under way: `start` and `follow`, or nothing of it, then `finish`."""

    def __init__(self, inputs: FitInputs, clock: Clock) -> None:
        """Makes the first policy and writes it for the learner.

        Raises:
            BadInputError: a file cannot be used, or files do not belong together.
        """
        self._inputs, self._clock = inputs, clock
        self._began_ns, self._began_utc_s = clock.now_ns(), clock.utc_ns() * 1e-9
        assets = load_assets(inputs.environment)
        self._trajectories: Sequence[Trajectory] = assets.trajectories
        regression = inputs.began.regression
        self._warm: WarmStart = warm_start(inputs.environment, assets, inputs.seed, regression)
        settings = self._warm.settings
        spec = make_environment(NAME, settings, num_envs=1, seed=0, assets=assets).spec
        weights = Weights(
            version=0,
            created_ns=clock.utc_ns(),
            spec_digest=spec.digest,
            tensors=self._warm.tensors,
        )
        write_weights(inputs.folder / WARM_START, weights)
        errors = self._warm.object_errors
        joints = float(np.sqrt(np.square(self._warm.nominal_errors).mean()))
        self._unit, self._nominal_error = ("m", errors.place_m) if errors else ("rad", joints)
        first_s = self.time_s
        self._snapshots = [Snapshot(weights=weights, time_s=first_s, error=self._error(weights))]

    def start(self, supervisor: Supervisor) -> None:
        """Starts learner and actors in a running system."""
        folder, seed = self._inputs.folder, self._inputs.seed
        environment = environment_flags(self._warm.settings)
        settings = folder / "learner.toml"
        settings.write_text(self._inputs.began.settings, encoding="utf-8")
        learner = (
            *("--config", str(settings)),
            *("--init", str(folder / WARM_START), "--seed", str(seed)),
            *("--checkpoint-dir", str(folder)),
            *environment,
        )
        supervisor.add(
            learner_process(learner),
            *actor_processes(self._inputs.actors, seed, environment),
        )

    @property
    def time_s(self) -> float:
        """Since the fit began."""
        return (self._clock.now_ns() - self._began_ns) * 1e-9

    def follow(
        self, supervisor: Supervisor, seconds: float, say: Callable[[str, float], None]
    ) -> None:
        """Lets the services learn for so long, and measures the policy now and then.

        What dies or hangs meanwhile is started again, the learner at its checkpoint.

        Args:
            supervisor: Of the services.
            seconds: How long.
            say: Told how it goes, in words, and which share of the time has passed.

        Raises:
            GfmError: the last process of a role was given up.
        """
        keeper = Keeper(supervisor, SupervisionConfig(), self._clock)
        end_s, due_s = self.time_s + seconds, self.time_s + SNAPSHOT_S
        # It takes the learner's weights, as actors do and a supervisor may not.
        with supervisor.spec.address.open(Role.ACTOR, name="fit") as transport:
            while self.time_s < end_s:
                keeper.step()
                say(self._wait(), 1.0 - (end_s - self.time_s) / seconds)
                if self.time_s >= due_s:
                    self._look(transport)
                    due_s = self.time_s + SNAPSHOT_S
            self._look(transport)

    def _look(self, transport: Transport) -> None:
        """Measures the policy, where the learner is there to be asked."""
        try:
            self.snapshot(transport)
        except UnreachableError as error:
            _log.warning("the policy was not looked at: %s", error)

    def _wait(self) -> str:
        """Waits a moment; returns how learning goes, in words."""
        self._clock.sleep_until_ns(self._clock.now_ns() + _POLL_NS)
        rows = metric_rows(self._inputs.folder)
        first, last = self._snapshots[0].error, self._snapshots[-1].error
        errors = f"training error {first:.3g} rad at first, {last:.3g} now"
        if not rows:
            return f"waiting for sequences; {errors}"
        newest = rows[-1]
        return f"step {newest['learner_step']:.0f}, reward {newest['reward_mean']:.3f}, {errors}"

    def snapshot(self, transport: Transport) -> Snapshot:
        """Asks the learner for its policy and measures it on the training recordings."""
        answer = ask(
            transport,
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
        """Returns the outcome, and writes the best policy, alone and as a force model."""
        points = [(s.time_s, s.weights.version, s.error) for s in self._snapshots]
        fitted = FittedForces(
            problem=self._warm.problem,
            about=self._warm.about,
            began=self._inputs.began,
            unit=self._unit,
            nominal_error=self._nominal_error,
            lacking=self._warm.lacking,
            foretells=self._warm.foretells,
            snapshots=tuple(self._snapshots),
            curves=(
                *learning_curves(metric_rows(self._inputs.folder), self._began_utc_s),
                *error_curves(points, self._nominal_error, self._unit),
            ),
        )
        write_weights(self._inputs.folder / BEST, fitted.kept)
        problem = fitted.problem
        write_forces(self._inputs.folder / FORCES, problem.model, problem.features, fitted.kept)
        return fitted

    def _error(self, weights: Weights) -> float:
        forces = force_model(self._warm.problem, weights)
        if self._unit == "m":
            pushes = make_pushes(forces.model, self._trajectories)
            return errors_under(forces.policy, forces.features, forces.model, pushes).place_m
        return training_error(forces, self._trajectories)


def training_error(forces: ForceModel, trajectories: Sequence[Trajectory]) -> float:
    """Returns the position RMSE of whole open-loop rollouts, rad."""
    errors = rollout_errors(
        forces.model, trajectories, policy=forces.policy, features=forces.features
    )
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
