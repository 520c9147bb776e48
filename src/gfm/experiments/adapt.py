"""What `gfm adapt` does: a policy learns to do on a corrected model what it did on its own.

The inverse dynamics of the corrected model (`gfm.envs.inverse_dynamics`) tell the action that
leads where the policy wanted to go. They need the whole state of a simulation; the policy learns
from them to do the same from what a robot's sensors tell, where it comes itself. Nothing is
rewarded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from gfm.core import Clock, Weights
from gfm.core.checks import Array32
from gfm.envs.arm import ArmProblem
from gfm.envs.inverse_dynamics import ArmState, InverseDynamics
from gfm.envs.matching import Matching
from gfm.envs.matching_task import TASKS, MatchingTask
from gfm.envs.registry import as_trained, furnished
from gfm.experiments.evaluate import EvaluationRequest, load_arm, policy_for
from gfm.experiments.progress import Phase, RunProgress
from gfm.recording.weights_file import read_weights, write_weights
from gfm.rl.distillation import Student
from gfm.rl.policy_numpy import GaussianPolicy

_ADAPT = "adapt the policy"
#: Instances that act together, and control periods in which they do.
_INSTANCES, _PERIODS = 32, 600
#: Learning steps in each of these, and after the last one.
_STEPS_EACH, _STEPS_LAST = 4, 3000
_LEARNING_RATE = 1e-3
#: Control periods in which the teacher's actions give way to the student's.
_HANDOVER = 100
#: Of what is added to the actions of half of the instances, so that the student also learns to come
#: back.
_NOISE = 0.1
#: An episode is broken off after so many control periods in the mean: what lies before the goal is
#: seen more often than what comes after it.
_EPISODE = 120
_SECONDS, _THREADS = 120.0, 2


@dataclass(frozen=True, kw_only=True)
class AdaptRequest:
    """What is asked for.

    Attributes:
        task: Name of the environment.
        policy: Its file.
        model: MJCF of the corrected cell or arm, for velocity commands.
        own: The same of the model on which the policy was trained; None for the nominal cell.
        out: File of the adapted policy.
        seed: Of goals, starts, noise and the order of examples.
    """

    task: str
    policy: Path
    model: Path
    own: Path | None = None
    out: Path
    seed: int = 0


def adapt_policy(
    request: AdaptRequest, console: Console, clock: Clock, stopped: Callable[[], bool]
) -> None:
    """Writes the adapted policy.

    Raises:
        BadInputError: policy, models and task do not go together.
        KeyboardInterrupt: `stopped` ended it; nothing is written.
    """
    task = TASKS[request.task]
    weights = read_weights(request.policy)
    own = _load_arm(request.task, request.own)
    other = _load_arm(request.task, request.model, sensed=True)
    policy_for(request.policy, weights, Matching(task, other, 1).spec)
    lesson = Lesson(task, own, other, weights, request.seed)
    phase = Phase(name=_ADAPT, expected_s=_SECONDS)
    with RunProgress([phase], console=console, clock=clock) as progress, progress.phase(_ADAPT):
        for period in range(_PERIODS):
            if stopped():
                raise KeyboardInterrupt
            lesson.act()
            progress.say(f"{lesson.examples} examples", share=period / _PERIODS)
        lesson.finish()
    write_weights(request.out, replace(weights, tensors=lesson.tensors))
    console.print(f"policy: {request.out}", soft_wrap=True, highlight=False)


def _load_arm(task: str, model: Path | None, *, sensed: bool = False) -> ArmProblem:
    """Returns the cell of a model's file, the nominal one by default, as it is trained on."""
    request = EvaluationRequest(task=task, model=model, sensed=sensed)
    return load_arm(request, lambda spec: as_trained(furnished(task, spec), task))


class Lesson:
    """A student in N instances of a task on the corrected model, and its teacher beside it."""

    def __init__(
        self, task: MatchingTask, own: ArmProblem, other: ArmProblem, weights: Weights, seed: int
    ) -> None:
        """Begins with the policy as it is.

        Args:
            task: Which.
            own: The model on which the policy was trained.
            other: The one on which it shall do the same.
            weights: The policy.
            seed: Of everything random.
        """
        self._env = Matching(task, other, _INSTANCES, seed=seed, nthread=_THREADS)
        self._inverse = InverseDynamics(own, other, _INSTANCES, nthread=_THREADS)
        self._policy = self._now = GaussianPolicy.from_weights(weights)
        self._student = Student(weights.tensors, seed)
        self._rng = np.random.default_rng(seed)
        self._observation = self._env.reset()
        self._action = np.zeros((_INSTANCES, self._env.spec.action_size), np.float32)
        self._periods = 0
        size = _PERIODS * _INSTANCES
        self._seen = np.zeros((size, self._env.spec.policy_size), np.float32)
        self._taught = np.zeros((size, self._env.spec.action_size), np.float32)

    @property
    def examples(self) -> int:
        """How many there are."""
        return self._periods * _INSTANCES

    @property
    def tensors(self) -> dict[str, Array32]:
        """Of the student."""
        return self._student.tensors

    def act(self) -> None:
        """Acts for one control period, and learns from what the teacher would have done."""
        state = ArmState(qpos=self._env.qpos, qvel=self._env.qvel, action=self._action)
        taught = self._inverse(state, self._policy.mean_action(self._observation))
        rows = slice(self.examples, self.examples + _INSTANCES)
        self._seen[rows], self._taught[rows] = self._observation, taught
        self._periods += 1
        self._action = self._disturbed(self._chosen(taught))
        transition = self._env.step(self._action)
        broken_off = self._rng.random(_INSTANCES) < 1.0 / _EPISODE
        over = np.flatnonzero(transition.ended | broken_off)
        self._observation = self._env.reset(over) if len(over) else transition.observation
        self._action[over] = 0.0
        self._learn([_LEARNING_RATE] * _STEPS_EACH)

    def finish(self) -> None:
        """Learns from all examples, in smaller and smaller steps."""
        self._learn(np.linspace(_LEARNING_RATE, 0.0, _STEPS_LAST, endpoint=False))

    def _chosen(self, taught: Array32) -> Array32:
        """Returns the student's actions; at first, of some instances, the teacher's."""
        led = self._rng.random(_INSTANCES) < 1.0 - self._periods / _HANDOVER
        return np.where(led[:, None], taught, self._now.mean_action(self._observation))

    def _disturbed(self, action: Array32) -> Array32:
        noise = _NOISE * self._rng.standard_normal(action.shape, dtype=np.float32)
        noise[::2] = 0.0
        return np.clip(action + noise, -1.0, 1.0)

    def _learn(self, learning_rates: NDArray[np.float64] | list[float]) -> None:
        seen, taught = self._seen[: self.examples], self._taught[: self.examples]
        for rate in learning_rates:
            self._student.learn(seen, taught, float(rate))
        self._now = GaussianPolicy.from_weights(self._student.tensors)
