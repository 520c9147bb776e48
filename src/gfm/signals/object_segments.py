"""Short segments in which the object moves: sliding by itself, and pushed.

Contacts are chaotic over long times: a segment ends when the object rests, when it is touched or
let go, or after a second. A push from rest is followed farther, and no longer than that: how it
begins is known, and how the object turns and drifts in it tells where its mass lies. What does not
move says nothing.

Shape letters: P poses, K time steps, R joints of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.effects.effect import MOTOR_SIDE
from gfm.signals.object_track import Track, in_plane, turned
from gfm.sim.object_stage import Setting, Stage, clearance, place
from gfm.sim.smoothing import smoothing_spline

#: Longest segments, s: of free sliding, of pushing, and of a push from rest.
LONGEST_FREE_S, LONGEST_PUSH_S, LONGEST_FROM_REST_S = 1.0, 0.5, 1.5
#: Shortest, s and poses.
SHORTEST_S, LEAST_POSES = 0.08, 6
#: Span of the polynomials from which speeds are taken, and of those at the start of a segment, s.
SPEED_S, START_S = 0.08, 0.15
#: The object moves from this speed on, m/s, or where it is more, from so many standard deviations.
SLOW_M_S, SLOW_SIGMAS = 0.01, 4.0
#: Time before a push, in which the robot comes near, and after the object came to rest, s.
BEFORE_S, AFTER_S = 0.12, 0.1
#: Distance between robot and object below which they may touch, m, beside the noise.
NEAR_M = 0.004
#: Time in which an object comes to lie on what is below it, s, how much speed is left after each
#: step meanwhile, and how much it may fall, m: what falls farther was held.
SEATING_S, SEATING_DECAY, MOST_FALL_M = 0.15, 0.9, 0.01
#: Least distance that the object covers in a segment, in standard deviations.
LEAST_MOTION = 8.0


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectSegment:
    """Some poses of one recording, and how they begin.

    Attributes:
        recording: Index of the recording.
        time_s: Of the poses since the start, shape (P,).
        plane: Measured, x y yaw, shape (P, 3).
        reference: The pose since which yaw is counted, shape (7,).
        setting: With which it is simulated.
        pushed: Whether the robot touches the object in it.
        place_error: Standard deviations of where it begins (x, y, yaw) if it begins at rest, shape
            (3,); None where place and speed are what its own poses tell.
        measured: The same as it was measured to begin, where that was fitted.
    """

    recording: int
    time_s: Array
    plane: Array
    reference: Array
    setting: Setting
    pushed: bool
    place_error: Array | None = None
    measured: ObjectSegment | None = None

    @property
    def unknowns(self) -> int:
        """How much of its beginning is unknown: places, and speeds where it does not rest."""
        return 6 if self.place_error is None else 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """One recording, ready to be cut.

    Attributes:
        index: Of the recording.
        recording: What was recorded.
        track: The object.
        stage: Of the nominal model.
        air: The same on which the robot touches nothing.
        noise: Of x, y (m) and yaw (rad), shape (3,).
    """

    index: int
    recording: Trajectory
    track: Track
    stage: Stage
    air: Stage
    noise: Array

    @cached_property
    def size(self) -> Array:
        """What turns x, y and yaw into distances, shape (3,)."""
        mass, inertia = self.stage.inertia
        return np.array([1.0, 1.0, np.sqrt(inertia / mass)])

    @cached_property
    def noise_m(self) -> float:
        """Of a pose, as a distance."""
        return float(np.linalg.norm(self.noise * self.size))

    @cached_property
    def period_s(self) -> float:
        """From one pose to the next."""
        return float(np.median(np.diff(self.track.time_s)))

    @property
    def half_window_s(self) -> float:
        """Half of the time over which a speed is taken."""
        return max(SPEED_S / 2.0, 2.5 * self.period_s)

    @property
    def slow_window_s(self) -> float:
        """The same where a slow motion is to be seen beside the noise of its poses."""
        noises = SLOW_SIGMAS * self.noise_m / SLOW_M_S
        return max(self.half_window_s, float(np.cbrt(1.5 * self.period_s * noises**2)))

    @property
    def within_m(self) -> float:
        """Distance below which robot and object may touch."""
        return NEAR_M + 4.0 * float(self.noise[0])

    @cached_property
    def distances_m(self) -> Array:
        """From robot to object at each pose, negative inside, twice `within_m` at most, (P,)."""
        far = 2.0 * self.within_m
        pairs = zip(self.robot_at(self.track.time_s), self.track.pose, strict=True)
        return np.array([clearance(self.stage, *pair, far) for pair in pairs])

    @property
    def touched(self) -> NDArray[np.bool_]:
        """At which poses the robot may touch the object, shape (P,)."""
        return self.distances_m < self.within_m

    @cached_property
    def pushed(self) -> NDArray[np.bool_]:
        """At which of these the object moves, be it slowly, shape (P,)."""
        return self.touched & _moving(self, self.slow_window_s)

    @cached_property
    def robot(self) -> BSpline:
        """The joints of the stage as functions of time, R of them."""
        return smoothing_spline(self.recording.time_s, _robot(self.recording, self.stage))

    def robot_at(self, time_s: Array) -> Array:
        """Returns the robot's joints, shape (..., R)."""
        return np.asarray(self.robot(np.clip(time_s, self.robot.t[0], self.robot.t[-1])))


