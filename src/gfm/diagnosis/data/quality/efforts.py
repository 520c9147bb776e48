"""What a model says of the torques in a recording, and whether efforts can be those.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.quality.finding import Finding, findings
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
    after, before = (
        torque_view(plant, replace(alone, command_stamp_ns=alone.command_stamp_ns + later_ns))
        for later_ns in (-half_ns, half_ns)
    )
    return Views(needed=after.needed, drive=after.drive, drive_before=before.drive)


def doubtful_efforts(recording: Trajectory, views: Views) -> list[Finding]:
    """Finds efforts that run against what the motion needs, in recordings that are not refused."""
    if recording.effort is None or not recording.gains.any():
        return []
    pairs = zip(recording.effort.T, views.needed.T, strict=True)
    alike = {j: correlation(*pair) for j, pair in enumerate(pairs)}
    against = {j: one for j, one in alike.items() if one < OPPOSITE}
    advice = "is its sign or its gravity compensation not the model's?"
    return findings(recording, "correlation of effort and needed torque", against, "", advice)
