"""A recording, resampled to the control periods of a hybrid model.

Shape letters: K control periods, S integration steps in each, J joints, T times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.interpolate import BSpline

from gfm.core import CommandKind, RecordingError, Trajectory
from gfm.core.checks import Array
from gfm.sim.hybrid import HybridModel
from gfm.sim.layout import Layout
from gfm.sim.smoothing import LEAST_SAMPLES, smoothing_spline


@dataclass(frozen=True, kw_only=True)
class Motion:
    """The recorded motion as functions of time, s since the first measurement.

    Velocities are those of the smoothed positions, so that both belong together.
    """

    layout: Layout
    nv: int
    joints: BSpline
    free_object: BSpline | None

    def qpos(self, time_s: Array) -> Array:
        """Returns positions, shape (T, nq)."""
        if self.free_object is None:
            return self.layout.as_qpos(self.joints(time_s))
        pose = self.free_object(time_s)
        pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
        return self.layout.as_qpos(self.joints(time_s), pose)

    def qvel(self, time_s: Array) -> Array:
        """Returns velocities, the object's angular one in its own frame, shape (T, nv)."""
        joints = self.joints(time_s, nu=1)
        if self.free_object is None:
            return self.layout.as_qvel(self.nv, joints)
        quaternion, rate = self.free_object(time_s)[:, 3:], self.free_object(time_s, nu=1)
        angular = _body_rate(quaternion, rate[:, 3:])
        return self.layout.as_qvel(self.nv, joints, np.hstack([rate[:, :3], angular]))


@dataclass(frozen=True, kw_only=True)
class Replay:
    """What happened in each control period; the first begins with a command.

    Attributes:
        name: Of the recording.
        kind: What the commands are.
        model: With the recording's servo gains.
        start_s: Of the first period, since the first measurement.
        motion: The recorded motion at any time.
        qpos: At the start of each period and the end of the last, shape (K + 1, nq).
        qvel: The same, shape (K + 1, nv).
        command: In force at each integration step; one more period where the recording ends within
            one, shape (K or K + 1, S, J).
    """

    name: str
    kind: CommandKind
    model: mujoco.MjModel
    start_s: float
    motion: Motion
    qpos: Array
    qvel: Array
    command: Array

    @property
    def periods(self) -> int:
        """K."""
        return len(self.qpos) - 1


def make_replay(model: HybridModel, trajectory: Trajectory) -> Replay:
    """Returns `trajectory` at the model's control periods.

    Raises:
        RecordingError: other joints than the model's, no object where the model has one, or too
            short for a single period.
    """
    motion = make_motion(model, trajectory)
    later = trajectory.command_time_s[trajectory.command_time_s >= 0.0]
    start_s = float(later[0]) if len(later) else 0.0
    recorded = (trajectory.duration_s - start_s) / model.control_period_s
    periods = int(recorded + 1e-9)
    if periods < 1 or not len(trajectory.command):
        raise RecordingError(
            trajectory.name,
            f"{trajectory.duration_s - start_s:.3f} s of motion after the first of "
            f"{len(trajectory.command)} commands",
            f"at least one control period of {model.control_period_s} s",
        )
    edges = np.asarray(start_s + model.control_period_s * np.arange(periods + 1), np.float64)
    count = math.ceil(recorded - 1e-9) * model.substeps
    steps = np.asarray(start_s + model.timestep_s * np.arange(count), np.float64)
    command = command_in_force(model, trajectory, steps)
    return Replay(
        name=trajectory.name,
        kind=trajectory.command_kind,
        model=model.model_for(trajectory),
        start_s=start_s,
        motion=motion,
        qpos=motion.qpos(edges),
        qvel=motion.qvel(edges),
        command=command.reshape(-1, model.substeps, command.shape[1]),
    )


def command_in_force(model: HybridModel, trajectory: Trajectory, time_s: Array) -> Array:
    """Returns the commands held over integration steps that begin at `time_s`, shape (T, J).

    A command counts from the step whose middle it precedes: no delay on average.
    """
    middle = time_s + 0.5 * model.timestep_s
    index = np.searchsorted(trajectory.command_time_s, middle, side="right") - 1
    columns = _columns(model, trajectory)
    return np.asarray(trajectory.command[np.maximum(index, 0)][:, columns])


def make_motion(model: HybridModel, trajectory: Trajectory) -> Motion:
    """Returns the smoothed motion of a recording."""
    columns = _columns(model, trajectory)
    if (samples := len(trajectory.stamp_ns)) < LEAST_SAMPLES:
        raise RecordingError(
            trajectory.name, f"{samples} joint states", f"at least {LEAST_SAMPLES}"
        )
    return Motion(
        layout=model.layout,
        nv=model.any_model.nv,
        joints=smoothing_spline(trajectory.time_s, trajectory.position[:, columns]),
        free_object=_object_spline(trajectory) if model.layout.has_object else None,
    )


def _columns(model: HybridModel, trajectory: Trajectory) -> list[int]:
    """Returns where the model's joints are in the recording's arrays."""
    missing = [n for n in model.layout.joint_names if n not in trajectory.joint_names]
    if missing:
        raise RecordingError(
            trajectory.name,
            f"joints {', '.join(trajectory.joint_names)}",
            f"the model's, {', '.join(missing)} among them",
        )
    return [trajectory.joint_names.index(name) for name in model.layout.joint_names]


def _object_spline(trajectory: Trajectory) -> BSpline:
    track = trajectory.object_track
    if track is None or len(track.stamp_ns) < LEAST_SAMPLES:
        poses = 0 if track is None else len(track.stamp_ns)
        raise RecordingError(
            trajectory.name,
            f"{poses} object poses",
            f"at least {LEAST_SAMPLES}, the model has a free object",
        )
    time_s = np.asarray((track.stamp_ns - trajectory.stamp_ns[0]) * 1e-9)
    pose = np.hstack([track.position, _continuous(track.quaternion)])
    return smoothing_spline(time_s, pose)


def _continuous(quaternion: Array) -> Array:
    """Returns the same rotations without jumps of sign, shape (T, 4)."""
    flips = np.where((quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(flips)])
    return np.asarray(quaternion * signs[:, None])


def _body_rate(quaternion: Array, rate: Array) -> Array:
    """Returns the angular velocity 2 conj(q) q' in the body's frame, rad/s, shape (T, 3).

    The quaternion need not be of unit length; its length and its rate of length drop out.
    """
    w, vector = quaternion[:, :1], quaternion[:, 1:]
    product = w * rate[:, 1:] - rate[:, :1] * vector - np.cross(vector, rate[:, 1:])
    return np.asarray(2.0 * product / (quaternion**2).sum(axis=1, keepdims=True))
