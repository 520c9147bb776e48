"""Following joint trajectories through random waypoints, without contact.

Shape letters: N instances, n of them, J joints, T control periods of an episode, W waypoints.
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
from gfm.envs.difference import closeness
from gfm.envs.episodes import Episodes
from gfm.envs.history import History
from gfm.sim.sawyer import READY

NAME = "joint_tracking"
#: Control periods of an episode: 20 s, as position matching has it.
STEPS = 400
#: States in the observation, the current one among them (the paper).
STATES = 10

_SEGMENT = 40  # control periods between two waypoints: 2 s
_SPEED_SHARE = 0.8  # of the commanded velocities' limit, at most, on the way
_PEAK = 1.875  # of a minimum-jerk motion's speed, in units of its mean
_REACH_RAD = 0.5  # waypoints lie within this of the start
_AHEAD = (1, 2, 5, 10)  # control periods at which the reference is observed
_ERROR_RAD = 0.02  # an error of so much in every joint is worth exp(-1)
_START_RAD, _SPEED_LIMITS, _STEP = 0.02, 3.0, 0.1


@final
class JointTracking(BatchedEnvironment):
    """N instances of the tracking task.

    The reference stops at a random waypoint every 2 s, on minimum-jerk ways that need 80 % of the
    speed limit at most. The observation is the state now and the nine before (joint positions,
    velocities) and where the reference is now and will be, seen from the current position. Actions
    are joint velocities in units of 5 % of what is allowed, times the curriculum's gain. Reward:
    exp(-mean((error / 0.02 rad)^2)). Nothing terminates but a simulation that diverges.
    """

    def __init__(
        self,
        arm: ArmProblem,
        num_envs: int,
        *,
        seed: int = 0,
        nthread: int = 1,
        horizon: int | None = None,
    ) -> None:
        joints = len(arm.model.layout.joint_names)
        if joints != len(READY):
            raise ConfigError(f"{NAME}: the model has {joints} joints, expected {len(READY)}")
        self.num_envs = num_envs
        self._problem, self._steps = arm, horizon or STEPS
        self._rng = np.random.default_rng(seed)
        self._arm = Arm(arm, num_envs, self._rng, nthread)
        self._history = History(num_envs, STATES, 2 * joints)
        self._episodes = Episodes(num_envs, self._steps)
        self._reference: Array = np.zeros((num_envs, self._steps + 1 + max(_AHEAD), joints))
        self._at = np.zeros(num_envs, np.intp)
        self._scale = np.full(joints, _ERROR_RAD * np.sqrt(joints))
        self._squares = np.zeros(num_envs)
        self._rmse = np.full(num_envs, np.nan)
        self.spec = EnvironmentSpec(
            name=NAME,
            observation_size=self._history.size + (1 + len(_AHEAD)) * joints,
            action_size=joints,
            reward_limit=1.0,
        )

    @property
    def reference(self) -> Array:
        """Where the joints should be now, rad, shape (N, J)."""
        return self._reference[np.arange(self.num_envs), self._at]

    @property
    def position(self) -> Array:
        """Where the joints are, rad, shape (N, J)."""
        return np.array(self._arm.qpos[:, self._problem.model.layout.qpos])

    @override
    def set_progress(self, learner_steps: int) -> None:
        self._arm.set_progress(learner_steps)

    @override
    def gauges(self) -> Mapping[str, float]:
        known = self._rmse[np.isfinite(self._rmse)]
        error = {"tracking_rmse_rad": float(known.mean())} if len(known) else {}
        return {**self._arm.gauges(), **error}

    @override
    def reset(self, ids: NDArray[np.intp] | None = None) -> Array32:
        chosen = self._episodes.start(ids)
        shape = (len(chosen), len(READY))
        start = READY + self._rng.uniform(-_START_RAD, _START_RAD, size=shape)
        self._arm.reset(chosen, self._problem.model.layout.as_qpos(start))
        self._reference[chosen] = self._next_references(start)
        self._at[chosen] = 0
        self._squares[chosen] = 0.0
        self._history.fill(chosen, self._state()[chosen])
        return self._observation()

    @override
    def step(self, action: Array32) -> Transition:
        diverged = self._arm.step(self._episodes.checked(action, self.spec.action_size))
        self._at += 1
        self._history.push(self._state())
        error = self.position - self.reference
        ended = self._episodes.tick(diverged)
        self._measure(error, ended)
        reward = np.where(diverged, 0.0, closeness(error, self._scale))
        return Transition(
            observation=self._observation(),
            reward=reward.astype(np.float32),
            discount=np.where(diverged, 0.0, 1.0).astype(np.float32),
            ended=ended,
        )

    def _measure(self, error: Array, ended: NDArray[np.bool_]) -> None:
        self._squares += np.square(error).mean(axis=1)
        self._rmse[ended] = np.sqrt(self._squares[ended] / self._at[ended])

    def _next_references(self, start: Array) -> Array:
        """Returns references from (n, J) on for the whole episode and what is seen ahead."""
        rows = self._reference.shape[1]
        segments = -(-rows // _SEGMENT)
        farthest = _SPEED_SHARE * self._problem.velocity_limit * _SEGMENT * CONTROL_PERIOD_S / _PEAK
        ways = self._rng.uniform(-1.0, 1.0, size=(segments, *start.shape)) * farthest
        points = [start]
        for way in ways:
            points.append(start + np.clip(points[-1] + way - start, -_REACH_RAD, _REACH_RAD))
        return minimum_jerk(np.stack(points, axis=1), _SEGMENT)[:, :rows]

    def _state(self) -> Array:
        """Returns scaled states, shape (N, 2 J)."""
        velocity = self._arm.qvel[:, self._problem.model.layout.dof]
        limit = _SPEED_LIMITS * self._problem.velocity_limit
        return np.concatenate([(self.position - READY) / _REACH_RAD, velocity / limit], axis=1)

    def _observation(self) -> Array32:
        times = self._at[:, None] + np.array((0, *_AHEAD))
        ahead = self._reference[np.arange(self.num_envs)[:, None], times]
        seen = (ahead - self.position[:, None]) / _STEP
        parts = (self._history.observed(_STEP), seen.reshape(self.num_envs, -1))
        return np.concatenate(parts, axis=1, dtype=np.float32)


def minimum_jerk(points: Array, steps: int) -> Array:
    """Returns positions on the way through `points` (n, W, J), at rest in each of them.

    Flash and Hogan 1985: x + d (10 s^3 - 15 s^4 + 6 s^5) for s from 0 to 1.

    Returns:
        `steps` positions from each point to the next, and the last point, shape
        (n, (W - 1) * steps + 1, J).
    """
    s = np.arange(steps) / steps
    share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    ways = points[:, :-1, None] + share[:, None] * np.diff(points, axis=1)[:, :, None]
    joined = ways.reshape(len(points), -1, points.shape[-1])
    return np.concatenate([joined, points[:, -1:]], axis=1)
