"""How soon a joint at rest answers a step of its command: dead time, whatever the model says else.

Where a model stays far from its recordings, rollouts trade a delay for whatever else slows an
answer down: an inertia or a damping that is not the robot's, a servo that is no spring. The very
first movement does not: a joint at rest goes by a t^2 / 2 whatever pulls it, and the line through
the roots of its first displacements meets zero where the pull began. Compared with the same of a
prediction, at the same stamps, what is left is dead time that the model lacks.

Shape letters: T measurements of a stretch, J joints, A answers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import median_abs_deviation

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import between
from gfm.diagnosis.residuals.problem import Noise, Problem
from gfm.effects import EffectInstance
from gfm.sim.segment import Prediction, Segment

#: Time for which a command stood still before its step, and after which nothing is an answer, s.
#: What seems to have begun before the step by more than stamps may err did not wait for it.
REST_S, ANSWER_S, EARLIEST_S = 0.3, 0.15, -0.02
#: Share of a step by which the command may stray in that time.
STRAY = 0.1
#: Displacement that is no noise, and that up to which an answer is looked at, in its units; so much
#: a joint at rest may seem to move.
SEEN, LOOKED_AT, RESTING = 6.0, 40.0, 6.0
#: Answers that are needed, and that are looked at, at most.
LEAST_ANSWERS, MOST_ANSWERS = 8, 48
#: Lateness that is dead time: so many of its standard errors, and so many seconds.
ERRORS, LEAST_S = 3.0, 2e-3
#: Standard error of a median of normal numbers, in units of that of their mean.
MEDIAN = 1.25


@dataclass(frozen=True, kw_only=True)
class Answer:
    """A joint that answers a step of its command from rest.

    Attributes:
        joint: Number of the joint.
        step_s: When the command stepped, in the time of the stretch.
        up: 1 where it did to larger values, else -1.
        after_s: Measured dead time.
    """

    joint: int
    step_s: float
    up: float
    after_s: float


@dataclass(frozen=True, kw_only=True)
class Answers:
    """Answers to steps.

    Attributes:
        problem: In whose stretches they are, one in each.
        answers: One by one, A of them.
    """

    problem: Problem
    answers: tuple[Answer, ...]

    def late_s(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns by how much later than predicted each answer comes, s, shape (candidates, A).

        A prediction that does not answer in time counts as one that does at the end of it.
        """
        measured_s = np.array([answer.after_s for answer in self.answers])
        told = [self._predicted_s(one) for one in self.problem.predictions(candidates)]
        return measured_s - np.nan_to_num(told, nan=ANSWER_S)

    def _predicted_s(self, predictions: Sequence[Prediction]) -> list[float]:
        rows = zip(self.answers, self.problem.segments, predictions, strict=True)
        noise = self.problem.noise.position
        return [
            dead_time_s(s.time_s, p.position[:, a.joint], a.step_s, a.up, float(noise[a.joint]))
            for a, s, p in rows
        ]

    @property
    def by_joint(self) -> list[list[int]]:
        """Which answers are those of each joint that has some, by their numbers."""
        joints = [answer.joint for answer in self.answers]
        return [[i for i, j in enumerate(joints) if j == one] for one in sorted(set(joints))]


def dead_time(late_s: Array, by_joint: Sequence[Sequence[int]]) -> float | None:
    """Returns the dead time that all joints share, s; None where answers show none.

    Args:
        late_s: By how much later than predicted each answer comes, s, shape (A,).
        by_joint: Which of them are those of each joint.
    """
    if len(late_s) < LEAST_ANSWERS:
        return None
    common_s = float(np.median(late_s))
    error_s = MEDIAN * median_abs_deviation(late_s, scale="normal") / np.sqrt(len(late_s))
    if common_s < max(ERRORS * error_s, LEAST_S):
        return None
    shared = all(np.median(late_s[list(rows)]) > 0.0 for rows in by_joint)
    return common_s if shared else None


