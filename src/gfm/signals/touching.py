"""Where a robot touches something and an object rests.

A model of an arm is judged by its motion in the air: how far two things are in each other decides
about their forces, and no measurement is as exact. Where a robot touches something, segments begin
while it does not and the object rests.

Shape letters: T measurements of a recording, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.effects import EffectInstance
from gfm.sim.plant import make_plant

#: Way of an object from which on it slides, within so much time.
SLIDING_M, SLIDING_S = 2e-3, 0.1
#: Times around a segment's first moment in which the pose of what rests is averaged, longest first.
RESTING_S = (0.5, 0.2, 0.05)
#: Places along a recording at which contacts are looked for, and where there are some, time between
#: two looks, s.
CONTACT_LOOKS, LOOK_S = 300, 0.01
#: Gap below which what is not of the robot counts as touched: models and poses err by as much.
CLEARANCE_M = 5e-3
#: Shortest motion in the air that tells something, and how much of it judges an arm by itself, s.
LEAST_AIR_S, ENOUGH_AIR_S = 0.3, 1.5


class Touch:
    """Looks for contacts of the robot, as recorded.

    Args:
        spec: The model.
        joints: That are measured.
        placed: Effects of the robot; of them counts what says that links are elsewhere than
            reported.
    """

    def __init__(
        self, spec: mujoco.MjSpec, joints: Sequence[str], placed: Sequence[EffectInstance] = ()
    ) -> None:
        displacing = [one for one in placed if one.effect.displaces]
        self._plant = make_plant(spec, joints, displacing)
        model = self._plant.model
        self._data = mujoco.MjData(model)
        self._free = model.jnt_qposadr[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]
        moved = model.dof_bodyid[self._plant.dof]
        tree = model.body_treeid[model.geom_bodyid]
        self._robot = np.isin(tree, model.body_treeid[moved])
        stands = ~self._robot & ~np.isin(model.geom_bodyid, _carriers(model, moved))
        model.geom_margin[stands] = np.maximum(model.geom_margin[stands], CLEARANCE_M)

    def at(self, recording: Trajectory, row: int) -> bool:
        """Returns whether it touches anything at one measurement, or nearly."""
        model, data = self._plant.model, self._data
        data.qpos[self._plant.qpos] = recording.position[row]
        pose = object_pose(recording, int(recording.stamp_ns[row]))
        if pose is not None and len(self._free) == 1:
            data.qpos[self._free[0] : self._free[0] + 7] = pose
        mujoco.mj_fwdPosition(model, data)
        return bool(self._robot[data.contact.geom[: data.ncon]].any())

    def along(self, recording: Trajectory) -> NDArray[np.bool_]:
        """Returns whether it touches anything at each measurement, or nearly, shape (T,)."""
        rows = np.arange(len(recording.position))
        few = rows[:: max(len(rows) // CONTACT_LOOKS, 1)]  # looking at every step takes time
        if not any(self.at(recording, row) for row in few.tolist()):
            return np.zeros(len(rows), dtype=bool)
        step = max(round(LOOK_S / recording.period_s), 1)
        looked = np.array([self.at(recording, row) for row in rows[::step].tolist()])
        return np.asarray(np.repeat(looked, step)[: len(rows)])


def _carriers(model: mujoco.MjModel, bodies: Array) -> list[int]:
    """Returns the bodies that carry some bodies and stand still: a pedestal is of the robot."""
    carriers, body = list[int](), int(model.body_parentid[bodies[0]])
    while body:
        carriers.append(body)
        body = int(model.body_parentid[body])
    return carriers


def in_the_air(touching: NDArray[np.bool_], recording: Trajectory) -> list[tuple[int, int]]:
    """Returns from which row to which a robot touches nothing, for long enough to tell something.

    Args:
        touching: Whether it touches something, shape (T,).
        recording: At whose measurements.
    """
    if not touching.any():
        return [(0, len(touching))]
    edges = np.flatnonzero(np.diff(np.concatenate([[True], touching, [True]]).astype(np.int8)))
    pieces = [(int(start), int(end)) for start, end in edges.reshape(-1, 2)]
    time_s = recording.time_s
    return [(start, end) for start, end in pieces if time_s[end - 1] - time_s[start] >= LEAST_AIR_S]


def surely_in_the_air(
    touches: Sequence[NDArray[np.bool_]], recordings: Sequence[Trajectory]
) -> list[list[tuple[int, int]]]:
    """Returns those pieces of each recording in which a robot is surely in the air.

    Where a robot touches something is told by a model that may have tool or object elsewhere. So
    recordings in which it touches nothing say more of it than pieces of others: those are left out
    where there is as much without them, and enough.

    Args:
        touches: Whether it touches something, at each measurement of each recording.
        recordings: At whose measurements.
    """
    air = [in_the_air(*both) for both in zip(touches, recordings, strict=True)]
    clear = [[] if there.any() else one for there, one in zip(touches, air, strict=True)]
    clear_s = seconds(clear, recordings)
    others_s = seconds(air, recordings) - clear_s
    return clear if clear_s >= max(others_s, ENOUGH_AIR_S) else air


def seconds(pieces: Sequence[Sequence[tuple[int, int]]], recordings: Sequence[Trajectory]) -> float:
    """Returns how long pieces of recordings last together, s."""
    return sum(
        float(run.time_s[end - 1] - run.time_s[start])
        for run, rows in zip(recordings, pieces, strict=True)
        for start, end in rows
    )


def at_ease(touch: Touch, recording: Trajectory, edges: Array) -> Array:
    """Returns edges moved to the next row at which nothing is touched and an object rests.

    One that has none before the next edge is left out; the first one stays then.
    """

    def is_at_ease(row: int) -> bool:
        return not (_slides(recording, int(recording.stamp_ns[row])) or touch.at(recording, row))

    moved = [next(filter(is_at_ease, range(*ends)), None) for ends in pairwise(edges.tolist())]
    kept = [row for row in moved if row is not None]
    first = [] if moved[0] is not None else [0]
    return np.array([*first, *kept, edges[-1]])


def object_pose(recording: Trajectory, stamp_ns: int) -> Array | None:
    """Returns the recorded pose of the object next to a time, shape (7,); None where none is."""
    track = recording.object_track
    if track is None or not len(track.stamp_ns):
        return None
    nearest = int(np.argmin(np.abs(track.stamp_ns - stamp_ns)))
    return np.concatenate([track.position[nearest], track.quaternion[nearest]])


def resting_pose(recording: Trajectory, stamp_ns: int) -> Array | None:
    """Returns the mean pose around a time if the object rests there, else the one next to it.

    A tenth of a millimetre decides whether something is touched or missed. None where no pose is
    known.
    """
    track, pose = recording.object_track, object_pose(recording, stamp_ns)
    if track is None or pose is None or _slides(recording, stamp_ns):
        return pose
    for reach_s in RESTING_S:
        near = np.abs(track.stamp_ns - stamp_ns) <= 1e9 * reach_s
        place = track.position[near]
        if len(place) and np.linalg.norm(place[-1] - place[0]) <= SLIDING_M:
            turned = track.quaternion[near]
            turned = turned * np.sign(turned @ pose[3:])[:, None]  # q and -q are one rotation
            mean = turned.mean(axis=0)
            return np.concatenate([place.mean(axis=0), mean / np.linalg.norm(mean)])
    return pose


def _slides(recording: Trajectory, stamp_ns: int) -> bool:
    """Returns whether an object moves around a time."""
    half_ns = int(0.5e9 * SLIDING_S)
    poses = [object_pose(recording, stamp_ns + shift) for shift in (-half_ns, half_ns)]
    if poses[0] is None or poses[1] is None:
        return False
    return bool(np.linalg.norm(poses[1][:3] - poses[0][:3]) > SLIDING_M)
