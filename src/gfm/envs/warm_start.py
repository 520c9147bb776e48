"""What a generalized force model should do where the recordings are, for regression.

Shape letters: M examples, O observation size, A generalized forces.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array, Array32
from gfm.envs.fit_problem import FitProblem
from gfm.sim.drive import drive_torque


def warm_start_examples(problem: FitProblem, forces: Sequence[Array]) -> tuple[Array32, Array32]:
    """Returns observations (M, O) along the recordings and the actions (M, A) that fit there.

    Actions are the forces, clipped to their limits and in units of them.

    Args:
        problem: Made from the same recordings.
        forces: What `gfm.sim.residual` says of each recording, in the problem's order, shape (K, A)
            each.
    """
    windows, features, layout = problem.windows, problem.features, problem.model.layout
    index = example_states(problem)
    force = np.concatenate([one[features.history :] for one in forces])
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


def example_states(problem: FitProblem) -> NDArray[np.intp]:
    """Returns which of the recorded states the examples are, shape (M,)."""
    windows, history = problem.windows, problem.features.history
    states = [np.flatnonzero(windows.recording == i) for i in range(len(windows.models))]
    return np.concatenate([one[history:-1] for one in states])
