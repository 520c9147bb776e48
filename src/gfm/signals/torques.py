"""Recordings seen as torques, by the model's inverse dynamics.

Shape letters: T measurements, J joints.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import mujoco
import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.effects import EffectInstance, Motion
from gfm.signals.smoothing import smooth_states
from gfm.sim.commands import commands_between
from gfm.sim.compensation import compensation_error
from gfm.sim.plant import Plant, with_servo_gain

#: Positions, velocities and accelerations, shape (T, J) each.
States: TypeAlias = tuple[Array, Array, Array]


@dataclass(frozen=True, kw_only=True)
class TorqueView:
    """One recording seen as torques: what drives the joints and what the model says is needed.

    Of `joints`, all of shape (T, J); `missing` is needed minus drive: the generalized force that
    the model lacks along the measured motion; `served` is what the servo gives beside the model's
    gravity compensation. Where the drive was not measured, it is what the model's own servo would
    do, and `served` what the motion takes.
    """

    joints: tuple[str, ...]
    position: Array
    velocity: Array
    drive: Array
    missing: Array
    served: Array

    @property
    def needed(self) -> Array:
        """What the motion takes."""
        return self.missing + self.drive

    def motion(self, joint: int, other: int | None = None) -> Motion:
        """Returns the signals of one joint, and the velocity of the other one of a pair."""
        return Motion(
            position=self.position[:, joint],
            velocity=self.velocity[:, joint],
            drive=self.drive[:, joint],
            other_velocity=None if other is None else self.velocity[:, other],
        )

    def law(self, instance: EffectInstance) -> Array:
        """Returns the torque of an effect's law, N m, shape (T, J); zero where it has none."""
        return self.added(instance) if instance.has_law else np.zeros_like(self.missing)

    def added(self, instance: EffectInstance) -> Array:
        """Returns the torque that an effect adds in closed form, N m, shape (T, J); else zero.

        To what its drive gives, too: where the drive was measured, that is in it already.
        """
        torque = np.zeros_like(self.missing)
        if instance.in_closed_form:
            first, *second = (self.joints.index(name) for name in instance.joints)
            torque[:, first] = instance.added(self.motion(first, *second))
            torque[:, second] = -torque[:, [first] * len(second)]
        return torque


def joined(views: Sequence[TorqueView]) -> TorqueView:
    """Returns what the views of several recordings say, one after the other."""
    names = ("position", "velocity", "drive", "missing", "served")
    q, v, drive, missing, served = (np.concatenate([getattr(w, n) for w in views]) for n in names)
    return replace(views[0], position=q, velocity=v, drive=drive, missing=missing, served=served)


def torque_view(plant: Plant, recording: Trajectory, states: States | None = None) -> TorqueView:
    """Returns a recording seen as torques, by the model's continuous inverse dynamics.

    The drive is the measured effort, where there is one; else that of the model, at the servo gains
    of the recording, with what its gravity compensation does wrong.

    Args:
        plant: The model.
        recording: Of its robot.
        states: Its smooth states, where they are known: they are the same under every model.
    """
    q, v, a = states or smooth_states(recording.time_s, recording.position)
    gain = np.array([recording.servo_gain.get(name, 1.0) for name in plant.joints])
    kind = recording.command_kind
    model = copy.copy(with_servo_gain(plant.model, plant.actuator, kind, gain))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    positions, velocities, accelerations = (
        np.tile(rest, (len(q), 1)) for rest in (data.qpos, data.qvel, data.qacc)
    )
    positions[:, plant.qpos], velocities[:, plant.dof], accelerations[:, plant.dof] = q, v, a
    controls = np.tile(data.ctrl, (len(q), 1))
    controls[:, plant.actuator] = _mean_commands(plant, recording)
    given = (data.qpos, data.qvel, data.qacc, data.ctrl)
    told = (data.qfrc_inverse, data.qfrc_actuator, data.qfrc_gravcomp)
    forces = np.empty((len(told), len(q), model.nv))
    for i, row in enumerate(zip(positions, velocities, accelerations, controls, strict=True)):
        for here, value in zip(given, row, strict=True):
            here[:] = value
        mujoco.mj_inverse(model, data)
        mujoco.mj_fwdActuation(model, data)
        for j, force in enumerate(told):
            forces[j, i] = force
    needed, drive, compensation = forces[:, :, plant.dof]
    compensation = compensation * (model.jnt_actgravcomp[model.dof_jntid[plant.dof]] > 0)
    if recording.effort is not None:
        drive = recording.effort
    elif (wrong := compensation_error(plant, q)) is not None:
        drive += wrong.force[:, plant.dof]
    return TorqueView(
        joints=plant.joints,
        position=q,
        velocity=v,
        drive=drive,
        missing=needed - drive,
        served=(needed if recording.effort is None else drive) - compensation,
    )


def _mean_commands(plant: Plant, recording: Trajectory) -> Array:
    """Returns the mean command around each measurement, over the time between two, shape (T, J).

    Measurements and commands are in step with each other: the command at a measurement would always
    be the beginning, or the end, of a step in which a servo's torque falls as the joint follows.
    """
    half_s = 0.5 * float(np.median(np.diff(recording.time_s)))
    return commands_between(plant, recording, recording.time_s - half_s, recording.time_s + half_s)
