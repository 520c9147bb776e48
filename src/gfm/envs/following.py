"""How far an object is from where it was recorded, under a force model, window by window.

Contacts are chaotic over long times: a rollout of a whole recording says more of the first touch
than of the forces. So windows begin where the recording is, and last as long as an episode.

Shape letters: W windows, H control periods of each, O observation size, A generalized forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array, Array32
from gfm.envs.difference import state_difference
from gfm.envs.fit_problem import FitProblem, make_fit_problem
from gfm.sim.batch import HybridBatch
from gfm.sim.drive import drive_torque
from gfm.sim.rollout import ForcePolicy

#: From one window to the next, s, and how far the object moves in one that counts, m.
_EVERY_S, MOVES_M = 0.2, 0.005


@dataclass(frozen=True, kw_only=True)
class ObjectErrors:
    """Where the object is in windows in which it moves.

    Attributes:
        windows: Their number.
        place_m: Root mean square distance in the plane, m.
        yaw_rad: Root mean square of the yaw, rad.
        joints_rad: Root mean square of each joint's position, rad, J of them.
    """

    windows: int
    place_m: float
    yaw_rad: float
    joints_rad: tuple[float, ...]


def with_recordings(problem: FitProblem, recordings: Sequence[Trajectory]) -> FitProblem:
    """Returns the problem with other recordings: what a policy sees is scaled as before.

    Raises:
        RecordingError: a recording is shorter than a window, or has no object.
    """
    history, scale = problem.features.history, [1.0] * len(problem.scale)
    other = make_fit_problem(
        problem.model, recordings, horizon=problem.horizon, history=history, scale=scale
    )
    windows, features = other.windows, problem.features
    state = features.state(problem.model.layout, windows.qpos, windows.qvel)
    return replace(problem, windows=replace(windows, state=state))


def object_errors(problem: FitProblem, policy: ForcePolicy | None) -> ObjectErrors:
    """Returns how far arm and object are from the recordings in windows in which it moves.

    Args:
        problem: With the recordings; in some window the object moves.
        policy: The generalized forces, in units of their limits; None for none.
    """
    start, joints = moving_windows(problem), len(problem.model.layout.joint_names)
    difference = window_differences(problem, start, policy)
    arm, pushed = difference[..., :joints], difference[..., -6:]
    square_m = np.square(pushed[..., :2]).sum(axis=-1)
    return ObjectErrors(
        windows=len(start),
        place_m=float(np.sqrt(square_m.mean())),
        yaw_rad=float(np.sqrt(np.square(pushed[..., 5]).mean())),
        joints_rad=tuple(np.sqrt(np.square(arm).mean(axis=(0, 1))).tolist()),
    )


def moving_windows(problem: FitProblem) -> NDArray[np.intp]:
    """Returns where windows begin in which the object moves, shape (W,); none where it rests."""
    windows, layout = problem.windows, problem.model.layout
    every = max(1, round(_EVERY_S / problem.model.control_period_s))
    place = windows.qpos[:, layout.object_qpos][:, :2]
    start = windows.start[::every]
    way = place[start[:, None] + np.arange(problem.horizon + 1)] - place[start][:, None]
    return np.asarray(start[np.linalg.norm(way, axis=2).max(axis=1) > MOVES_M])


def window_differences(
    problem: FitProblem, start: NDArray[np.intp], policy: ForcePolicy | None
) -> Array:
    """Returns the difference from the recording after every control period, shape (H, W, C).

    Args:
        problem: With the recordings.
        start: Of the windows, shape (W,): states with a history before and a horizon behind them.
        policy: See `object_errors`.
    """
    model, windows, features = problem.model, problem.windows, problem.features
    batch = HybridBatch(model, len(start))
    models = [windows.models[i] for i in windows.recording[start]]
    before = windows.command_before(start)
    batch.reset(np.arange(len(start)), models, windows.qpos[start], windows.qvel[start], before)
    seen: Array32 = np.zeros((len(start), features.size), np.float32)
    features.fill(seen, windows.state[start[:, None] + np.arange(-features.history, 1)])
    found = []
    for period in range(problem.horizon):
        at = start + period
        batch.step(windows.command[at], _forces(problem, batch, at, seen, policy))
        features.push(seen, features.state(model.layout, batch.qpos, batch.qvel))
        then = windows.qpos[at + 1], windows.qvel[at + 1]
        found.append(state_difference(model.layout, batch.qpos, batch.qvel, *then))
    return np.array(found)


def _forces(
    problem: FitProblem,
    batch: HybridBatch,
    at: NDArray[np.intp],
    seen: Array32,
    policy: ForcePolicy | None,
) -> Array:
    """Returns the forces of a period, N m and N, shape (W, A)."""
    model, windows = problem.model, problem.windows
    if policy is None:
        return np.zeros((len(at), problem.action_size))
    q, v = batch.qpos[:, model.layout.qpos], batch.qvel[:, model.layout.dof]
    law = windows.law[windows.recording[at]]
    problem.features.put_torque(seen, drive_torque(law, windows.command[at, 0], q, v))
    return np.asarray(np.clip(policy(seen.copy()), -1.0, 1.0) * model.force_limit)
