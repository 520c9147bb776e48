"""The paper's test of a policy: ten radial goals, several attempts at each, no help.

Shape letters: M attempts, T control periods, S moments (T + 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core import BadInputError
from gfm.core.checks import Array, Array32
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.matching import Matching
from gfm.envs.matching_task import MatchingTask
from gfm.envs.matching_view import Scene
from gfm.envs.outcomes import Outcome

#: From observations (M, O) to actions (M, A).
ControlPolicy = Callable[[Array32], Array32]


@dataclass(frozen=True, kw_only=True, eq=False)
class Attempts:
    """What came of all attempts, goal after goal.

    Attributes:
        goals: The different goals, x, y, yaw, shape (G, 3).
        goal: Which of them each attempt had, shape (M,).
        outcome: Members of `Outcome`, none of them RUNNING, shape (M,).
        steps: Control periods until that was decided, shape (M,).
        place: Distance from the goal at that moment, m, shape (M,).
        turn: Difference in yaw at that moment, rad, shape (M,).
        path: Of the object, x and y in m, NaN after the decision, shape (M, S, 2).
    """

    goals: Array
    goal: NDArray[np.intp]
    outcome: NDArray[np.int64]
    steps: NDArray[np.int64]
    place: Array
    turn: Array
    path: Array

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Which attempts succeeded, shape (M,)."""
        successes: NDArray[np.bool_] = self.outcome == Outcome.REACHED
        return successes

    @property
    def time_s(self) -> Array:
        """How long each attempt took, s, shape (M,)."""
        return np.asarray(self.steps * CONTROL_PERIOD_S)

    @property
    def best(self) -> int:
        """The fastest success; where there is none, the attempt that ended nearest."""
        order = np.lexsort((self.place, np.where(self.reached, self.steps, 0), ~self.reached))
        return int(order[0])

    @property
    def worst(self) -> int:
        """The failure that ended farthest; where there is none, the slowest success."""
        order = np.lexsort((-self.place, np.where(self.reached, -self.steps, 0), self.reached))
        return int(order[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedAttempts(Attempts):
    """Attempts of which all is known.

    Attributes:
        qpos: Positions at every moment, shape (S, M, nq).
    """

    qpos: Array


def evaluate(
    task: MatchingTask,
    arm: ArmProblem,
    policy: ControlPolicy,
    *,
    trials: int,
    seed: int,
    nthread: int = 1,
) -> SimulatedAttempts:
    """Returns `trials` attempts at each radial goal, all of them simulated together.

    An attempt ends with its first decision: the goal held for 0.5 s, a failure, or the time limit.

    Raises:
        BadInputError: the policy's actions are not finite.
    """
    goals = task.radial_goals()
    goal = np.repeat(np.arange(len(goals)), trials)
    env = Matching(task, arm, len(goal), seed=seed, nthread=nthread, goals=goals[goal])
    record = _Record(task, env)
    observation = env.reset()
    record.begin()
    for _ in range(task.steps):
        transition = env.step(finite(policy(observation)))
        record.add()
        observation = transition.observation
        if not record.running.any():
            break
        if transition.ended.any():
            observation = env.reset(np.flatnonzero(transition.ended))
    return record.attempts(goals, goal)


def finite(action: Array32) -> Array32:
    """Returns actions as they are.

    Raises:
        BadInputError: they are not finite.
    """
    if not np.isfinite(action).all():
        raise BadInputError("the policy's actions are not finite: its file is damaged")
    return action


class _Record:
    """Keeps what happens until every attempt is decided."""

    def __init__(self, task: MatchingTask, env: Matching) -> None:
        self._task, self._env = task, env
        self._outcome = np.zeros(env.num_envs, np.int64)
        self._steps = np.zeros(env.num_envs, np.int64)
        self._place: Array = np.zeros(env.num_envs)
        self._turn: Array = np.zeros(env.num_envs)
        self._path: list[Array] = []
        self._qpos: list[Array] = []

    @property
    def running(self) -> NDArray[np.bool_]:
        """Which attempts are not decided, shape (M,)."""
        undecided: NDArray[np.bool_] = self._outcome == Outcome.RUNNING
        return undecided

    def begin(self) -> None:
        """Takes in the start."""
        scene = self._env.scene()
        self._path, self._qpos = [scene.position[:, :2]], [self._env.qpos]

    def add(self) -> None:
        """Takes in one step; what is decided stays as it was."""
        running, scene = self.running, self._env.scene()
        self._measure(running, scene)
        place = np.where(running[:, None], scene.position[:, :2], np.nan)
        self._path.append(place)
        self._qpos.append(np.where(running[:, None], self._env.qpos, self._qpos[-1]))

    def _measure(self, running: NDArray[np.bool_], scene: Scene) -> None:
        place, turn = self._task.errors(scene.position, scene.axes, self._env.goal)
        self._place[running], self._turn[running] = place[running], turn[running]
        self._steps[running] += 1
        self._outcome[running] = self._env.outcome[running]

    def attempts(self, goals: Array, goal: NDArray[np.intp]) -> SimulatedAttempts:
        """Returns everything."""
        return SimulatedAttempts(
            goals=goals,
            goal=goal,
            outcome=self._outcome,
            steps=self._steps,
            place=self._place,
            turn=self._turn,
            path=np.stack(self._path, axis=1),
            qpos=np.stack(self._qpos),
        )
