"""Whole-run open-loop rollouts of recordings under a hybrid model: the held-out test.

Shape letters: N recordings, T measurements, J joints, K control periods, S integration steps in
each, A generalized forces, O observation size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array, Array32
from gfm.sim.batch import HybridBatch
from gfm.sim.drive import drive_law, drive_torque
from gfm.sim.features import Features
from gfm.sim.hybrid import HybridModel
from gfm.sim.replay import Replay, make_replay

#: From observations (N, O) to forces in units of their limits, (N, A).
ForcePolicy = Callable[[Array32], Array32]


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What a model says that a recording should have looked like, from its first command on.

    Attributes:
        name: Of the recording.
        first: Index of the first predicted measurement.
        position: rad, at the measurements from `first` on, shape (T - first, J).
        velocity: rad/s, the same.
        object_pose: Position m and quaternion w x y z at the same times, shape (T - first, 7), or
            None.
        force: Generalized forces, N m and N, shape (K, A).
        diverged: Whether the simulation became unstable; what follows is then frozen.
    """

    name: str
    first: int
    position: Array
    velocity: Array
    object_pose: Array | None
    force: Array
    diverged: bool


def rollouts(
    model: HybridModel,
    trajectories: Sequence[Trajectory],
    *,
    policy: ForcePolicy | None = None,
    features: Features | None = None,
    nthread: int = 1,
) -> list[Prediction]:
    """Returns the prediction for every recording, all of them simulated together.

    Each starts at the state measured (smoothed) when the first command of the recording was
    issued; from there on only commands are read. Commands hold from their own stamps; predictions
    are interpolated between integration steps to the measurements' stamps.

    Args:
        model: Nominal, corrected or hybrid.
        trajectories: The recordings, N of them.
        policy: The generalized forces, decided once per control period; None for none.
        features: What `policy` observes.
        nthread: Threads of the simulation.
    """
    replays = [make_replay(model, trajectory) for trajectory in trajectories]
    run = _Run(model, replays, nthread)
    decide = _Decider(model, replays, policy, features) if policy and features else None
    for period in range(run.periods):
        run.advance(period, None if decide is None else decide(run.batch, run.command(period)))
    return [run.prediction(i, trajectory) for i, trajectory in enumerate(trajectories)]


def rollout_errors(
    model: HybridModel,
    trajectories: Sequence[Trajectory],
    *,
    policy: ForcePolicy | None = None,
    features: Features | None = None,
) -> list[Array]:
    """Returns measured minus predicted position of every recording, rad, shape (T - first, J) each.

    Args: as `rollouts` takes them.
    """
    predictions = rollouts(model, trajectories, policy=policy, features=features)
    return [
        trajectory.position[prediction.first :] - prediction.position
        for trajectory, prediction in zip(trajectories, predictions, strict=True)
    ]


class _Decider:
    """Keeps the observations and asks the policy."""

    def __init__(
        self,
        model: HybridModel,
        replays: Sequence[Replay],
        policy: ForcePolicy,
        features: Features,
    ) -> None:
        self._model, self._policy, self._features = model, policy, features
        self._law = np.stack([drive_law(replay.model, model.layout) for replay in replays])
        self._observation: Array32 = np.zeros((len(replays), features.size), np.float32)
        self._started = False

    def __call__(self, batch: HybridBatch, command: Array) -> Array:
        layout, features = self._model.layout, self._features
        state = features.state(layout, batch.qpos, batch.qvel)
        if self._started:
            features.push(self._observation, state)
        else:  # nothing is known of what was before: the robot is taken to have stood there
            features.fill(self._observation, np.repeat(state[:, None], features.history + 1, 1))
            self._started = True
        q, v = batch.qpos[:, layout.qpos], batch.qvel[:, layout.dof]
        features.put_torque(self._observation, drive_torque(self._law, command[:, 0], q, v))
        action = np.clip(self._policy(self._observation.copy()), -1.0, 1.0)
        return np.asarray(action * self._model.force_limit)


class _Run:
    """The simulations and everything recorded of them."""

    def __init__(self, model: HybridModel, replays: Sequence[Replay], nthread: int) -> None:
        self.batch = HybridBatch(model, len(replays), nthread=nthread)
        self.periods = max(len(replay.command) for replay in replays)
        self._model, self._replays = model, replays
        steps = self.periods * model.substeps + 1
        self._qpos = np.zeros((len(replays), steps, model.any_model.nq))
        self._qvel = np.zeros((len(replays), steps, model.any_model.nv))
        self._force = np.zeros((len(replays), self.periods, len(model.force_limit)))
        self._diverged = np.zeros(len(replays), bool)
        self.batch.reset(
            np.arange(len(replays)),
            [replay.model for replay in replays],
            np.stack([replay.qpos[0] for replay in replays]),
            np.stack([replay.qvel[0] for replay in replays]),
            np.stack([replay.command[0, 0] for replay in replays]),
        )
        self._qpos[:, 0], self._qvel[:, 0] = self.batch.qpos, self.batch.qvel

    def command(self, period: int) -> Array:
        """Returns the commands of a period, shape (N, S, J); the last one holds after the end."""
        return np.stack([r.command[min(period, len(r.command) - 1)] for r in self._replays])

    def advance(self, period: int, force: Array | None) -> None:
        """Simulates one control period."""
        if force is not None:
            self._force[:, period] = force
        start = period * self._model.substeps + 1
        rows = slice(start, start + self._model.substeps)
        diverged, qpos, qvel = self.batch.step_recorded(
            self.command(period), self._force[:, period]
        )
        running = np.array([period < len(replay.command) for replay in self._replays])
        self._diverged |= diverged & running
        self._qpos[:, rows], self._qvel[:, rows] = qpos, qvel

    def prediction(self, index: int, trajectory: Trajectory) -> Prediction:
        """Returns what was simulated of one recording, at its measurements' stamps."""
        replay, layout = self._replays[index], self._model.layout
        first = int(np.searchsorted(trajectory.time_s, replay.start_s - 1e-9))
        elapsed = (trajectory.time_s[first:] - replay.start_s) / self._model.timestep_s
        qpos, qvel = _at(elapsed, self._qpos[index]), _at(elapsed, self._qvel[index])
        return Prediction(
            name=trajectory.name,
            first=first,
            position=qpos[:, layout.qpos],
            velocity=qvel[:, layout.dof],
            object_pose=_unit(qpos[:, layout.object_qpos]) if layout.has_object else None,
            force=self._force[index, : len(replay.command)],
            diverged=bool(self._diverged[index]),
        )


def _at(elapsed: Array, samples: Array) -> Array:
    """Returns rows of `samples` interpolated at `elapsed` integration steps."""
    before = np.clip(elapsed.astype(int), 0, len(samples) - 2)
    share = (elapsed - before)[:, None]
    return np.asarray((1.0 - share) * samples[before] + share * samples[before + 1])


def _unit(pose: Array) -> Array:
    """Returns the poses with quaternions of unit length again."""
    length = np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    return np.hstack([pose[:, :3], pose[:, 3:] / length])
