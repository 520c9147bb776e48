"""Films of one target before and after: drawn from what the robot reported."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gfm.api.films.renderer import NoFilmError
from gfm.api.recordings import read_recordings
from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.envs.matching_task import MatchingTask
from gfm.experiments.attempts import Attempt
from gfm.experiments.film import write_film

#: How an attempt ends that succeeds.
REACHED = "reached"


def pair_to_show(before: Sequence[Attempt], after: Sequence[Attempt]) -> tuple[Attempt, Attempt]:
    """Returns attempts from the same start at the same goal: the first that only the later reached.

    Where there is none of that, the first of all.
    """
    later = {(one.goal, one.trial): one for one in after}
    pairs = [(one, other) for one in before if (other := later.get((one.goal, one.trial)))]
    helped = [p for p in pairs if p[0].outcome != REACHED and p[1].outcome == REACHED]
    return (helped or pairs)[0]


def film(path: Path, task: MatchingTask, arm: ArmProblem, attempt: Attempt) -> str:
    """Writes the film of an attempt as it was recorded; returns why there is none, or nothing.

    Args:
        path: Where to.
        task: What was tried.
        arm: The cell by which the arm is drawn.
        attempt: With its recording.
    """
    if not Path(attempt.recording).is_file():
        return f"no film: {attempt.recording or 'a recording'} is not there"
    (recording,) = read_recordings([Path(attempt.recording)])
    goal = task.radial_goals()[attempt.goal]
    try:
        shown = positions(recording, arm, attempt.steps)
        write_film(path, arm.nominal, shown, goal, task.tolerance_m)
    except NoFilmError as error:
        return str(error)
    return ""


def positions(recording: Trajectory, arm: ArmProblem, steps: int) -> Array:
    """Returns the positions of arm and object in every control period, shape (S, nq).

    Joints as measured; the object in the newest pose that was seen until then.
    """
    at_s = CONTROL_PERIOD_S * np.arange(steps)
    at_s = at_s[at_s <= recording.time_s[-1]]
    joints = [np.interp(at_s, recording.time_s, column) for column in recording.position.T]
    track = recording.object_track
    if track is None:
        raise NoFilmError(f"{recording.name} has no poses of an object")
    seen_s = 1e-9 * (track.stamp_ns - recording.stamp_ns[0])
    newest = np.maximum(np.searchsorted(seen_s, at_s, side="right") - 1, 0)
    poses = np.hstack([track.position, track.quaternion])[newest]
    return arm.model.layout.as_qpos(np.stack(joints, axis=1), poses)
