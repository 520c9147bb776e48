"""A stretch of a recording beside what the nominal and the corrected model make of it.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import WHOLE, in_model_order, make_problem
from gfm.diagnosis.output.errors import rollout_errors
from gfm.diagnosis.output.result import RecordingSummary
from gfm.effects import EffectInstance, Scope
from gfm.sim.passive import with_idle_drives


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Joint positions of the robot and of open-loop rollouts under the commands that it got.

    Attributes:
        recording: Its name.
        kind: Of its commands.
        joints: Names.
        time_s: From the beginning of what is told, increasing, shape (T,).
        measured: rad (m where a joint slides), shape (T, J).
        nominal: By the model as it was given, likewise.
        corrected: By the model with the named effects, likewise.
        anew_s: After which a rollout begins anew as measured; infinity where it is one.
    """

    recording: str
    kind: CommandKind
    joints: tuple[str, ...]
    time_s: Array
    measured: Array
    nominal: Array
    corrected: Array
    anew_s: float

    def stretch(self, length_s: float) -> Motion:
        """Returns the part of about so long, s, in which the nominal model is furthest off."""
        steps = max(int(np.searchsorted(self.time_s, length_s)), 1)
        squares = np.sum((self.nominal - self.measured) ** 2, axis=1)
        running = np.concatenate([[0.0], np.cumsum(squares)])
        start = int(np.argmax(running[steps:] - running[:-steps])) if len(squares) > steps else 0
        here = slice(start, start + steps)
        return Motion(
            recording=self.recording,
            kind=self.kind,
            joints=self.joints,
            time_s=self.time_s[here] - self.time_s[start],
            measured=self.measured[here],
            nominal=self.nominal[here],
            corrected=self.corrected[here],
            anew_s=self.anew_s,
        )


def worst_held_out(
    recordings: Sequence[Trajectory], told: Sequence[RecordingSummary]
) -> Trajectory:
    """Returns the held-out recording on which the nominal model errs most.

    Args:
        recordings: The held-out ones.
        told: Errors on all recordings.
    """
    errors = {one.name: one.before for one in told if one.role == "held-out"}
    return max(recordings, key=lambda one: np.nan_to_num(errors.get(one.name, 0.0)))


def motion_along(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recording: Trajectory,
    effects: Sequence[EffectInstance],
    given: Sequence[EffectInstance] = (),
) -> Motion:
    """Returns a recording beside both models, over the stretches on which errors are told.

    Stretches stand one behind the other: what lies between them (the robot touched something) is
    left out.

    Args:
        specs: The nominal model by kind of command.
        recording: Whose commands are followed.
        effects: The correction; what it says of a pushed object is left out.
        given: Effects of the nominal model that `specs` cannot say.
    """
    driven, (run,) = with_idle_drives(specs, in_model_order(specs, [recording]))
    robot = [one for one in effects if one.effect.scope is not Scope.OBJECT]
    problem = make_problem(driven, [run], given=given, windows_s=WHOLE, placed=robot)
    errors = rollout_errors(problem, robot)
    segments = errors.problem.segments
    measured = np.concatenate([one.position for one in segments])
    return Motion(
        recording=recording.name,
        kind=run.command_kind,
        joints=run.joint_names,
        time_s=_one_behind_the_other([one.time_s for one in segments]),
        measured=measured,
        nominal=measured - np.concatenate(errors.before),
        corrected=measured - np.concatenate(errors.after),
        anew_s=WHOLE[run.command_kind],
    )


def _one_behind_the_other(times_s: Sequence[Array]) -> Array:
    """Returns times that each begin at 0 as one clock that goes on."""
    period_s = float(np.median(np.concatenate([np.diff(one) for one in times_s])))
    starts = np.cumsum([0.0, *(one[-1] + period_s for one in times_s[:-1])])
    return np.concatenate([start + one for start, one in zip(starts, times_s, strict=True)])
