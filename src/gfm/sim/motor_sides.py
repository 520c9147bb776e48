"""Motors apart from their links: how far ahead they are, and how fast they ring against them."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gfm.effects.effect import MOTOR_SIDE
from gfm.sim.plant import Plant


def motor_of(plant: Plant, joint: int) -> int:
    """Returns the model's number of the motor side of a joint that has one."""
    return int(plant.model.joint(plant.joints[joint] + MOTOR_SIDE).id)


def ahead_of_link(model: mujoco.MjModel, motor: int, load: float) -> float:
    """Returns by how much a motor's angle is ahead of its link's when it bears a load, rad."""
    for tendon in _couplings(model, motor):
        if model.tendon_stiffness[tendon] > 0.0:
            return load / float(model.tendon_stiffness[tendon])
        if model.tendon_limited[tendon]:
            return float(model.tendon_range[tendon, 1]) * float(np.sign(load))
    return 0.0


@dataclass(frozen=True, kw_only=True)
class Spring:
    """What lies between a motor and its link.

    Attributes:
        joint: Number of the link's joint.
        stiffness: N m/rad.
        ringing_hz: How often a second the motor swings against its link, all else at rest.
    """

    joint: int
    stiffness: float
    ringing_hz: float


def springs(plant: Plant) -> list[Spring]:
    """Returns the springs between motors and links, by joint."""
    model, data = plant.model, mujoco.MjData(plant.model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    found = []
    for j in np.flatnonzero(plant.motor_qpos >= 0):
        motor = motor_of(plant, int(j))
        stiffness = float(sum(model.tendon_stiffness[t] for t in _couplings(model, motor)))
        ends = np.diag(inertia)[[plant.dof[j], model.jnt_dofadr[motor]]]
        hz = float(np.sqrt(stiffness * np.sum(1.0 / ends)) / (2.0 * np.pi))
        if stiffness > 0.0:
            found.append(Spring(joint=int(j), stiffness=stiffness, ringing_hz=hz))
    return found


def _couplings(model: mujoco.MjModel, motor: int) -> list[int]:
    """Returns the tendons that couple a motor side to its link."""
    pairs = np.flatnonzero(model.tendon_num == 2)
    return [int(t) for t in pairs if model.wrap_objid[model.tendon_adr[t]] == motor]