def _robot(recording: Trajectory, stage: Stage) -> Array:
    """Returns the stage's joints as recorded, shape (T, R); others rest at their default.

    A motor moves with its link.
    """
    names = [stage.model.joint(int(stage.model.dof_jntid[d])).name for d in stage.dof]
    known = dict(zip(recording.joint_names, recording.position.T, strict=True))
    rest = np.tile(stage.model.qpos0[stage.qpos], (len(recording.position), 1)).T
    links = (name.removesuffix(MOTOR_SIDE) for name in names)
    return np.stack([known.get(*one) for one in zip(links, rest, strict=True)], axis=1)


def cut(scene: Scene) -> list[ObjectSegment]:
    """Returns the segments of a recording in which the object moves."""
    touched, moving = scene.touched, _moving(scene, scene.half_window_s) | scene.pushed
    changes = 1 + np.flatnonzero(np.diff(np.where(moving, 1 + touched, 0)))
    return [
        segment
        for first, last in pairwise([0, *changes.tolist(), len(moving)])
        if moving[first]
        for segment in _pieces(scene, first, last, pushed=bool(touched[first]))
    ]


def depth_m(scenes: Sequence[Scene]) -> float:
    """Returns how deep in the object the robot is for a quarter of the time in which it pushes, m.

    Nothing, where tool and object are where the model has them: no deeper than their noise.
    """
    every = np.concatenate([scene.distances_m[scene.pushed] for scene in scenes])
    return max(-float(np.percentile(every, 25)), 0.0) if len(every) else 0.0


def _moving(scene: Scene, half_window_s: float) -> NDArray[np.bool_]:
    """Returns at which poses the object moves as those around them show it, shape (P,)."""
    time_s, plane = scene.track.time_s, scene.track.plane
    speed = np.zeros(len(time_s))
    for i, now in enumerate(time_s):
        near = np.abs(time_s - now) <= half_window_s
        lapse = time_s[near] - time_s[near].mean()
        slope = lapse @ plane[near] / (lapse @ lapse)
        noise = scene.noise_m / np.sqrt(lapse @ lapse)
        fast = float(np.linalg.norm(slope * scene.size))
        speed[i] = fast / max(SLOW_M_S, SLOW_SIGMAS * noise)
    return np.asarray(speed > 1.0)


def _pieces(scene: Scene, first: int, last: int, *, pushed: bool) -> list[ObjectSegment]:
    """Returns the segments between two poses, between which the robot touches always or never."""
    time_s = scene.track.time_s
    start_s, end_s = float(time_s[first]), float(time_s[last - 1])
    longest, after = (LONGEST_PUSH_S, 0.0) if pushed else (LONGEST_FREE_S, AFTER_S)
    if not pushed:  # seen to move by what comes half a window later, and let go a little later
        start_s += scene.half_window_s
    elif _rests(scene, start_s):
        longest = LONGEST_FROM_REST_S
        start_s -= BEFORE_S
        end_s = min(end_s, start_s + longest)
    if end_s - start_s < SHORTEST_S:
        return []
    count = int(np.ceil((end_s + after - start_s) / longest))
    edges = np.linspace(start_s, end_s + after, count + 1)
    found = [_segment(scene, a, b, pushed=pushed) for a, b in pairwise(edges)]
    return [one for one in found if one is not None]


