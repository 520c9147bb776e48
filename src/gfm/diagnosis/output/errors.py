"""Errors of open-loop rollouts before and after a correction.

Shape letters: T measurements of a segment, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.output.result import ErrorSummary, JointError, RecordingSummary
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.effects import EffectInstance


@dataclass(frozen=True, kw_only=True)
class RolloutErrors:
    """Position errors of the nominal and the corrected model, per segment (T, J), rad."""

    problem: Problem
    before: list[Array]
    after: list[Array]

    @property
    def summary(self) -> ErrorSummary:
        """The three numbers of the verdict."""
        return ErrorSummary(
            before=rms(self.before),
            after=rms(self.after),
            noise_floor=rms([self.problem.noise.position]),
        )

    @property
    def joints(self) -> tuple[JointError, ...]:
        """The same three numbers of every joint."""
        return tuple(
            JointError(
                joint=joint,
                before=rms([error[:, j] for error in self.before]),
                after=rms([error[:, j] for error in self.after]),
                noise_floor=float(self.problem.noise.position[j]),
            )
            for j, joint in enumerate(self.problem.joints)
        )

    def of_each(self, recordings: Sequence[Trajectory], role: str) -> list[RecordingSummary]:
        """Returns a line for each of the recordings that the segments are of."""
        owner = [segment.recording for segment in self.problem.segments]
        return [
            RecordingSummary(
                name=recording.name,
                role=role,
                command=str(recording.command_kind),
                duration_s=recording.duration_s,
                rate_hz=1.0 / recording.period_s,
                before=rms([e for e, own in zip(self.before, owner, strict=True) if own == i]),
                after=rms([e for e, own in zip(self.after, owner, strict=True) if own == i]),
            )
            for i, recording in enumerate(recordings)
        ]


def rollout_errors(
    problem: Problem,
    effects: Sequence[EffectInstance],
    begun: Callable[[Problem, Sequence[EffectInstance]], Problem] = Problem.settled,
) -> RolloutErrors:
    """Returns the errors of the nominal model and of that with `effects`.

    Args:
        problem: What is predicted.
        effects: The correction.
        begun: How rollouts begin under some effects: as fits best, unless it says otherwise.
    """
    before = begun(problem, ()).position_errors(())
    after = before
    if effects:
        suited = with_suitable_steps(problem, effects)
        after = begun(suited, effects).position_errors(effects)
    return RolloutErrors(problem=problem, before=before, after=after)


def as_measured(problem: Problem, effects: Sequence[EffectInstance]) -> Problem:
    """Returns a problem whose rollouts begin as measured: nothing of them is fitted away."""
    del effects
    return problem.as_measured()


def rms(parts: Sequence[Array]) -> float:
    """Returns the root mean square of all numbers in some arrays; NaN where there are none."""
    if not parts:
        return float("nan")
    return float(np.sqrt(np.mean(np.concatenate([part.ravel() for part in parts]) ** 2)))
