"""Attempts of a policy on a robot, through its bridge: the paper's test, goal after goal.

What a policy sees is made of what the bridge reports: joints as measured, the object as tracked.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from gfm.core import BadInputError, CommandKind, GfmError, RefusedError
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.evaluation import ControlPolicy, finite
from gfm.envs.matching import failures, random_starts
from gfm.envs.matching_task import MatchingTask
from gfm.envs.matching_view import MatchingView
from gfm.envs.outcomes import Outcome, Outcomes
from gfm.experiments.attempt_bearing import Bearing
from gfm.experiments.attempt_start import AttemptStart
from gfm.experiments.attempt_view import RobotView
from gfm.experiments.driver import Driver
from gfm.experiments.person import Person
from gfm.sim.sawyer import JOINT_NAMES
from gfm_wire import PROTECTIVE_STOP

#: How long the arm takes to stop, s.
_STOPS_S = 0.3
_ONE = np.arange(1)


@dataclass(frozen=True, kw_only=True)
class Attempt:
    """One attempt, and what came of it.

    Attributes:
        goal: Number of the goal.
        outcome: How it ended, a member of `Outcome` in small letters.
        steps: Control periods until that was decided.
        place_m: Distance of the object from the goal at that moment, as tracked, m.
        turn_rad: Difference in yaw at that moment, rad.
        path: Of the object, as tracked: x and y in m at the start and after every period.
        trial: Number of the attempt at the goal.
        recording: File of the recording.
    """

    goal: int
    outcome: str
    steps: int
    place_m: float
    turn_rad: float
    path: list[list[float]]
    trial: int = 0
    recording: str = ""


@final
class AttemptRunner:
    """Makes attempts with one policy.

    Args:
        task: What is tried.
        arm: The cell by which the tool is placed, furnished for the task.
        policy: From observations to actions.
        driver: Of a bridge that takes a command every control period.
        seed: Of the starts.
        person: Who may pause or end it, and puts the object back where the robot cannot.
    """

    def __init__(
        self,
        task: MatchingTask,
        arm: ArmProblem,
        policy: ControlPolicy,
        driver: Driver,
        *,
        seed: int,
        person: Person | None = None,
    ) -> None:
        self._task, self._arm, self._policy, self._driver = task, arm, policy, driver
        self._seed, self._person = seed, person or Person()
        self._view, self._bearing = RobotView(arm), Bearing(arm)
        self._start = AttemptStart(task, self._view, driver, self._person)

    def begin(self) -> None:
        """Makes sure that this robot can be driven: at the right rate, with an object in sight.

        Raises:
            BadInputError: it cannot.
        """
        self._driver.check_rate(JOINT_NAMES, CONTROL_PERIOD_S)
        if self._driver.newest.object_position is None:
            raise BadInputError(
                f"the robot reports no object, expected one that is tracked for {self._task.name}"
            )

    def make(self, goal: int, trial: int, recording: str) -> Attempt | None:
        """Puts arm and object where they begin, and tries once; None where that was broken off.

        Args:
            goal: Number of the goal.
            trial: Number of the attempt at it.
            recording: Name under which it is recorded.

        Raises:
            BadInputError: nobody can put the object back, or the policy's actions are not finite.
            AsideError: the object is not seen where it was put.
            RefusedError: the bridge says no, or keeps the arm from where the attempt begins.
            UnreachableError: the robot or its bridge does not answer.
        """
        rng = np.random.default_rng([self._seed, goal, trial])
        joints, pose = random_starts(self._task, 1, rng)
        if not self._start.reach(joints[0] + self._arm.zero, pose[0]):
            self._start.stand(_STOPS_S)
            return None
        about = {"purpose": "attempt", "task": self._task.name}
        about |= {"goal": str(goal), "trial": str(trial)}
        try:
            with self._driver.recording(recording, about) as told:
                tried = self._tried(goal)
        finally:
            with suppress(GfmError):  # where the robot is gone, or was stopped, that was said
                self._start.stand(_STOPS_S)
        if tried is None:
            return None
        return replace(tried, trial=trial, recording=told[0].path if told else "")

    def resumes(self) -> bool:
        """Returns whether to go on after an attempt was broken off; the robot stands meanwhile."""
        return self._person.resumes(self._start.rest)

    def _tried(self, goal: int) -> Attempt | None:
        """Returns an attempt, without what only its maker knows; None where it was broken off."""
        task, goals = self._task, self._task.radial_goals()[[goal]]
        seen, outcomes = MatchingView(task, self._arm.velocity_limit, 1), Outcomes(1)
        scene = self._view.scene(self._driver.newest)
        seen.begin(_ONE, *self._view.joints(self._driver.newest), scene)
        path = [scene.position[0, :2]]
        while outcomes.now[0] == Outcome.RUNNING:
            action = finite(self._policy(seen.observation(scene, goals)))[0]
            if self._person.interrupts():
                return None
            speed = np.clip(action, -1.0, 1.0) * self._arm.velocity_limit
            added = self._bearing.speed(self._driver.newest.position)
            stopped = not self._moves(speed + added, self._bearing.share(added))
            scene = self._view.scene(self._driver.newest)
            seen.see(*self._view.joints(self._driver.newest), scene)
            path.append(scene.position[0, :2])
            reached = task.reached(scene.position, scene.axes, goals)
            failure = failures(scene, np.zeros(1, dtype=bool))
            if stopped:
                failure[:] = Outcome.PROTECTIVE_STOP
            outcomes.judge(reached, failure, np.array([len(path) > task.steps]))
        place, turn = task.errors(scene.position, scene.axes, goals)
        return Attempt(
            goal=goal,
            outcome=Outcome(outcomes.now[0]).name.lower(),
            steps=len(path) - 1,
            place_m=float(place[0]),
            turn_rad=float(turn[0]),
            path=np.round(path, 5).tolist(),
        )

    def _moves(self, speed: Array, share: float) -> bool:
        """Lets the arm move for a period, rad/s, (J,); False where the bridge had to stop it."""
        try:
            self._driver.command(
                CommandKind.VELOCITY,
                JOINT_NAMES,
                speed,
                speed_share=share,
                needs_object=True,
            )
        except RefusedError as error:
            if str(error).startswith(PROTECTIVE_STOP):
                return False
            raise
        return True


def planned(goals: int, trials: int) -> Iterator[tuple[int, int]]:
    """Yields goal and trial of every attempt: all goals once, then all again."""
    return ((goal, trial) for trial in range(trials) for goal in range(goals))
