"""Teaches a pose policy to get on where it makes no progress: made the one that comes with gfm.

    python benchmarks/unstuck.py --from pose_trained.npz --out pose_matching.npz

The policy is its own teacher wherever the task's potential grows. Where it has not grown for a
while, a program teaches that goes where the reward draws the tool, the hand upright. The student
acts (DAgger, Ross et al. 2011) and sees what a robot's sensors tell. Goals are drawn with yaws more
often near the largest, where the tested ones lie. One core, one and a half minutes.

Shape letters: N instances, T control periods, J joints, O observation size.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from gfm.core.checks import Array, Array32
from gfm.envs.arm import ArmProblem
from gfm.envs.matching import Matching
from gfm.envs.matching_task import POSE_MATCHING, MatchingTask
from gfm.envs.matching_view import Scene
from gfm.envs.outcomes import Outcome
from gfm.experiments.evaluate import EvaluationRequest, load_arm
from gfm.recording.weights_file import read_weights, write_weights
from gfm.rl.distillation import Student
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.sim.cell import END_EFFECTOR_SITE

_INSTANCES, _PERIODS = 48, 1000
#: What the potential has to gain to count as progress, and for how many periods it may gain less.
_GAINED, _PATIENCE = 0.5, 30
#: So many periods before a policy is found stuck it was already.
_ALREADY = 15
#: Of the program: tool speed, m/s, gain on the way left, 1/s.
_SPEED_M_S, _GAIN = 0.12, 3.0
#: Of the stuck instances the program leads so many; half of all get noise of this size.
_LED, _NOISE = 0.3, 0.1
_HELD, _EPISODE = 10, 400
_FIRST, _EVERY, _STEPS_EACH, _STEPS_LAST, _RATE = 40, 4, 16, 6000, 5e-4


class WideYaws(MatchingTask):
    """Pose matching whose training goals lie near the largest yaws more often."""

    def random_goals(self, count: int, rng: np.random.Generator) -> Array:
        """Returns goals as the task's own, their yaw drawn as their radius is, shape (n, 3)."""
        radius = 1.2 * self.goal_radius_m * np.sqrt(rng.uniform(size=count))
        angle = rng.uniform(-np.pi, np.pi, size=count)
        size = 1.2 * self.goal_yaw_rad * np.sqrt(rng.uniform(size=count))
        yaw = size * rng.choice([-1.0, 1.0], size=count)
        x, y = self.rest_position[0], self.rest_position[1]
        return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle), yaw], axis=1)


class Program:
    """Goes where the reward wants the tool, upright."""

    def __init__(self, task: MatchingTask, arm: ArmProblem) -> None:
        self._task, self._model, self._limit = task, arm.nominal, arm.velocity_limit
        self._data = mujoco.MjData(self._model)
        self._site = self._model.site(END_EFFECTOR_SITE).id
        self._jacobian = np.zeros((6, self._model.nv))

    def __call__(self, scene: Scene, goal: Array, qpos: Array) -> Array32:
        """Returns actions, shape (N, J)."""
        place = self._task.tool_place(scene.tip, scene.position, scene.axes, goal)
        speed = _GAIN * (place - scene.tip)
        size = np.maximum(np.linalg.norm(speed, axis=1, keepdims=True), 1e-9)
        speed *= np.minimum(1.0, _SPEED_M_S / size)
        return np.stack([self._towards(q, v) for q, v in zip(qpos, speed, strict=True)]).astype(
            np.float32
        )

    def _towards(self, qpos: Array, speed: Array) -> Array:
        model, data, rows = self._model, self._data, self._jacobian
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_jacSite(model, data, rows[:3], rows[3:], self._site)
        upright = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
        turn = 0.5 * np.cross(data.site_xmat[self._site].reshape(3, 3).T, upright).sum(axis=0)
        scaled = rows[:, : len(self._limit)] * self._limit
        wanted = np.concatenate([speed, 2.0 * turn])
        action = scaled.T @ np.linalg.solve(scaled @ scaled.T + 1e-5 * np.eye(6), wanted)
        return np.asarray(action / max(np.abs(action).max(), 1.0))