def _rests(scene: Scene, time_s: float) -> bool:
    """Returns whether the object rested just before."""
    before = (scene.track.time_s < time_s) & (scene.track.time_s > time_s - BEFORE_S)
    return bool(
        before.sum() >= 2 and np.all(np.ptp(scene.track.plane[before], axis=0) < 6.0 * scene.noise)
    )


def _segment(scene: Scene, start_s: float, end_s: float, *, pushed: bool) -> ObjectSegment | None:
    """Returns the poses between two times as a segment; None where they show nothing."""
    track, h = scene.track, scene.stage.timestep_s
    here = (track.time_s >= start_s - 1e-9) & (track.time_s <= end_s + 1e-9)
    if here.sum() < LEAST_POSES or end_s - start_s < SHORTEST_S:
        return None
    first = int(here.argmax())
    start_s = float(track.time_s[first])
    if moved(track.plane[here], scene.noise) < LEAST_MOTION:
        return None
    steps = int(np.ceil((end_s - start_s) / h)) + 1
    robot = scene.robot_at(np.asarray(start_s + h * np.arange(-1, steps + 1), np.float64))
    start, velocity, place_error = _start(scene, start_s, pushed=pushed)
    pose = turned(track.pose[first], start, track.plane[first])
    stage = scene.stage if pushed else scene.air
    seated = _seated(stage, Setting(pose=pose, velocity=np.zeros(6), robot=robot))
    if abs(seated[2] - pose[2]) > MOST_FALL_M:
        return None
    if not pushed:
        seated = turned(seated, start, in_plane(seated, track.pose[0]))
    return ObjectSegment(
        recording=scene.index,
        time_s=track.time_s[here] - start_s,
        plane=track.plane[here],
        reference=track.pose[0],
        setting=Setting(pose=seated, velocity=own_velocity(seated, velocity), robot=robot),
        pushed=pushed,
        place_error=place_error,
    )


def moved(plane: Array, noise: Array) -> float:
    """Returns how far an object moves along a path (P, 3), in units of its noise (3,)."""
    return float(np.max(np.ptp(plane, axis=0) / noise))


def _start(scene: Scene, start_s: float, *, pushed: bool) -> tuple[Array, Array, Array | None]:
    """Returns where the object is at a time in the plane, and how fast, shape (3,) each.

    By parabolas through what follows; or, where it rested, as it lay before, and how well that is
    known, shape (3,).
    """
    time_s, plane = scene.track.time_s, scene.track.plane
    if pushed and _rests(scene, start_s + BEFORE_S) and _rests(scene, start_s):
        before = (time_s <= start_s + BEFORE_S / 2.0) & (time_s > start_s - BEFORE_S)
        return plane[before].mean(axis=0), np.zeros(3), scene.noise / np.sqrt(before.sum())
    near = (time_s >= start_s - 1e-9) & (time_s <= start_s + START_S)
    degree = 2 if near.sum() > 4 else 1
    fit = np.polynomial.polynomial.polyfit(time_s[near] - start_s, plane[near], degree)
    return fit[0], fit[1], None


def own_velocity(pose: Array, velocity: Array) -> Array:
    """Returns a velocity in the plane as a free joint has it: rates about the body's own axes."""
    inverse, rate = np.empty(4), np.empty(3)
    mujoco.mju_negQuat(inverse, pose[3:])
    mujoco.mju_rotVecQuat(rate, np.array([0.0, 0.0, velocity[2]]), inverse)
    return np.concatenate([velocity[:2], [0.0], rate])


def _seated(stage: Stage, setting: Setting) -> Array:
    """Returns the pose in which the object lies on what is below it, the robot standing still.

    Measured poses float above the floor or are in it, by their noise and the calibration.
    """
    model, data = stage.model, mujoco.MjData(stage.model)
    place(stage, data, setting)
    for _ in range(int(SEATING_S / stage.timestep_s)):
        data.qvel[stage.dof] = 0.0
        data.qvel[stage.object_dof] *= SEATING_DECAY
        mujoco.mj_step(model, data)
    return np.array(data.qpos[stage.object_qpos])
