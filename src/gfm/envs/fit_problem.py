"""What there is to fit: recordings at control periods, what a force model sees, what counts.

Shape letters: R recordings, M recorded states of all of them, S integration steps per control
period, J joints, C channels of the difference, A generalized forces, W windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import ConfigError, RecordingError, Trajectory
from gfm.core.checks import Array, Array32
from gfm.envs.difference import state_difference
from gfm.sim.batch import HybridBatch
from gfm.sim.drive import drive_law
from gfm.sim.features import Features, make_features
from gfm.sim.hybrid import HybridModel
from gfm.sim.replay import make_replay

#: Windows of the recordings that the scale of the difference is measured on.
_MOST_WINDOWS = 64


@dataclass(frozen=True, kw_only=True)
class Windows:
    """All recordings, one after the other, and where episodes may start.

    Attributes:
        models: Of each recording, R of them.
        law: Drive laws of each recording, shape (R, J, 7).
        recording: Which recording each state is of, shape (M,).
        qpos: Recorded states at the control periods, shape (M, nq).
        qvel: shape (M, nv).
        command: In force from each state on, shape (M, S, J).
        state: Scaled for the observation, shape (M, X).
        start: Indices of states that have a whole history before and a horizon behind them.
    """

    models: tuple[mujoco.MjModel, ...]
    law: Array
    recording: NDArray[np.intp]
    qpos: Array
    qvel: Array
    command: Array
    state: Array32
    start: NDArray[np.intp]

    def command_before(self, index: NDArray[np.intp]) -> Array:
        """Returns the commands in force until the states `index`, shape (n, J)."""
        before = np.maximum(index - 1, 0)
        same = self.recording[before] == self.recording[index]
        return np.asarray(self.command[np.where(same, before, index), -1])

    def following(self, index: NDArray[np.intp]) -> NDArray[np.intp]:
        """Returns the states one period after `index`; a recording's last follows itself, (n,)."""
        after = np.minimum(index + 1, len(self.recording) - 1)
        same = self.recording[after] == self.recording[index]
        return np.where(same, after, index)


@dataclass(frozen=True, kw_only=True)
class FitProblem:
    """Everything that instances of `gfm_fit` share, and that a fitted force model is kept with.

    Attributes:
        model: The nominal model and the force limits.
        windows: The recordings.
        features: What is observed.
        scale: By which each channel of the difference is divided, shape (C,).
        horizon: Control periods per episode.
    """

    model: HybridModel
    windows: Windows
    features: Features
    scale: Array
    horizon: int

    @cached_property
    def action_size(self) -> int:
        """A."""
        return len(self.model.force_limit)


def make_fit_problem(
    model: HybridModel,
    trajectories: Sequence[Trajectory],
    *,
    horizon: int = 20,
    history: int = 5,
    scale: Sequence[float] | None = None,
    exploration: float = 0.3,
) -> FitProblem:
    """Returns the problem of fitting generalized forces to recordings.

    Args:
        model: The nominal model and the force limits.
        trajectories: The recordings.
        horizon: Control periods per episode.
        history: Earlier states in the observation (the paper: 5).
        scale: rad, rad/s, m, rad per channel; by default as `difference_scale` says.
        exploration: For the default scale: standard deviation of random forces whose effect counts
            as much as the nominal model's own error, in units of the limits.

    Raises:
        RecordingError: a recording does not fit the model or is too short.
        ConfigError: no recordings, or a scale of the wrong length.
    """
    if not trajectories:
        raise ConfigError("gfm_fit needs at least one recording")
    windows, features = _make_windows(model, trajectories, horizon, history)
    if scale is None:
        chosen = difference_scale(model, windows, horizon, exploration)
    else:
        chosen = np.asarray(scale, np.float64)
    channels = 2 * len(model.layout.joint_names) + (6 if model.layout.has_object else 0)
    if chosen.shape != (channels,) or not (chosen > 0.0).all():
        raise ConfigError(f"scale is {chosen.tolist()}, expected {channels} positive numbers")
    return FitProblem(
        model=model, windows=windows, features=features, scale=chosen, horizon=horizon
    )


