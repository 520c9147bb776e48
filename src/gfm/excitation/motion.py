"""What a motion is: a reference for every joint, and where and how fast it may go.

Shape letters: N control periods, J joints.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array


class Purpose(StrEnum):
    """What a recording is for."""

    TRAINING = "training"
    HELDOUT = "heldout"


@dataclass(frozen=True, kw_only=True)
class JointRanges:
    """Where motions may go; every array has shape (J,).

    Attributes:
        joint_names: The joints.
        center: Where the shape of every motion begins and ends, rad.
        half_width: Motions stay within so much of the centre, rad.
        speed: They are at most so fast, rad/s.
        acceleration: They speed up and brake at most so hard, rad/s^2.
    """

    joint_names: tuple[str, ...]
    center: Array
    half_width: Array
    speed: Array
    acceleration: Array


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """How torques keep a joint on its reference.

    The command is torque + stiffness (q_reference - q) + damping (v_reference - v).

    Attributes:
        torque: That the model needs along the reference, N m, shape (N, J).
        stiffness: N m/rad, shape (J,).
        damping: N m s/rad, shape (J,).
    """

    torque: Array
    stiffness: Array
    damping: Array


@dataclass(frozen=True, kw_only=True)
class Motion:
    """One motion to drive and record.

    Attributes:
        name: Of the recording.
        purpose: Training or held out.
        kind: How it is commanded.
        joint_names: The joints.
        period_s: Between two commands.
        position: Reference at the beginning of every period, rad, shape (N, J).
        tracking: For a motion that is commanded as torques; None for the others.
    """

    name: str
    purpose: Purpose
    kind: CommandKind
    joint_names: tuple[str, ...]
    period_s: float
    position: Array
    tracking: Tracking | None = None

    def __post_init__(self) -> None:
        if (self.kind is CommandKind.EFFORT) != (self.tracking is not None):
            raise AssertionError("a motion has tracking torques if it is commanded as torques")

    @property
    def velocity(self) -> Array:
        """Mean reference velocity of every period, rad/s, shape (N, J)."""
        ahead = np.append(self.position[1:], self.position[-1:], axis=0)
        return np.asarray((ahead - self.position) / self.period_s)


#: From (ranges, times s of shape (N,), random numbers) to offsets from the centre, shape (N, J).
Shape = Callable[[JointRanges, Array, np.random.Generator], Array]


def minimum_jerk(share: Array) -> Array:
    """Returns how far a minimum-jerk move is, for the share of its time that has passed."""
    s = np.clip(share, 0.0, 1.0)
    return np.asarray(s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
