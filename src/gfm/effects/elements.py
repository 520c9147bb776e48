"""Pieces of MJCF that several effects are made of."""

from __future__ import annotations

import mujoco
import numpy as np

from gfm.effects.effect import angle, find_joint, find_motor_side, free_name

#: Solver settings of constraints that hold: time constant, s, and damping ratio.
HOLDING_SOLREF = (0.004, 1.0)
#: Impedance of dry friction that holds. What it is short of one lets joints creep, the faster the
#: lighter they are: at 0.99 a wrist of 1e-3 kg m^2, held against 2 N m, at 0.04 rad/s.
HOLDING_SOLIMP = (0.9999, 0.9999, 0.001)
#: Stiffness of the soft, far stretched spring that stands for a constant torque, N m/rad.
SOFT_SPRING = 1e-6


def add_spring(spec: mujoco.MjSpec, name: str, stiffness: float, rest_rad: float) -> None:
    """Adds -stiffness (q - rest) to a joint that may have a linear spring already."""
    joint = find_joint(spec, name)
    before = float(joint.stiffness[0])
    total = before + stiffness
    if total == 0.0:
        return
    moment = before * float(joint.springref) + stiffness * angle(spec, joint, rest_rad)
    joint.stiffness[0] = total
    joint.springref = moment / total


def add_dry_friction(spec: mujoco.MjSpec, name: str, torque: float) -> None:
    """Adds dry friction that holds: MuJoCo's default lets a joint creep under a load below it."""
    joint = find_motor_side(spec, name)
    joint.frictionloss += torque
    _let_hold(joint)


def let_friction_hold(spec: mujoco.MjSpec) -> None:
    """Lets dry friction hold wherever its solver settings are MuJoCo's default: it would creep."""
    default = mujoco.MjSpec().worldbody.add_body().add_joint()
    settings = ("solref_friction", "solimp_friction")
    for joint in spec.joints:
        same = all(np.array_equal(getattr(joint, s), getattr(default, s)) for s in settings)
        if joint.frictionloss > 0.0 and same:
            _let_hold(joint)


def _let_hold(joint: mujoco.MjsJoint) -> None:
    joint.solref_friction = HOLDING_SOLREF
    joint.solimp_friction[0:3] = HOLDING_SOLIMP


def add_constant_torque(spec: mujoco.MjSpec, name: str, torque: float) -> None:
    """Adds a torque that depends on nothing: a spring so soft that its stretch never changes it."""
    if torque != 0.0:
        add_spring(spec, name, SOFT_SPRING, torque / SOFT_SPRING)


def add_cogging(
    spec: mujoco.MjSpec, joint: str, amplitude: float, periods: int, phase: float
) -> None:
    """Adds a motor without windings or inputs to a joint: only its cogging torque acts."""
    motor = add_passive_motor(spec, find_motor_side(spec, joint).name, f"{joint}_cogging")
    motor.biasprm[0:3] = [amplitude, periods, phase]


def add_passive_motor(spec: mujoco.MjSpec, joint: str, name: str) -> mujoco.MjsActuator:
    """Adds a motor that takes no command and, so far, does nothing.

    Written field by field, as MuJoCo's reader does for `<dcmotor input="none" motorconst="0">`,
    because `MjsActuator.set_to_dcmotor` refuses a motor constant of zero.
    """
    motor = spec.add_actuator(name=free_name(spec.actuators, name), target=joint)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.dyntype = mujoco.mjtDyn.mjDYN_DCMOTOR
    motor.gaintype = mujoco.mjtGain.mjGAIN_DCMOTOR
    motor.biastype = mujoco.mjtBias.mjBIAS_DCMOTOR
    motor.ctrlspec = NO_INPUT
    motor.actearly = True
    motor.actlimited = mujoco.mjtLimited.mjLIMITED_FALSE
    motor.dynprm[0] = 0.0
    return motor


#: MjsActuator.ctrlspec of `input="none"`.
NO_INPUT = 16
