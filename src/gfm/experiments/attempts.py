"""Attempts of a policy on a robot, through its bridge: the paper's test, goal after goal.

What a policy sees is made of what the bridge reports: joints as measured, the object as tracked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import final

import numpy as np

from gfm.core import BadInputError, CommandKind, Observation
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.evaluation import ControlPolicy
from gfm.envs.matching import failures, random_starts
from gfm.envs.matching_task import MatchingTask
from gfm.envs.matching_view import MatchingView, Scene
from gfm.envs.outcomes import Outcome, Outcomes
from gfm.experiments.drive import Driver
from gfm.sim.cell import END_EFFECTOR_SITE
from gfm.sim.kinematics import SiteKinematics, body_axes
from gfm.sim.sawyer import JOINT_NAMES

#: How long the object lies before an attempt, s: until it is at rest, and is seen there.
_LIES_S = 0.3
_ONE = np.arange(1)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One attempt, and what came of it.

    Attributes:
        goal: Number of the goal.
        trial: Number of the attempt at it.
        outcome: How it ended, in words.
        steps: Control periods until that was decided.
        place_m: Distance of the object from the goal at that moment, as tracked, m.
        turn_rad: Difference in yaw at that moment, rad.
        recording: File of the recording.
    """

    goal: int
    trial: int
    outcome: str
    steps: int
    place_m: float
    turn_rad: float
    recording: str

    @property
    def reached(self) -> bool:
        """Whether it succeeded."""
        return self.outcome == Outcome.REACHED.name.lower()


@final
class Attempts:
    """Makes attempts with one policy.

    Args:
        task: What is tried.
        arm: The nominal cell, furnished for the task.
        policy: From observations to actions.
        driver: Of a bridge that takes a command every control period.
        seed: Of the starts.
        paused: Called before every command; returns when to go on.
    """

    def __init__(
        self,
        task: MatchingTask,
        arm: ArmProblem,
        policy: ControlPolicy,
        driver: Driver,
        *,
        seed: int,
        paused: Callable[[], None] = lambda: None,
    ) -> None:
        self._task, self._arm, self._policy, self._driver = task, arm, policy, driver
        self._seed, self._paused = seed, paused
        self._tip = SiteKinematics(arm.nominal, END_EFFECTOR_SITE)

    def make(self, goal: int, trial: int, recording: str) -> Attempt:
        """Puts arm and object where they begin, and tries once.

        Args:
            goal: Number of the goal.
            trial: Number of the attempt at it.
            recording: Name under which it is recorded.

        Raises:
            BadInputError: the robot tracks no object, or the policy's actions are not finite.
            RefusedError: the robot cannot put the object back.
            UnreachableError: the robot or its bridge does not answer.
        """
        rng = np.random.default_rng([self._seed, goal, trial])
        joints, pose = random_starts(self._task, 1, rng)
        self._driver.go_to(JOINT_NAMES, joints[0], CONTROL_PERIOD_S)
        self._driver.place_object(pose[0])
        self._stand(_LIES_S)
        about = {"purpose": "attempt", "task": self._task.name, "goal": str(goal)}
        try:
            with self._driver.recording(recording, about) as told:
                outcome, steps, place, turn = self._tried(goal)
        finally:
            self._stand(CONTROL_PERIOD_S)
        return Attempt(
            goal=goal,
            trial=trial,
            outcome=outcome.name.lower(),
            steps=steps,
            place_m=place,
            turn_rad=turn,
            recording=told[0].path if told else "",
        )

    def _stand(self, seconds: float) -> None:
        for _ in range(max(round(seconds / CONTROL_PERIOD_S), 1)):
            self._driver.command(CommandKind.VELOCITY, JOINT_NAMES, np.zeros(len(JOINT_NAMES)))

    def _tried(self, goal: int) -> tuple[Outcome, int, float, float]:
        """Returns outcome, steps, and how far from the goal it ended, m and rad."""
        task, goals = self._task, self._task.radial_goals()[[goal]]
        view, outcomes = MatchingView(task, self._arm.velocity_limit, 1), Outcomes(1)
        scene = self._scene(self._driver.newest)
        view.begin(_ONE, *_measured(self._driver.newest), scene)
        step = 0
        for step in range(1, task.steps + 1):
            action = self._policy(view.observation(scene, goals))[0]
            if not np.isfinite(action).all():
                raise BadInputError("the policy's actions are not finite: its file is damaged")
            self._paused()
            speed = np.clip(action, -1.0, 1.0) * self._arm.velocity_limit
            told = self._driver.command(CommandKind.VELOCITY, JOINT_NAMES, speed)
            scene = self._scene(told)
            view.see(*_measured(told), scene)
            reached = task.reached(scene.position, scene.axes, goals)
            failure = failures(scene, np.zeros(1, dtype=bool))
            outcomes.judge(reached, failure, np.array([step == task.steps]))
            if outcomes.now[0] != Outcome.RUNNING:
                break
        place, turn = task.errors(scene.position, scene.axes, goals)
        return Outcome(outcomes.now[0]), step, float(place[0]), float(turn[0])

    def _scene(self, report: Observation) -> Scene:
        if report.object_position is None or report.object_quaternion is None:
            raise BadInputError(
                f"the robot reports no object, expected one that is tracked for {self._task.name}"
            )
        pose = np.concatenate([report.object_position, report.object_quaternion])[None]
        qpos = self._arm.model.layout.as_qpos(report.position[None], pose)
        return Scene(
            tip=self._tip.positions(qpos), position=pose[:, :3], axes=body_axes(pose[:, 3:])
        )


def _measured(report: Observation) -> tuple[Array, Array]:
    return report.position[None], report.velocity[None]


def planned(goals: int, trials: int) -> Iterator[tuple[int, int]]:
    """Yields goal and trial of every attempt: all goals once, then all again."""
    return ((goal, trial) for trial in range(trials) for goal in range(goals))
