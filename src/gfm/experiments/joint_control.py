"""The joint-control comparison: what each model predicts for held-out recordings, in open loop.

One measure for all models. A rollout begins at the smoothed measured state and from there on reads
only commands, integrated to fourth order (a hybrid one begins with the next command, at most one
control period later). What a slightly wrong initial state could explain of its error (to first
order, under the nominal model: two numbers per joint and recording) is taken out of it, with the
same basis for every model. Only positions count: a hybrid model does not predict efforts.

Shape letters: T measurements of a recording, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.rollouts import Noise
from gfm.effects import EffectInstance
from gfm.report import Comparison, HeldOutRollout, ModelError, ModelKind
from gfm.sim.features import Features
from gfm.sim.hybrid import HybridModel
from gfm.sim.rollout import ForcePolicy, rollouts


@dataclass(frozen=True, kw_only=True)
class ForceModel:
    """A generalized force model, ready to be rolled out.

    Attributes:
        model: The nominal model and the limits of the forces.
        features: What the policy observes.
        policy: From observations to forces in units of their limits.
    """

    model: HybridModel
    features: Features
    policy: ForcePolicy


@dataclass(frozen=True, kw_only=True)
class ModelErrors:
    """One model on all recordings.

    Attributes:
        model: Which.
        detail: What it is, in words with figures.
        errors: Measured minus predicted position per recording, rad, shape (T, J) each.
    """

    model: ModelKind
    detail: str
    errors: tuple[Array, ...]

    @property
    def overall(self) -> float:
        """Root mean square over joints and recordings, rad."""
        return float(np.sqrt(np.mean(np.concatenate(self.errors) ** 2)))

    @property
    def joints(self) -> tuple[float, ...]:
        """Root mean square of each joint, rad."""
        squares = np.concatenate(self.errors) ** 2
        return tuple(float(value) for value in np.sqrt(squares.mean(axis=0)))


@dataclass(frozen=True, kw_only=True)
class JointControlTest:
    """Recordings that models are compared on; make it with `make_test`.

    Attributes:
        recordings: From their first command on.
        problem: What is predicted of them: one segment per recording.
    """

    recordings: tuple[Trajectory, ...]
    problem: Problem

    def model_errors(
        self, model: ModelKind, effects: Sequence[EffectInstance], detail: str
    ) -> ModelErrors:
        """Returns the errors of the nominal model with `effects` in it."""
        errors = self.problem.position_errors(effects)
        return ModelErrors(model=model, detail=detail, errors=tuple(errors))

    def hybrid_errors(
        self, kind: ModelKind, forces: ForceModel | None, model: HybridModel, detail: str
    ) -> ModelErrors:
        """Returns the errors of a hybrid model; of its nominal part alone without `forces`."""
        predictions = rollouts(
            model,
            self.recordings,
            policy=None if forces is None else forces.policy,
            features=None if forces is None else forces.features,
            nthread=2,
        )
        errors = []
        for i, (recording, prediction) in enumerate(zip(self.recordings, predictions, strict=True)):
            error = np.zeros_like(recording.position)
            error[prediction.first :] = recording.position[prediction.first :] - prediction.position
            errors.append(self._without_initial_state(i, error))
        return ModelErrors(model=kind, detail=detail, errors=tuple(errors))

    def _without_initial_state(self, index: int, error: Array) -> Array:
        """Takes out of (T, J) what the initial state could explain, as the problem does."""
        noise, basis = self.problem.noise.position, self.problem.state_basis[index]
        flat = (error / noise).ravel()
        return np.asarray((flat - basis @ (basis.T @ flat)).reshape(error.shape) * noise)

    def comparison(self, models: Sequence[ModelErrors]) -> Comparison:
        """Returns the table of all models."""
        noise = self.problem.noise.position
        return Comparison(
            joints=self.problem.joints,
            noise_floor=float(np.sqrt(np.mean(noise**2))),
            joint_noise_floors=tuple(float(value) for value in noise),
            models=tuple(
                ModelError(
                    model=one.model, detail=one.detail, overall=one.overall, joints=one.joints
                )
                for one in models
            ),
        )

    def held_out_rollouts(self, models: Sequence[ModelErrors]) -> tuple[HeldOutRollout, ...]:
        """Returns what each model predicted, recordings of position commands first."""
        order = sorted(
            range(len(self.recordings)),
            key=lambda i: self.recordings[i].command_kind is not CommandKind.POSITION,
        )
        return tuple(self._rollout(i, models) for i in order)

    def _rollout(self, index: int, models: Sequence[ModelErrors]) -> HeldOutRollout:
        recording = self.recordings[index]
        return HeldOutRollout(
            recording=recording.name,
            joints=recording.joint_names,
            time_s=recording.time_s,
            setpoint=setpoints(recording),
            measured=recording.position,
            predicted={one.model: recording.position - one.errors[index] for one in models},
        )


def make_test(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    noise: Noise,
    given: Sequence[EffectInstance] = (),
) -> JointControlTest:
    """Returns the comparison on `recordings`.

    Args:
        specs: The nominal model by kind of command.
        recordings: Of servos, which keep a whole recording on track.
        noise: Of the sensors: the floor.
        given: Effects of the nominal model that `specs` cannot say.

    Raises:
        BadInputError: models and recordings do not belong together.
    """
    started = tuple(from_first_command(replace(r, effort=None)) for r in recordings)
    problem = prepared(all_segments(specs, started, noise, given=given, windows_s=WHOLE))
    if len(problem.segments) != len(started):
        kinds = ", ".join(sorted({r.command_kind for r in recordings}))
        raise ConfigError(f"{kinds} commands: expected position or velocity commands of servos")
    return JointControlTest(recordings=started, problem=problem)


def from_first_command(recording: Trajectory) -> Trajectory:
    """Returns the recording without what was measured before its first command."""
    return recording.measured_at(recording.stamp_ns >= recording.command_stamp_ns[0])


def setpoints(recording: Trajectory) -> Array | None:
    """Returns the commanded position at every measurement, rad, shape (T, J); None for others."""
    if recording.command_kind is not CommandKind.POSITION:
        return None
    return recording.held_command
