"""Errors of open-loop rollouts before and after a correction.

Shape letters: T measurements of a segment, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import WHOLE
from gfm.diagnosis.output.motion import Motion
from gfm.diagnosis.output.result import ErrorSummary, RecordingSummary
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.effects import EffectInstance
from gfm.signals.smoothing import rms


@dataclass(frozen=True, kw_only=True)
class RolloutErrors:
    """Position errors of the nominal and the corrected model, per segment (T, J), rad."""

    problem: Problem
    before: list[Array]
    after: list[Array]

    @property
    def summary(self) -> ErrorSummary:
        """The three numbers of the verdict."""
        return self._on(slice(None))

    @property
    def joints(self) -> dict[str, ErrorSummary]:
        """The same three numbers of every joint."""
        return {name: self._on(slice(j, j + 1)) for j, name in enumerate(self.problem.joints)}

    def _on(self, joints: slice) -> ErrorSummary:
        before, after = ([e[:, joints] for e in one] for one in (self.before, self.after))
        return error_summary(before, after, self.problem.noise.position[joints], "rad")

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

    def worst(self, recordings: Sequence[Trajectory]) -> Motion:
        """Returns the recording on which the nominal model errs most, beside both models.

        Its segments stand one behind the other: what lies between them (the robot touched
        something) is left out.
        """
        told = [one.before for one in self.of_each(recordings, "")]
        segments = self.problem.segments
        worst = max((s.recording for s in segments), key=lambda i: np.nan_to_num(told[i]))
        own = [i for i, segment in enumerate(segments) if segment.recording == worst]
        measured = np.concatenate([segments[i].position for i in own])
        return Motion(
            recording=recordings[worst].name,
            kind=recordings[worst].command_kind,
            joints=self.problem.joints,
            time_s=_one_behind_the_other([segments[i].time_s for i in own]),
            measured=measured,
            nominal=measured - np.concatenate([self.before[i] for i in own]),
            corrected=measured - np.concatenate([self.after[i] for i in own]),
            anew_s=WHOLE[recordings[worst].command_kind],
        )


def error_summary(
    before: Sequence[Array], after: Sequence[Array], noise: Array, unit: str
) -> ErrorSummary:
    """Returns root mean squares of errors under both models, and of the noise, in some unit."""
    return ErrorSummary(before=rms(before), after=rms(after), noise_floor=rms([noise]), unit=unit)


def rollout_errors(
    problem: Problem, effects: Sequence[EffectInstance], *, as_measured: bool = False
) -> RolloutErrors:
    """Returns the errors of the nominal model and of that with `effects`.

    Args:
        problem: What is predicted.
        effects: The correction.
        as_measured: Whether rollouts begin as measured: nothing of them is fitted away. Else they
            begin as fits best.
    """
    before = errors_under(problem, (), as_measured=as_measured)
    after = errors_under(problem, effects, as_measured=as_measured) if effects else before
    return RolloutErrors(problem=problem, before=before, after=after)


def errors_under(
    problem: Problem, effects: Sequence[EffectInstance], *, as_measured: bool = False
) -> list[Array]:
    """Returns the errors of the model with `effects` alone, see `rollout_errors`."""
    stepped = with_suitable_steps(problem, effects) if effects else problem
    begun = stepped.as_measured() if as_measured else stepped.settled(effects)
    return begun.position_errors(effects)


def _one_behind_the_other(times_s: Sequence[Array]) -> Array:
    """Returns times that each begin at 0 as one clock that goes on."""
    period_s = float(np.median(np.concatenate([np.diff(one) for one in times_s])))
    starts = np.cumsum([0.0, *(one[-1] + period_s for one in times_s[:-1])])
    return np.concatenate([start + one for start, one in zip(starts, times_s, strict=True)])