def _make_windows(
    model: HybridModel, trajectories: Sequence[Trajectory], horizon: int, history: int
) -> tuple[Windows, Features]:
    replays = [make_replay(model, trajectory) for trajectory in trajectories]
    starts, first = [], 0
    for replay in replays:
        if replay.periods < history + horizon:
            raise RecordingError(
                replay.name,
                f"{replay.periods} control periods of {model.control_period_s} s",
                f"at least {history + horizon}: {history} of history and a horizon of {horizon}",
            )
        starts.append(first + np.arange(history, replay.periods - horizon + 1))
        first += replay.periods + 1
    features = make_features(model.layout, replays, history)
    qpos = np.concatenate([replay.qpos for replay in replays])
    qvel = np.concatenate([replay.qvel for replay in replays])
    command = [_padded(replay.command, replay.periods + 1) for replay in replays]
    windows = Windows(
        models=tuple(replay.model for replay in replays),
        law=np.stack([drive_law(replay.model, model.layout) for replay in replays]),
        recording=np.repeat(np.arange(len(replays)), [r.periods + 1 for r in replays]),
        qpos=qpos,
        qvel=qvel,
        command=np.concatenate(command),
        state=features.state(model.layout, qpos, qvel),
        start=np.concatenate(starts),
    )
    return windows, features


def _padded(command: Array, rows: int) -> Array:
    """Returns `rows` periods of commands: the last one holds after the recording's end."""
    padded = command[np.minimum(np.arange(rows), len(command) - 1)]
    padded[len(command) :] = command[-1, -1]
    return padded


def difference_scale(
    model: HybridModel, windows: Windows, horizon: int, exploration: float
) -> Array:
    """Returns a scale with which the nominal model's reward is about exp(-1), shape (C,).

    Per channel the larger of two root mean squares over windows of the recordings, times the square
    root of the number of channels that count: the nominal model's error, and what random forces
    (independent in every control period, `exploration` times their limits) change. Without the
    second, a joint that the model predicts well would drown all others as soon as a policy
    explores. Joints that no force acts on do not count: their scale is infinite.
    """
    start = _some_windows(windows)
    nominal = _differences(model, windows, start, np.zeros((horizon, len(start), _forces(model))))
    error = np.sqrt((nominal**2).mean(axis=(0, 1)))
    explored = explored_difference(model, windows, horizon, exploration)
    return counted_scale(model, np.maximum(error, explored))


def explored_difference(
    model: HybridModel, windows: Windows, horizon: int, exploration: float
) -> Array:
    """Returns the root mean square of what random forces change of each channel, shape (C,).

    Forces are independent in every control period, with a standard deviation of `exploration` times
    their limits.
    """
    start = _some_windows(windows)
    random = np.random.default_rng(0).normal(size=(horizon, len(start), _forces(model)))
    force = random * model.force_limit * exploration
    change = _differences(model, windows, start, force) - _differences(
        model, windows, start, np.zeros_like(force)
    )
    return np.asarray(np.sqrt((change**2).mean(axis=(0, 1))))


def counted_scale(model: HybridModel, size: Array) -> Array:
    """Returns differences of typical `size`, (C,), as a scale: infinite where no force acts."""
    joints = len(model.layout.joint_names)
    free = np.setdiff1d(np.arange(joints), model.forced)
    scale = np.asarray(size, np.float64).copy()
    scale[np.concatenate([free, joints + free])] = np.inf
    return np.asarray(scale * np.sqrt(np.isfinite(scale).sum()))


def _forces(model: HybridModel) -> int:
    return len(model.force_limit)


def _some_windows(windows: Windows) -> NDArray[np.intp]:
    count = min(_MOST_WINDOWS, len(windows.start))
    return np.asarray(windows.start[np.linspace(0, len(windows.start) - 1, count).astype(int)])


def _differences(
    model: HybridModel, windows: Windows, start: NDArray[np.intp], force: Array
) -> Array:
    """Returns the difference after each control period of each window, (horizon, W, C)."""
    batch = HybridBatch(model, len(start))
    models = [windows.models[i] for i in windows.recording[start]]
    batch.reset(
        np.arange(len(start)),
        models,
        windows.qpos[start],
        windows.qvel[start],
        windows.command_before(start),
    )
    differences = []
    for period, period_force in enumerate(force):
        batch.step(windows.command[start + period], period_force)
        after = start + period + 1
        differences.append(
            state_difference(
                model.layout, batch.qpos, batch.qvel, windows.qpos[after], windows.qvel[after]
            )
        )
    return np.array(differences)
