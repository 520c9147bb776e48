"""What a policy of a matching task sees: the same from a simulation and from a robot's reports.

Shape letters: N instances, n of them, O observation size, X state size, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array, Array32
from gfm.envs.history import History
from gfm.envs.matching_task import MatchingTask
from gfm.sim.kinematics import wrapped, yaw_of
from gfm.sim.sawyer import READY

#: States in the observation, the current one among them (the paper).
STATES = 10

# What numbers are divided by on their way into the observation: m, rad, speed limits. What the
# reward is about is made larger than one, the many steps of the history smaller: a policy finds out
# first what moves its inputs most.
_PLACE_M, _JOINT_RAD, _SPEED_LIMITS = 0.1, 0.5, 3.0
_GOAL_M, _STEP = 0.04, 0.5


@dataclass(frozen=True, kw_only=True)
class Scene:
    """Where tool and object are.

    Attributes:
        tip: Of the tool, base frame, m, shape (N, 3).
        position: Of the object, base frame, m, shape (N, 3).
        axes: Of the object, as `body_axes` gives them, shape (N, 6).
    """

    tip: Array
    position: Array
    axes: Array


@final
class MatchingView:
    """The newest states of N instances, and what a policy sees of them.

    The observation is the state now and the nine before (joint positions and velocities, tool tip,
    object position and axes) and where the goal is, seen from the basket and from the object, and
    where the object and the place to push it from are, seen from the tool. All but the goal follows
    from the measurements; it is there because a policy of two layers would have to learn kinematics
    and geometry first.

    Args:
        task: Which.
        velocity_limit: What an action of 1 commands, rad/s, shape (J,).
        num_envs: N.
    """

    def __init__(self, task: MatchingTask, velocity_limit: Array, num_envs: int) -> None:
        self._task, self._velocity_limit = task, velocity_limit
        self._history = History(num_envs, STATES, 2 * len(READY) + 12)

    def begin(self, ids: NDArray[np.intp], joints: Array, speeds: Array, scene: Scene) -> None:
        """Lets the instances `ids`, shape (n,), have rested where all N are; as `see` otherwise."""
        self._history.fill(ids, self._state(joints, speeds, scene)[ids])

    def see(self, joints: Array, speeds: Array, scene: Scene) -> None:
        """Takes in where all are now: rad and rad/s, shape (N, J) each."""
        self._history.push(self._state(joints, speeds, scene))

    def observation(self, scene: Scene, goal: Array) -> Array32:
        """Returns what a policy sees, shape (N, O), for goals of shape (N, 3)."""
        parts = (self._history.observed(_STEP), self._goal_features(scene, goal))
        return np.concatenate(parts, axis=1, dtype=np.float32)

    def _state(self, joints: Array, speeds: Array, scene: Scene) -> Array:
        """Returns scaled states, shape (N, X)."""
        centre = self._task.rest_position
        parts = (
            (joints - READY) / _JOINT_RAD,
            speeds / (_SPEED_LIMITS * self._velocity_limit),
            (scene.tip - centre) / _PLACE_M,
            (scene.position - centre) / _PLACE_M,
            scene.axes,
        )
        return np.concatenate(parts, axis=1)

    def _goal_features(self, scene: Scene, goal: Array) -> Array:
        """Returns scaled differences between goal, basket, object and tool, angles, (N, G)."""
        task, centre = self._task, self._task.rest_position
        push_from = task.tool_place(scene.tip, scene.position, scene.axes, goal)
        parts = [
            (goal[:, :2] - centre[:2]) / _PLACE_M,
            (goal[:, :2] - scene.position[:, :2]) / _GOAL_M,
            (scene.position - scene.tip) / _GOAL_M,
            (push_from - scene.tip) / _GOAL_M,
        ]
        if task.tolerance_rad is not None:
            left = wrapped(goal[:, 2] - yaw_of(scene.axes))
            angles = (np.cos(goal[:, 2]), np.sin(goal[:, 2]), np.cos(left), np.sin(left))
            parts.append(np.stack(angles, axis=1))
        return np.concatenate(parts, axis=1)
