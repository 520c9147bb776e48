"""Commands that are the measurements themselves; needs NumPy alone, as importing does.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.signals.finding import Finding, findings

#: Measurements that equal the command, as a share, from which it is an echo; and how exactly.
ECHO, EXACTLY = 0.95, 1e-6


def echoed(recording: Trajectory) -> list[Finding]:
    """Finds commands that are the measurements themselves, a measurement earlier or later."""
    measured = {
        CommandKind.POSITION: recording.position,
        CommandKind.VELOCITY: recording.velocity,
        CommandKind.EFFORT: recording.effort,
    }[recording.command_kind]
    if measured is None:
        return []
    command = recording.held_command
    shares = {
        j: max(_equal(command[:, j], measured[:, j], shift) for shift in (-2, -1, 0, 1, 2))
        for j in np.flatnonzero(np.ptp(measured, axis=0) > 100.0 * EXACTLY).tolist()
    }
    echoes = {j: 100 * share for j, share in shares.items() if share > ECHO}
    advice = "the command looks like an echo of the measurement: record what the robot was told"
    return findings(recording, "command equals measurement", echoes, "%", advice)


def _equal(command: Array, measured: Array, shift: int) -> float:
    """Returns the share of changing measurements that equal the command `shift` rows on."""
    rolled = np.roll(command, shift)[3:-3]
    changing = np.diff(measured)[2:-3] != 0.0
    if changing.sum() < 20:
        return 0.0
    return float((np.abs(rolled - measured[3:-3]) < EXACTLY)[changing].mean())
