"""What a generalized force model should do where the recordings are, for regression.

Shape letters: M examples, O observation size, A generalized forces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array32
from gfm.envs.fit_problem import FitProblem
from gfm.sim.drive import drive_torque
from gfm.sim.residual import residual_forces


def warm_start_examples(
    problem: FitProblem, trajectories: Sequence[Trajectory]
) -> tuple[Array32, Array32]:
    """Returns observations (M, O) along the recordings and the actions (M, A) that fit there.

    Actions are the forces of `gfm.sim.residual`, clipped to their limits and in units of them.

    Args:
        problem: Made from the same recordings.
        trajectories: The recordings, in the problem's order.
    """
    windows, features, layout = problem.windows, problem.features, problem.model.layout
    index = np.concatenate(
        [
            np.flatnonzero(windows.recording == i)[features.history : -1]
            for i in range(len(trajectories))
        ]
    )
    force = np.concatenate(
        [residual_forces(problem.model, t)[features.history :] for t in trajectories]
    )
    observation = np.zeros((len(index), features.size), np.float32)
    features.fill(observation, windows.state[index[:, None] + np.arange(-features.history, 1)])
    torque = drive_torque(
        windows.law[windows.recording[index]],
        windows.command[index, 0],
        windows.qpos[index][:, layout.qpos],
        windows.qvel[index][:, layout.dof],
    )
    features.put_torque(observation, torque)
    action = np.clip(force / problem.model.force_limit, -1.0, 1.0)
    return observation, action.astype(np.float32)
