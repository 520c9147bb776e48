"""From steps of N instances to sequences of T transitions each.

Shape letters: N instances, T transitions of a sequence, O observation size, A action size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray

from gfm.core import EnvironmentSpec
from gfm.core.checks import Array32
from gfm.envs.batched import Transition


@dataclass(frozen=True, kw_only=True)
class Acted:
    """What was decided before a step.

    Attributes:
        observation: On which it was decided, shape (N, O).
        action: As sampled, shape (N, A).
        log_prob: Of that action, shape (N,).
        weights_life: Of the policy that decided.
        weights_version: Of the policy that decided.
    """

    observation: Array32
    action: Array32
    log_prob: Array32
    weights_life: int
    weights_version: int


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A finished sequence that has no number yet; see `gfm.core.Sequence`."""

    weights_life: int
    weights_version: int
    observation: Array32
    action: Array32
    reward: Array32
    discount: Array32
    log_prob: Array32


@final
class Assembler:
    """Collects one sequence per instance; sequences do not overlap.

    An episode that terminates inside a sequence rests where it ended: the sequence is filled with
    its last observation, zero action, zero reward and discount 0, which says the same to Retrace.
    An episode cut by time inside a sequence cannot be filled so; its steps are lost and counted.

    Attributes:
        lost_steps: Transitions that could not become part of a whole sequence.
    """

    def __init__(self, spec: EnvironmentSpec, num_envs: int, steps: int) -> None:
        self.lost_steps = 0
        self._steps = steps
        self._rows = np.arange(num_envs)
        self._cursor = np.zeros(num_envs, np.intp)
        self._weights = np.zeros((num_envs, 2), np.int64)
        self._observation = np.zeros((num_envs, steps + 1, spec.observation_size), np.float32)
        self._action = np.zeros((num_envs, steps, spec.action_size), np.float32)
        self._reward = np.zeros((num_envs, steps), np.float32)
        self._discount = np.zeros((num_envs, steps), np.float32)
        self._log_prob = np.zeros((num_envs, steps), np.float32)

    def add(self, acted: Acted, transition: Transition, valid: NDArray[np.bool_]) -> list[Segment]:
        """Takes one step of every instance; returns the sequences that it finished.

        Args:
            acted: Before the step.
            transition: What the step gave.
            valid: Where it may be used; elsewhere the sequence under way is dropped, shape (N,).
        """
        self._put(acted, transition)
        self._forget(~valid)
        terminated = transition.ended & (transition.discount == 0.0)
        full = self._cursor == self._steps
        finished = valid & (full | terminated)
        segments = [self._finish(row) for row in np.flatnonzero(finished)]
        self._forget(valid & transition.ended & ~finished)
        return segments

    def _put(self, acted: Acted, transition: Transition) -> None:
        rows, at = self._rows, self._cursor
        self._weights[at == 0] = acted.weights_life, acted.weights_version
        self._observation[rows, at] = acted.observation
        self._observation[rows, at + 1] = transition.observation
        self._action[rows, at] = acted.action
        self._log_prob[rows, at] = acted.log_prob
        self._reward[rows, at] = transition.reward
        self._discount[rows, at] = transition.discount
        at += 1

    def _forget(self, where: NDArray[np.bool_]) -> None:
        self.lost_steps += int(self._cursor[where].sum())
        self._cursor[where] = 0

    def _finish(self, row: np.intp) -> Segment:
        end = self._cursor[row]
        self._cursor[row] = 0
        self._observation[row, end + 1 :] = self._observation[row, end]
        for array in (self._action, self._reward, self._discount, self._log_prob):
            array[row, end:] = 0.0
        return Segment(
            weights_life=int(self._weights[row, 0]),
            weights_version=int(self._weights[row, 1]),
            observation=self._observation[row].copy(),
            action=self._action[row].copy(),
            reward=self._reward[row].copy(),
            discount=self._discount[row].copy(),
            log_prob=self._log_prob[row].copy(),
        )
