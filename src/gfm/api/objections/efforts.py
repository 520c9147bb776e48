"""Whether efforts can be the torques of the drives: their sign, and whether they have one.

Two views that share nothing but the motion must agree before an effort is refused: what the model's
inverse dynamics needs (it knows masses, not servos), and what the model's actuators would do under
the recorded commands (they know gains, not masses). Either alone may be misled: the first by an
effort that leaves out a gravity compensation, the second by gains that are far from the robot's.

An effort may have been measured just before the command of its own stamp, or just after: a stiff
servo that gets few commands pushes after each and brakes before the next. One whose commands arrive
late is measured anywhere between: what it was asked for is then many times what it gave, and says
nothing of the sign.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from gfm.api.objections.objection import Objection
from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.signals.limits import OPPOSITE
from gfm.signals.smoothing import correlation, smooth_states
from gfm.signals.torques import TorqueView

#: How many times larger than the other a torque that is measured, or asked for, is at most.
COMPARABLE = 3.0
#: Share of the time in which the sign must be wanted negative for its absence to tell.
WANTED = 0.1
#: An effort without sign comes close to zero again and again: so often, so close to its greatest.
NEAR_ZERO_SHARE, NEAR_ZERO = 0.01, 0.05


#: What the model says under the commands of the same stamps, and under those before.
Views: TypeAlias = tuple[TorqueView, TorqueView]


def wrong_effort(recording: Trajectory, views: Views) -> Objection | None:
    """Objects to efforts of the opposite sign, and to efforts without one: see `views_of`."""
    if recording.effort is None or not recording.gains.any():
        return None
    return _unsigned(recording, recording.effort, views) or _opposite(
        recording, recording.effort, views
    )


def _opposite(recording: Trajectory, effort: Array, views: Views) -> Objection | None:
    for j, name in enumerate(recording.joint_names):
        needed, drive = _agreement(effort[:, j], views, j)
        if max(needed, drive) < OPPOSITE and _comparable(effort[:, j], views[0].drive[:, j]):
            return Objection(
                where=f"effort of {name}",
                problem="runs against what the motion needs and what the command asks for "
                f"(correlations {needed:.2f} and {drive:.2f})",
                expected="torque that is positive where it pushes the joint's position up (turn "
                "its sign)",
            )
    return None


def _unsigned(recording: Trajectory, effort: Array, views: Views) -> Objection | None:
    """Objects where no joint's effort is ever negative although some must have been."""
    if (effort < 0.0).any():
        return None
    _, velocity, _ = smooth_states(recording.time_s, recording.position)
    view, before = views
    drive = np.maximum(view.drive, before.drive)
    down = (view.needed < 0.0) & (drive < 0.0) & (velocity < 0.0)
    close = effort < NEAR_ZERO * np.percentile(effort, 99.0, axis=0)
    for j in np.flatnonzero((down.mean(axis=0) > WANTED) & (close.mean(axis=0) > NEAR_ZERO_SHARE)):
        return Objection(
            where="effort",
            problem=f"is never negative, although {recording.joint_names[j]} is pushed down in "
            f"{100 * down[:, j].mean():.0f} % of the time",
            expected="signed torques (a motor current without sign is no effort: leave the field "
            "empty)",
        )
    return None


def _agreement(effort: Array, views: Views, joint: int) -> tuple[float, float]:
    """Returns the correlation of one joint's effort with what is needed, and with the drive.

    With the drive before the command of the same stamp where it clearly is that.
    """
    needed = correlation(effort, views[0].needed[:, joint])
    same, before = (correlation(effort, view.drive[:, joint]) for view in views)
    return needed, before if before > -OPPOSITE else same


def _comparable(measured: Array, asked: Array) -> bool:
    sizes = float(np.std(measured)), float(np.std(asked))
    return max(sizes) <= COMPARABLE * min(sizes)