def find_answers(problem: Problem, recordings: Sequence[Trajectory]) -> Answers:
    """Returns the answers to steps in recordings of servos, each in a stretch of its own."""
    found = [
        pair
        for index, recording in enumerate(recordings)
        for joint, row in _steps(recording)
        if (pair := _answer(problem.noise, recording, index, joint, row)) is not None
    ]
    some = np.linspace(0, max(len(found) - 1, 0), min(len(found), MOST_ANSWERS)).astype(int)
    return Answers(
        problem=replace(
            problem,
            segments=tuple(found[i][0] for i in some),
            state_basis=(),
            outlying_from=None,
        ),
        answers=tuple(found[i][1] for i in some),
    )


def _answer(
    noise: Noise, recording: Trajectory, index: int, joint: int, row: int
) -> tuple[Segment, Answer] | None:
    """Returns the answer of a joint to a command, and its stretch; None where none is seen."""
    time_s, step_s = recording.time_s, float(recording.command_time_s[row])
    first, end = np.searchsorted(time_s, [step_s - REST_S, step_s + ANSWER_S])
    cut = between(recording, index, noise, [(int(first), int(end))])
    if not cut:
        return None
    at_s = step_s - float(time_s[first])
    position, sigma = cut[0].position[:, joint], float(noise.position[joint])
    up = float(np.sign(recording.command[row, joint] - recording.command[row - 1, joint]))
    after_s = dead_time_s(cut[0].time_s, position, at_s, up, sigma)
    if not np.isfinite(after_s) or np.ptp(position[cut[0].time_s <= at_s]) > RESTING * sigma:
        return None
    return cut[0], Answer(joint=joint, step_s=at_s, up=up, after_s=after_s)


def _steps(recording: Trajectory) -> Iterator[tuple[int, int]]:
    """Yields joint and number of every command that steps, with rest before and after it."""
    if recording.command_kind is CommandKind.EFFORT:
        return
    time_s = recording.command_time_s
    for joint, name in enumerate(recording.joint_names):
        if recording.servo_gain.get(name, 1.0) == 0.0:
            continue
        size = np.abs(np.diff(recording.command[:, joint], prepend=recording.command[0, joint]))
        strayed = np.cumsum(size)
        rows = np.flatnonzero((size > 0.0) & (time_s - time_s[0] >= REST_S))
        before = np.searchsorted(time_s, time_s[rows] - REST_S)
        after = np.searchsorted(time_s, time_s[rows] + ANSWER_S)
        around = strayed[after - 1] - strayed[np.maximum(before - 1, 0)] - size[rows]
        for row in rows[around <= STRAY * size[rows]]:
            yield joint, int(row)


def dead_time_s(time_s: Array, position: Array, step_s: float, up: float, noise: float) -> float:
    """Returns how long after a step a joint at rest begins to move, s; NaN where none is seen.

    Args:
        time_s: shape (T,).
        position: rad, shape (T,).
        step_s: When the command stepped.
        up: In which direction, 1 or -1.
        noise: Standard deviation of the measured position, rad.
    """
    resting = time_s <= step_s
    if not resting.any():
        return float("nan")
    moved = up * (position - position[resting][-3:].mean())
    seen = np.flatnonzero(~resting & (moved > SEEN * noise))
    if not len(seen):
        return float("nan")
    first = int(seen[0])
    far = np.flatnonzero(moved[first:] > LOOKED_AT * noise)
    end = max(first + (int(far[0]) if len(far) else len(moved)), first + 1) + 1
    roots, times = np.sqrt(np.maximum(moved[first:end], 0.0)), time_s[first:end]
    if len(roots) < 2:
        return float("nan")
    slope, offset = np.polyfit(times, roots, 1)
    after_s = float(-offset / slope - step_s) if slope > 0.0 else float("nan")
    return after_s if after_s > EARLIEST_S else float("nan")
