"""Fitting a generalized force model as a control problem (Jeong et al. 2019, section III-B).

An episode starts at a recorded state and replays the recorded commands; the action adds bounded
generalized forces to the nominal model; the reward says how close the simulation stays to the
recording.

Shape letters: N instances, n of them, O observation size, A generalized forces, C channels of the
difference.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import EnvironmentSpec
from gfm.core.checks import Array, Array32
from gfm.envs.batched import BatchedEnvironment, Transition
from gfm.envs.difference import closeness, state_difference
from gfm.envs.episodes import Episodes
from gfm.envs.fit_problem import FitProblem
from gfm.sim.batch import HybridBatch
from gfm.sim.drive import drive_torque

NAME = "gfm_fit"
_PRIVILEGED_BOUND = 10.0


@final
class GfmFit(BatchedEnvironment):
    """N instances of the fitting problem.

    The observation is `gfm.sim.features`: the current and the previous states, and the torque that
    the nominal drives give for the command in force (which the paper's does not contain). Behind
    it, for the critic alone, stand the scaled differences of the current state from the recorded
    one and from the recorded next one: the reward depends on them, and a critic that had to guess
    where in the recordings it is learned nothing within minutes. Actions are forces in units of
    their limits. The time limit is no end of the world: discount 1. A simulation that diverges
    terminates with reward 0.

    Attributes:
        diverged: Simulations that became unstable so far.
    """

    def __init__(
        self, problem: FitProblem, num_envs: int, *, seed: int = 0, nthread: int = 1
    ) -> None:
        self.num_envs = num_envs
        privileged = 2 * len(problem.scale)
        self.spec = EnvironmentSpec(
            name=NAME,
            observation_size=problem.features.size + privileged,
            action_size=problem.action_size,
            privileged_size=privileged,
            reward_limit=1.0,
        )
        self.diverged = 0
        self._problem = problem
        self._rng = np.random.default_rng(seed)
        self._episodes = Episodes(num_envs, problem.horizon)
        self._batch = HybridBatch(problem.model, num_envs, nthread=nthread)
        self._observation: Array32 = np.zeros((num_envs, problem.features.size), np.float32)
        self._at: NDArray[np.intp] = np.zeros(num_envs, np.intp)
        self._law = problem.windows.law[np.zeros(num_envs, np.intp)]

    @override
    def reset(self, ids: NDArray[np.intp] | None = None) -> Array32:
        chosen = self._episodes.start(ids)
        windows, features = self._problem.windows, self._problem.features
        start = self._rng.choice(windows.start, size=len(chosen))
        recording = windows.recording[start]
        self._at[chosen] = start
        self._law[chosen] = windows.law[recording]
        self._batch.reset(
            chosen,
            [windows.models[i] for i in recording],
            windows.qpos[start],
            windows.qvel[start],
            windows.command_before(start),
        )
        past = start[:, None] + np.arange(-features.history, 1)
        rows = self._observation[chosen]
        features.fill(rows, windows.state[past])
        self._observation[chosen] = rows
        self._put_torque()
        return self._with_privileged()

    @override
    def step(self, action: Array32) -> Transition:
        problem, windows = self._problem, self._problem.windows
        force = self._episodes.checked(action, problem.action_size) * problem.model.force_limit
        diverged = self._batch.step(windows.command[self._at], force)
        self.diverged += int(diverged.sum())
        self._at += 1
        self._observe()
        return Transition(
            observation=self._with_privileged(),
            reward=np.where(diverged, 0.0, self._closeness()).astype(np.float32),
            discount=np.where(diverged, 0.0, 1.0).astype(np.float32),
            ended=self._episodes.tick(diverged),
        )

    def _closeness(self) -> NDArray[np.float64]:
        return closeness(self._difference(self._at), self._problem.scale)

    def _difference(self, index: NDArray[np.intp]) -> Array:
        """Returns how far the current states are from the recorded ones at `index`, (N, C)."""
        windows, layout = self._problem.windows, self._problem.model.layout
        qpos, qvel = self._batch.qpos, self._batch.qvel
        return state_difference(layout, qpos, qvel, windows.qpos[index], windows.qvel[index])

    def _with_privileged(self) -> Array32:
        ahead = self._problem.windows.following(self._at)
        differences = (self._difference(self._at), self._difference(ahead))
        scaled = np.concatenate(differences, axis=1) / np.tile(self._problem.scale, 2)
        bounded = np.clip(scaled, -_PRIVILEGED_BOUND, _PRIVILEGED_BOUND)
        return np.concatenate([self._observation, bounded], axis=1, dtype=np.float32)

    def _observe(self) -> None:
        features, layout = self._problem.features, self._problem.model.layout
        state = features.state(layout, self._batch.qpos, self._batch.qvel)
        features.push(self._observation, state)
        self._put_torque()

    def _put_torque(self) -> None:
        layout = self._problem.model.layout
        command = self._problem.windows.command[self._at, 0]
        q, v = self._batch.qpos[:, layout.qpos], self._batch.qvel[:, layout.dof]
        torque = drive_torque(self._law, command, q, v)
        self._problem.features.put_torque(self._observation, torque)