class Progress:
    """Knows which of N instances make none."""

    def __init__(self) -> None:
        self._best, self._since = np.full(_INSTANCES, -np.inf), np.zeros(_INSTANCES, int)
        self.stuck = np.zeros(_INSTANCES, bool)

    def see(self, potential: Array) -> None:
        """Takes in the potentials, shape (N,)."""
        better = potential > self._best + _GAINED
        self._best = np.where(better, potential, self._best)
        self._since = np.where(better, 0, self._since + 1)
        self.stuck = (self.stuck | (self._since >= _PATIENCE)) & ~better

    def begin(self, ids: NDArray[np.intp]) -> None:
        """Begins anew in the instances `ids`."""
        self._best[ids], self._since[ids], self.stuck[ids] = -np.inf, 0, False


class Lesson:
    """A student in N instances, with the policy and the program beside it."""

    def __init__(self, begin_from: Path, seed: int) -> None:
        task = WideYaws(**vars(POSE_MATCHING))
        arm = load_arm(EvaluationRequest(task=task.name, sensed=True))
        self.weights = read_weights(begin_from)
        self._policy = self._now = GaussianPolicy.from_weights(self.weights)
        self.student, self._rng = Student(self.weights.tensors, seed), np.random.default_rng(seed)
        self._task, self._env = task, Matching(task, arm, _INSTANCES, seed=seed)
        self._program, self._progress = Program(task, arm), Progress()
        self._seen_now = self._env.reset()
        self._born, self._held = np.zeros(_INSTANCES, int), np.zeros(_INSTANCES, int)
        rows = (_PERIODS, _INSTANCES)
        self._seen = np.zeros((*rows, self._seen_now.shape[1]), np.float32)
        self._own, self._programs = np.zeros((2, *rows, 7), np.float32)
        self._stuck = np.zeros(rows, bool)

    def act(self, period: int) -> None:
        """Acts for one period; who is to teach in it, and shortly before, is noted."""
        env, scene, task = self._env, self._env.scene(), self._task
        before, reached = self._progress.stuck, task.reached(scene.position, scene.axes, env.goal)
        self._progress.see(task.potential(scene.tip, scene.position, scene.axes, env.goal))
        stuck = self._progress.stuck & ~reached
        self._seen[period] = self._seen_now
        self._own[period] = self._policy.mean_action(self._seen_now)
        self._programs[period] = self._program(scene, env.goal, env.qpos)
        self._stuck[period] = stuck
        for i in np.flatnonzero(stuck & ~before):
            self._stuck[max(self._born[i], period - _ALREADY) : period + 1, i] = True
        self._step(period, self._disturbed(self._now.mean_action(self._seen_now), stuck, period))

    def learn(self, until: int, rates: Array) -> None:
        """Learns from all periods before one."""
        seen = self._seen[:until].reshape(-1, self._seen.shape[2])
        taught = np.where(
            self._stuck[:until, :, None], self._programs[:until], self._own[:until]
        ).reshape(-1, 7)
        for rate in rates:
            self.student.learn(seen, taught, float(rate))
        self._now = GaussianPolicy.from_weights(self.student.tensors)

    def _disturbed(self, action: Array32, stuck: NDArray[np.bool_], period: int) -> Array32:
        noise = _NOISE * self._rng.standard_normal(action.shape).astype(np.float32)
        noise[::2] = 0.0
        led = (self._rng.random(_INSTANCES) < _LED) & stuck
        return np.clip(np.where(led[:, None], self._programs[period], action) + noise, -1.0, 1.0)

    def _step(self, period: int, action: Array32) -> None:
        transition = self._env.step(action)
        self._held = np.where(self._env.outcome == Outcome.REACHED, self._held + 1, 0)
        broken_off = self._rng.random(_INSTANCES) < 1.0 / _EPISODE
        over = np.flatnonzero(transition.ended | (self._held > _HELD) | broken_off)
        self._seen_now = transition.observation
        if len(over):
            self._seen_now = self._env.reset(over)
            self._progress.begin(over)
            self._held[over], self._born[over] = 0, period + 1


def main() -> None:
    """Teaches, and writes the student."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--from", dest="begin_from", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    torch.set_num_threads(1)
    lesson = Lesson(asked.begin_from, asked.seed)
    for period in range(_PERIODS):
        lesson.act(period)
        if period >= _FIRST and period % _EVERY == 0:
            lesson.learn(period, np.full(_STEPS_EACH, _RATE))
    lesson.learn(_PERIODS, np.linspace(_RATE, 0.0, _STEPS_LAST, endpoint=False))
    write_weights(asked.out, replace(lesson.weights, tensors=lesson.student.tensors))


if __name__ == "__main__":
    main()
