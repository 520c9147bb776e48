"""Pushing an object to a place, or to a place and a yaw, in the basket.

Shape letters: N instances, n of them, O observation size, X state size, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import ConfigError, EnvironmentSpec
from gfm.core.checks import Array, Array32
from gfm.envs.arm import CONTROL_PERIOD_S, Arm, ArmProblem
from gfm.envs.batched import BatchedEnvironment, Transition
from gfm.envs.episodes import Episodes
from gfm.envs.matching_task import (
    REWARD_LIMIT,
    MatchingTask,
    check_goals,
    object_outside,
    reward,
    tip_outside,
)
from gfm.envs.matching_view import MatchingView, Scene
from gfm.envs.outcomes import Outcome, Outcomes
from gfm.envs.sensing import Sensors
from gfm.sim.cell import END_EFFECTOR_SITE
from gfm.sim.kinematics import SiteKinematics, body_axes
from gfm.sim.sawyer import READY

_START_RAD, _START_M, _START_YAW_RAD = 0.02, 0.005, 0.1


@final
class Matching(BatchedEnvironment):
    """N instances of a matching task.

    `MatchingView` says what is observed. Actions are joint velocities in units of 5 % of what is
    allowed, times the curriculum's gain.

    An episode begins with the object at the basket's centre, within millimetres, and the arm above
    it. It terminates when the tool leaves its workspace or the object the basket.
    Success (the goal held for 0.5 s) does not end it: there is nothing better than to stay.
    """

    def __init__(
        self,
        task: MatchingTask,
        arm: ArmProblem,
        num_envs: int,
        *,
        seed: int = 0,
        nthread: int = 1,
        horizon: int | None = None,
        goals: Array | None = None,
    ) -> None:
        """Makes instances.

        Args:
            task: Which.
            arm: The cell, furnished for the task.
            num_envs: N.
            seed: Of goals and starts.
            nthread: Threads of the physics.
            horizon: Steps of an episode; the task's by default.
            goals: One for each instance, always the same, shape (N, 3); random ones by default.

        Raises:
            ConfigError: the cell lacks what the task needs, or a goal is outside the basket.
        """
        _check_cell(arm, task)
        if goals is not None:
            check_goals(goals, num_envs)
        self.num_envs = num_envs
        self._task, self._problem = task, arm
        self._rng = np.random.default_rng(seed)
        self._arm = Arm(arm, num_envs, self._rng, nthread)
        self._tip = SiteKinematics(arm.nominal, END_EFFECTOR_SITE)
        sensing = arm.settings.sensing
        self._sensors = (
            None if sensing is None else Sensors(sensing, num_envs, CONTROL_PERIOD_S, self._rng)
        )
        self._view = MatchingView(task, arm.velocity_limit, num_envs)
        self._episodes = Episodes(num_envs, horizon or task.steps)
        self._outcomes = Outcomes(num_envs)
        self._fixed_goals = goals
        self._goal: Array = np.zeros((num_envs, 3))
        self._potential: Array = np.zeros(num_envs)
        self.spec = EnvironmentSpec(
            name=task.name,
            observation_size=self._view.observation(self.scene(), self._goal).shape[1],
            action_size=len(READY),
            reward_limit=REWARD_LIMIT,
        )

    @property
    def goal(self) -> Array:
        """Of the current episodes: x, y, yaw, shape (N, 3)."""
        return self._goal.copy()

    @property
    def outcome(self) -> NDArray[np.int64]:
        """How the current episodes stand, members of `Outcome`, shape (N,)."""
        return self._outcomes.now.copy()

    @property
    def qpos(self) -> Array:
        """All positions, shape (N, nq)."""
        return self._arm.qpos.copy()

    @property
    def qvel(self) -> Array:
        """All velocities, shape (N, nv)."""
        return self._arm.qvel.copy()

    def scene(self) -> Scene:
        """Returns where tool and object are now."""
        return self._scene(self._arm.placed, self._object_pose())

    def _scene(self, qpos: Array, pose: Array) -> Scene:
        """Returns where the tool is at positions (N, nq), and objects in poses of shape (N, 7)."""
        return Scene(
            tip=self._tip.positions(qpos),
            position=pose[:, :3].copy(),
            axes=body_axes(pose[:, 3:]),
        )

    @override
    def set_progress(self, learner_steps: int) -> None:
        self._arm.set_progress(learner_steps)

    @override
    def gauges(self) -> Mapping[str, float]:
        return {**self._arm.gauges(), **self._outcomes.gauges()}

    @override
    def reset(self, ids: NDArray[np.intp] | None = None) -> Array32:
        chosen = self._episodes.start(ids)
        joints, pose = random_starts(self._task, len(chosen), self._rng)
        layout, zero = self._problem.model.layout, self._problem.zero
        self._arm.reset(chosen, layout.as_qpos(joints + zero, pose))
        self._goal[chosen] = self._next_goals(chosen)
        self._outcomes.start(chosen)
        if self._sensors is not None:
            self._sensors.begin(chosen, self._object_pose())
        scene = self.scene()
        seen = self._seen(scene)
        self._view.begin(chosen, *self._joints(), seen)
        self._potential[chosen] = self._potentials(scene)[chosen]
        return self._view.observation(seen, self._goal)

    @override
    def step(self, action: Array32) -> Transition:
        diverged = self._arm.step(self._episodes.checked(action, self.spec.action_size))
        scene, task, goal = self.scene(), self._task, self._goal
        if self._sensors is not None:
            self._sensors.see(self._object_pose())
        seen = self._seen(scene)
        self._view.see(*self._joints(), seen)
        failure = failures(scene, diverged)
        failed = failure != Outcome.RUNNING
        ended = self._episodes.tick(failed)
        reached = task.reached(scene.position, scene.axes, goal)
        self._outcomes.judge(reached, failure, ended)
        before, self._potential = self._potential, self._potentials(scene)
        return Transition(
            observation=self._view.observation(seen, goal),
            reward=reward(self._potential - before, reached, failed).astype(np.float32),
            discount=np.where(failed, 0.0, 1.0).astype(np.float32),
            ended=ended,
        )

    def _next_goals(self, chosen: NDArray[np.intp]) -> Array:
        if self._fixed_goals is not None:
            return np.asarray(self._fixed_goals[chosen])
        return self._task.random_goals(len(chosen), self._rng)

    def _object_pose(self) -> Array:
        """Returns where the objects are: m and quaternion w x y z, shape (N, 7)."""
        return np.asarray(self._arm.qpos[:, self._problem.model.layout.object_qpos])

    def _seen(self, scene: Scene) -> Scene:
        """Returns a scene as a policy sees it: the tool is where encoders tell."""
        sensors = self._sensors
        if sensors is None and self._problem.drawn is None:
            return scene
        pose = self._object_pose() if sensors is None else sensors.object_pose
        return self._scene(self._arm.qpos, pose)

    def _joints(self) -> tuple[Array, Array]:
        """Returns joint positions and velocities as a policy sees them, shape (N, J) each."""
        layout = self._problem.model.layout
        angles = self._arm.qpos[:, layout.qpos] - self._problem.zero
        joints = angles, self._arm.qvel[:, layout.dof]
        return joints if self._sensors is None else self._sensors.joints(*joints)

    def _potentials(self, scene: Scene) -> Array:
        return self._task.potential(scene.tip, scene.position, scene.axes, self._goal)


def random_starts(task: MatchingTask, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Returns where attempts begin: the arm above the basket, the object about its centre.

    Returns:
        Joint positions, rad, shape (n, J); poses of the object, m and quaternion w x y z, (n, 7).
    """
    joints = READY + rng.uniform(-_START_RAD, _START_RAD, size=(count, len(READY)))
    pose = np.zeros((count, 7))
    pose[:, :3] = task.rest_position
    pose[:, :2] += rng.uniform(-_START_M, _START_M, size=(count, 2))
    yaw = rng.uniform(-_START_YAW_RAD, _START_YAW_RAD, size=count)
    pose[:, 3], pose[:, 6] = np.cos(yaw / 2.0), np.sin(yaw / 2.0)
    return joints, pose


def failures(scene: Scene, diverged: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Returns what ended an episode, RUNNING where nothing did, shape (N,)."""
    failure = np.full(len(diverged), int(Outcome.RUNNING), np.int64)
    failure[tip_outside(scene.tip)] = Outcome.TOOL_LEFT_WORKSPACE
    failure[object_outside(scene.position)] = Outcome.OBJECT_LEFT_BASKET
    failure[diverged] = Outcome.DIVERGED
    return failure


def _check_cell(arm: ArmProblem, task: MatchingTask) -> None:
    layout = arm.model.layout
    if not layout.has_object or len(layout.joint_names) != len(READY):
        objects = "an object" if layout.has_object else "no object"
        raise ConfigError(
            f"{task.name}: the model has {len(layout.joint_names)} joints and {objects}, expected "
            f"a Sawyer's {len(READY)} and an object to push"
        )
