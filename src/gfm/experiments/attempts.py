"""Attempts of a policy on a robot, through its bridge: the paper's test, goal after goal.

What a policy sees is made of what the bridge reports: joints as measured, the object as tracked.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from gfm.core import BadInputError, CommandKind, GfmError, Observation, RefusedError
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.evaluation import ControlPolicy, finite
from gfm.envs.matching import failures, random_starts
from gfm.envs.matching_task import MatchingTask
from gfm.envs.matching_view import MatchingView, Scene
from gfm.envs.outcomes import Outcome, Outcomes
from gfm.experiments.driver import Driver
from gfm.experiments.person import Person
from gfm.sim.cell import END_EFFECTOR_SITE
from gfm.sim.kinematics import SiteKinematics, body_axes, yaw_of
from gfm.sim.sawyer import JOINT_NAMES
from gfm.sim.sawyer_numbers import BASKET_XYZ
from gfm_wire import PROTECTIVE_STOP

#: How long the object lies before an attempt, s: until it is at rest, and is seen there.
_LIES_S = 0.3
#: How long the arm takes to stop, s.
_STOPS_S = 0.3
#: A tool that is lower above the basket's floor, m, is lifted at first, at this speed, m/s,
#: for so long at most, s.
_LOW_M, _LIFT_M_S, _LIFT_S = 0.1, 0.1, 1.5
#: A way that is straight in the joints dips by some 3 cm: it first leads so far above its end, m.
_ABOVE_M = 0.1
#: How often the arm goes on where the bridge stops it on its way to an attempt.
_STOPS = 2
#: How long a robot may take to be driven again, s.
_WAIT_S = 1.0
#: How old a pose may become, s of the robot's time.
_LONGEST_UNSEEN_S = 1.0
#: How far from its place the object may have been put: m, and rad where its yaw matters.
_ASIDE_M, _TURNED_RAD = 0.02, 0.35
_ONE = np.arange(1)
#: A pose of the object where it makes no difference.
_SOMEWHERE = np.array([[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])


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
        self._tip = SiteKinematics(arm.nominal, END_EFFECTOR_SITE)

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
            RefusedError: the bridge says no, or the object is not seen where it was put.
            UnreachableError: the robot or its bridge does not answer.
        """
        rng = np.random.default_rng([self._seed, goal, trial])
        joints, pose = random_starts(self._task, 1, rng)
        if not self._ready(joints[0] + self._arm.zero, pose[0]):
            self._stand(_STOPS_S)
            return None
        about = {"purpose": "attempt", "task": self._task.name}
        about |= {"goal": str(goal), "trial": str(trial)}
        try:
            with self._driver.recording(recording, about) as told:
                tried = self._tried(goal)
        finally:
            with suppress(GfmError):  # where the robot is gone, or was stopped, that was said
                self._stand(_STOPS_S)
        if tried is None:
            return None
        return replace(tried, trial=trial, recording=told[0].path if told else "")

    def resumes(self) -> bool:
        """Returns whether to go on after an attempt was broken off; the robot stands meanwhile."""
        return self._person.resumes(self._rest)

    def _ready(self, joints: Array, pose: Array, stops: int = _STOPS) -> bool:
        """Returns whether arm and object are where they begin; False where that was broken off.

        Where the bridge stops the arm on the way, that is begun again, from where it is held.
        """
        try:
            return self._above_basket(joints) and self._object_put_back(pose)
        except RefusedError as error:
            if not stops or not str(error).startswith(PROTECTIVE_STOP):
                raise
        return self._ready(joints, pose, stops - 1)

    def _above_basket(self, joints: Array) -> bool:
        """Returns whether the arm is where it shall begin; False where that was broken off."""
        ways, interrupts = (self._raised(joints), joints), self._person.interrupts
        return self._lifted() and all(
            self._driver.go_to(JOINT_NAMES, way, CONTROL_PERIOD_S, interrupts) for way in ways
        )

    def _raised(self, joints: Array) -> Array:
        """Returns joints, rad, shape (J,), with which the tool is `_ABOVE_M` higher."""
        steps = 10
        for _ in range(steps):
            joints = joints + self._upwards(joints) * (_ABOVE_M / steps)
        return joints

    def _upwards(self, joints: Array) -> Array:
        """Returns how joints, (J,), move for the tool to rise: rad per m, shape (J,)."""
        qpos = self._arm.model.layout.as_qpos(joints[None], _SOMEWHERE)
        moves = self._tip.jacobian(qpos[0])[:, self._arm.model.layout.dof]
        return np.asarray(np.linalg.pinv(moves) @ [0.0, 0.0, 1.0])

    def _lifted(self) -> bool:
        """Returns whether the tool is clear of the floor; False where that was broken off.

        By positions, from those that the arm is told: by speeds it would sink, see `Driver.hold`.
        """
        driver = self._driver
        driver.begin(JOINT_NAMES, _WAIT_S)
        for _ in range(round(_LIFT_S / CONTROL_PERIOD_S)):
            qpos = self._qpos(driver.newest, _SOMEWHERE)
            if self._tip.positions(qpos)[0, 2] - BASKET_XYZ[2] >= _LOW_M:
                break
            if self._person.interrupts():
                return False
            if (told := driver.held) is None:
                driver.hold(JOINT_NAMES)
                continue
            speed = _LIFT_M_S * self._upwards(driver.newest.position)
            driver.command(CommandKind.POSITION, JOINT_NAMES, told + CONTROL_PERIOD_S * speed)
        return True

    def _object_put_back(self, pose: Array) -> bool:
        """Returns whether the object lies where it shall begin; False where that was broken off."""
        if self._driver.place_object(pose):
            self._stand(_LIES_S)
            if problem := self._not_in_place(pose):
                raise RefusedError(f"the object was put back and is {problem}")
            return True
        middle = np.array([*self._task.rest_position, 1.0, 0.0, 0.0, 0.0])
        request = "put the object at the basket's centre, unturned"
        while self._person.confirms(request, self._rest):
            self._stand(_LIES_S)
            problem = self._not_in_place(middle)
            if not problem:
                return True
            request = f"the object is {problem}: put it there"
        return False

    def _not_in_place(self, pose: Array) -> str:
        """Returns how far from a pose (7,) the object is seen, nothing where it is near enough."""
        scene = self._scene(self._driver.newest)
        goal = np.array([[*pose[:2], yaw_of(body_axes(pose[None, 3:]))[0]]])
        place, turn = (
            float(error[0]) for error in self._task.errors(scene.position, scene.axes, goal)
        )
        turned = self._task.tolerance_rad is not None and turn > _TURNED_RAD
        if place <= _ASIDE_M and not turned:
            return ""
        return f"seen {place * 100.0:.1f} cm and {np.degrees(turn):.0f} degrees from its place"

    def _rest(self) -> None:
        self._driver.rest(JOINT_NAMES, CONTROL_PERIOD_S)

    def _stand(self, seconds: float) -> None:
        for _ in range(round(seconds / CONTROL_PERIOD_S)):
            self._driver.hold(JOINT_NAMES)

    def _tried(self, goal: int) -> Attempt | None:
        """Returns an attempt, without what only its maker knows; None where it was broken off."""
        task, goals = self._task, self._task.radial_goals()[[goal]]
        view, outcomes = MatchingView(task, self._arm.velocity_limit, 1), Outcomes(1)
        scene = self._scene(self._driver.newest)
        view.begin(_ONE, *self._measured(self._driver.newest), scene)
        path = [scene.position[0, :2]]
        while outcomes.now[0] == Outcome.RUNNING:
            action = finite(self._policy(view.observation(scene, goals)))[0]
            if self._person.interrupts():
                return None
            speed = np.clip(action, -1.0, 1.0) * self._arm.velocity_limit
            stopped = not self._moves(speed)
            scene = self._scene(self._driver.newest)
            view.see(*self._measured(self._driver.newest), scene)
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

    def _moves(self, speed: Array) -> bool:
        """Lets the arm move for a period, rad/s, (J,); False where the bridge had to stop it."""
        try:
            self._driver.command(CommandKind.VELOCITY, JOINT_NAMES, speed, needs_object=True)
        except RefusedError as error:
            if str(error).startswith(PROTECTIVE_STOP):
                return False
            raise
        return True

    def _measured(self, report: Observation) -> tuple[Array, Array]:
        return report.position[None] - self._arm.zero, report.velocity[None]

    def _scene(self, report: Observation) -> Scene:
        if report.object_position is None or report.object_quaternion is None:
            raise RefusedError("the robot reports no object")
        unseen_s = (report.stamp_ns - report.object_stamp_ns) * 1e-9
        if unseen_s > _LONGEST_UNSEEN_S:
            raise RefusedError(f"the object was last seen {unseen_s:.1f} s ago")
        pose = np.concatenate([report.object_position, report.object_quaternion])[None]
        qpos = self._qpos(report, pose)
        return Scene(
            tip=self._tip.positions(qpos), position=pose[:, :3], axes=body_axes(pose[:, 3:])
        )

    def _qpos(self, report: Observation, pose: Array) -> Array:
        """Returns the model's positions, shape (1, nq), for an object in a pose (1, 7)."""
        return self._arm.model.layout.as_qpos(report.position[None], pose)


def planned(goals: int, trials: int) -> Iterator[tuple[int, int]]:
    """Yields goal and trial of every attempt: all goals once, then all again."""
    return ((goal, trial) for trial in range(trials) for goal in range(goals))
