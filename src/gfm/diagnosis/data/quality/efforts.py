"""What a model says of the torques in a recording, and whether efforts can be those.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.quality.finding import Finding, finding
from gfm.diagnosis.data.signals import correlation
from gfm.diagnosis.search.candidates import torque_view
from gfm.sim.plant import Plant

#: Correlation that only the other sign explains.
OPPOSITE = -0.6


@dataclass(frozen=True, kw_only=True)
class Views:
    """Two opinions on the torques of a recording, N m, each of shape (T, J).

    Attributes:
        needed: By the model's inverse dynamics for the recorded motion.
        drive: By the law of the model's actuators for the recorded commands, those of the same
            stamps among them.
        drive_before: The same under the commands before those of the same stamps.
    """

    needed: Array
    drive: Array
    drive_before: Array


def views_of(recording: Trajectory, plant: Plant) -> Views:
    """Returns what the model says of a recording's torques, whatever its efforts say."""
    alone = replace(recording, effort=None)
    half_ns = int(np.median(np.diff(recording.stamp_ns))) // 2
    # A view has the mean command of half a period before and after a stamp.
    after, before = (torque_view(plant, _moved(alone, by_ns)) for by_ns in (-half_ns, half_ns))
    return Views(needed=after.needed, drive=after.drive, drive_before=before.drive)


def _moved(recording: Trajectory, by_ns: int) -> Trajectory:
    """Returns a recording whose commands came so much later."""
    return replace(recording, command_stamp_ns=recording.command_stamp_ns + by_ns)


def doubtful_efforts(recording: Trajectory, views: Views) -> list[Finding]:
    """Finds efforts that run against what the motion needs, in recordings that are not refused."""
    if recording.effort is None or not recording.gains.any():
        return []
    what = "correlation of effort and needed torque"
    advice = "is its sign or its gravity compensation not the model's?"
    pairs = enumerate(zip(recording.effort.T, views.needed.T, strict=True))
    needed = {j: correlation(*pair) for j, pair in pairs}
    return [
        finding(recording, what, alike, "", advice, joint=j)
        for j, alike in needed.items()
        if alike < OPPOSITE
    ]
