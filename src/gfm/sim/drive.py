"""The torque that a model's drives give for a command, without stepping.

Shape letters: N any leading shape, J joints.
"""

from __future__ import annotations

import mujoco
import numpy as np

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.sim.layout import Layout

#: Columns of a drive law: gain on the command; constant, position and velocity bias; force range;
#: gear.
LAW_SIZE = 7


def drive_law(model: mujoco.MjModel, layout: Layout) -> Array:
    """Returns gear * clip(gain u + b0 + b1 gear q + b2 gear v) as coefficients, shape (J, 7).

    That is a motor, a position servo or a velocity servo. Joints without a drive get zeros.

    Raises:
        ConfigError: a drive follows another law.
    """
    law = np.zeros((len(layout.joint_names), LAW_SIZE))
    for joint, index in enumerate(layout.actuator):
        if index < 0:
            continue
        _check_affine(model, int(index))
        limited = bool(model.actuator_forcelimited[index])
        limits = model.actuator_forcerange[index] if limited else (-np.inf, np.inf)
        bias = model.actuator_biasprm[index, :3]
        affine = model.actuator_biastype[index] == int(mujoco.mjtBias.mjBIAS_AFFINE)
        law[joint, 0] = model.actuator_gainprm[index, 0]
        law[joint, 1:4] = bias if affine else 0.0
        law[joint, 4:6] = limits
        law[joint, 6] = model.actuator_gear[index, 0]
    return law


def write_out_damping(spec: mujoco.MjSpec) -> None:
    """Gives servos the damping, in numbers, that their file gives as a ratio to the critical one.

    MuJoCo takes the ratio anew at every compilation: the servo would follow each inertia that is
    added, as no robot's does.
    """
    model = spec.copy().compile()
    for index, actuator in enumerate(spec.actuators):
        if actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE and actuator.biasprm[2] > 0.0:
            actuator.biasprm[2] = model.actuator_biasprm[index, 2]


def _check_affine(model: mujoco.MjModel, index: int) -> None:
    fixed = model.actuator_gaintype[index] == int(mujoco.mjtGain.mjGAIN_FIXED)
    biases = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
    if not fixed or int(model.actuator_biastype[index]) not in biases:
        raise ConfigError(
            f"actuator {model.actuator(index).name!r} is neither motor nor position nor velocity "
            "servo: its torque cannot be told from the state"
        )


def drive_torque(law: Array, command: Array, position: Array, velocity: Array) -> Array:
    """Returns the joints' drive torques, N m, shape (N, J).

    Args:
        law: shape (N, J, 7).
        command: In the drive's unit, shape (N, J).
        position: rad, shape (N, J).
        velocity: rad/s, shape (N, J).
    """
    gear = law[..., 6]
    state = law[..., 1] + gear * (law[..., 2] * position + law[..., 3] * velocity)
    force = np.clip(law[..., 0] * command + state, law[..., 4], law[..., 5])
    return np.asarray(gear * force)
