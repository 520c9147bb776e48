"""Whether two recordings hold the same measurements, under whatever name and with whatever stamps.

Shape letters: T measurements, J joints, W windows.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory

#: So many measurements in a row, a good part of them of a motion, that agree to the last digit: one
#: joint with a coarse encoder repeats short parts by chance, this long it does not.
WINDOW, MOVING = 40, 0.25
Number = TypeVar("Number", bound=np.generic)

#: Positions are compared to so many rad: conversions leave less behind.
DIGIT_RAD = 1e-9
#: A recording is another one's copy when it shares so much of its motion ...
COPY = 0.5
#: ... or overlaps it when so many measurements are the same, stamp and all.
OVERLAP = 10


def same_measurements(one: Trajectory, other: Trajectory) -> str:
    """Returns in which way two recordings are the same, or an empty text."""
    share = shared_share(one, other)
    if share > COPY:
        return f"{100 * share:.0f} % of the motion is the same to the last digit"
    count = shared_stamps(one, other)
    if count > OVERLAP:
        return f"{count} measurements of the motion have the same stamps and values"
    return ""


def shared_share(one: Trajectory, other: Trajectory) -> float:
    """Returns the share of the shorter one's motion that the other one holds as well, 0..1.

    Compares windows of positions of the joints that both have, wherever they lie in time.
    """
    joints = [name for name in one.joint_names if name in other.joint_names]
    if not joints:
        return 0.0
    short, long = sorted((one, other), key=lambda r: len(r.stamp_ns))
    rows = [_positions(r, joints) for r in (short, long)]
    if min(len(r) for r in rows) < WINDOW:
        return 0.0
    numbers = np.unique(np.concatenate(rows), axis=0, return_inverse=True)[1].ravel()
    first, second = np.split(numbers, [len(rows[0])])
    moving = _windows(np.diff(first, prepend=first[0]) != 0).mean(axis=1) > MOVING
    if not moving.any():
        return 0.0
    return float(np.isin(_fingerprints(first)[moving], _fingerprints(second)).mean())


def _positions(recording: Trajectory, joints: list[str]) -> NDArray[np.int64]:
    columns = [recording.joint_names.index(name) for name in joints]
    return np.rint(recording.position[:, columns] / DIGIT_RAD).astype(np.int64)


def _windows(values: NDArray[Number]) -> NDArray[Number]:
    return np.lib.stride_tricks.sliding_window_view(values, WINDOW)


def _fingerprints(numbers: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Returns one number for each window, the same for the same rows, shape (W,)."""
    factors = np.random.default_rng(0).integers(1, 2**63, WINDOW, dtype=np.uint64) | np.uint64(1)
    return np.asarray(_windows(numbers.astype(np.uint64) + np.uint64(1)) @ factors)


def shared_stamps(one: Trajectory, other: Trajectory) -> int:
    """Returns how many measurements of a motion both recordings hold under the same stamps.

    None where values at common stamps differ, or where both begin with the same stamp: clocks that
    start with the recording say nothing of when it was.
    """
    joints = [name for name in one.joint_names if name in other.joint_names]
    _, a, b = np.intersect1d(one.stamp_ns, other.stamp_ns, return_indices=True)
    if not joints or not len(a) or one.stamp_ns[0] == other.stamp_ns[0]:
        return 0
    first, second = _positions(one, joints)[a], _positions(other, joints)[b]
    same = (first == second).all(axis=1)
    return int(same[1:][(np.diff(first, axis=0) != 0).any(axis=1)].sum()) if same.all() else 0
