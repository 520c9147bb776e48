"""What planned motions would leave in the dark, were the robot to follow them."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.excitation.blind_spots import BlindSpot, blind_spots
from gfm.excitation.limits import EFFORT_SHARE, RobotLimits
from gfm.excitation.motion import Motion


def unseen(
    motions: Sequence[tuple[Motion, Array]], limits: RobotLimits, effects: Collection[str]
) -> tuple[BlindSpot, ...]:
    """Returns which of `effects` (of all, where none is named) motions could not show.

    Args:
        motions: Each with the torques that it takes, N m, shape (N, J).
        limits: Of the robot.
        effects: That the motions are there for, by name.
    """
    columns = [limits.joint_names.index(name) for name in limits.moving]
    recordings = [_followed(motion, torque, columns) for motion, torque in motions]
    most = {
        limits.joint_names[j]: float(limits.effort[j]) / EFFORT_SHARE
        for j in columns
        if np.isfinite(limits.effort[j])
    }
    spots = blind_spots(recordings, most)
    return tuple(spot for spot in spots if not effects or spot.effect in effects)


def _followed(motion: Motion, torque: Array, columns: Sequence[int]) -> Trajectory:
    """Returns the recording of a robot that follows a motion exactly."""
    stamp_ns = np.rint(1e9 * motion.period_s * np.arange(len(motion.position))).astype(np.int64)
    position = motion.position[:, columns]
    return Trajectory(
        name=motion.name,
        joint_names=tuple(motion.joint_names[j] for j in columns),
        stamp_ns=stamp_ns,
        position=position,
        velocity=None,
        effort=torque[:, columns],
        command_kind=motion.kind,
        command_stamp_ns=stamp_ns,
        command=position,
    )
