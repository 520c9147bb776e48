"""The Sawyer cell as an MjSpec: arm, end effector, basket and the object in it.

The world frame is the robot's base frame. The model is *nominal*: ideal servos, no dry friction,
gravity fully compensated. What a robot has beyond it is for the diagnosis to find.
"""

from __future__ import annotations

import math
from typing import get_args

import mujoco
import numpy as np

from gfm.core import CommandKind, UnknownNameError
from gfm.core.checks import Array
from gfm.sim import sawyer_numbers as numbers
from gfm.sim.cell import EndEffector, FreeObject, add_basket, add_end_effector, add_object
from gfm.sim.sawyer_numbers import Joint, Link, Vector

JOINT_NAMES = tuple(joint.name for joint in numbers.JOINTS)
NEUTRAL = np.array(numbers.NEUTRAL)
READY = np.array(numbers.READY)
TIMESTEP_S = 0.002  # the paper's integration step

_ARM_RGBA = (0.55, 0.1, 0.12, 1.0)


def sawyer_spec(
    *,
    command: CommandKind,
    end_effector: EndEffector = "none",
    free_object: FreeObject | None = None,
    basket: bool | None = None,
) -> mujoco.MjSpec:
    """Returns the nominal cell.

    Args:
        command: What the seven actuators, named as their joints, take.
        end_effector: What is mounted on `right_hand`; the site `end_effector` marks its tip.
        free_object: What the free body `object`, at rest in the basket, is; None for none.
        basket: Whether the basket stands there; by default where there is an object.
    """
    _check_name("end effector", end_effector, get_args(EndEffector))
    _check_name("object", free_object or "brick", get_args(FreeObject))
    spec = _empty_spec(f"sawyer_{command}", contacts=free_object is not None)
    add_end_effector(_add_arm(spec), end_effector)
    for joint in numbers.JOINTS:
        _add_actuator(spec, joint, command)
    if free_object is not None or basket:
        add_basket(spec)
    if free_object is not None:
        add_object(spec, free_object)
    _add_key(spec, "neutral", NEUTRAL, command)
    _add_key(spec, "ready", READY, command)
    return spec


def hang_payload(spec: mujoco.MjSpec, mass_kg: float, com_m: Array) -> None:
    """Hangs a point mass on the last link, in whose frame it is, m, shape (3,); in place.

    No gravity compensation bears it.
    """
    load = spec.body(numbers.LINKS[-1].name).add_body(name="payload", pos=com_m)
    load.mass, load.inertia, load.explicitinertial = mass_kg, [1e-9] * 3, True
    load.ipos = [0.0] * 3  # without it the mass lies twice as far away


def _check_name(kind: str, name: str, available: tuple[str, ...]) -> None:
    if name not in available:
        raise UnknownNameError(kind, name, available)


def _empty_spec(name: str, *, contacts: bool) -> mujoco.MjSpec:
    """Returns the ground and the options.

    Against RK4 at 0.1 ms, ten seconds of smooth 20 Hz position commands: RK4 at 2 ms is off by
    2e-6 rad at most, Euler, implicitfast, implicit and discrete by about 1e-3 rad (their stiff
    servos lag by a part of a step), which a diagnosis would have to tell from a gap. RK4 costs
    3.5 times as much; with contacts, which break its order anyway, it is not worth that.
    """
    spec = mujoco.MjSpec()
    spec.modelname = name
    spec.compiler.degree = False
    spec.option.timestep = TIMESTEP_S
    integrators = mujoco.mjtIntegrator
    spec.option.integrator = integrators.mjINT_IMPLICITFAST if contacts else integrators.mjINT_RK4
    spec.worldbody.add_light(name="lamp", pos=(0.3, -0.5, 2.0), dir=(0.1, 0.25, -1.0))
    spec.worldbody.add_geom(
        name="ground",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(2.0, 2.0, 0.1),
        pos=(0.0, 0.0, -numbers.PEDESTAL_HEIGHT),
        rgba=(0.8, 0.8, 0.8, 1.0),
    )
    return spec


def _add_arm(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    """Adds base, seven links and head; returns the frame `right_hand`."""
    parent = spec.worldbody.add_body(name=numbers.BASE.name)
    _set_inertia(parent, numbers.BASE)
    for joint, link in zip(numbers.JOINTS, numbers.LINKS, strict=True):
        parent = parent.add_body(
            name=link.name, pos=joint.xyz, quat=quaternion_from_rpy(joint.rpy), gravcomp=1.0
        )
        _set_inertia(parent, link)
        _add_hinge(parent, joint)
    flange = parent.add_geom(name="flange", type=mujoco.mjtGeom.mjGEOM_CYLINDER, rgba=_ARM_RGBA)
    flange.size[:2] = numbers.FLANGE
    _add_head(spec.body(numbers.LINKS[0].name))
    return parent.add_body(
        name="right_hand",
        pos=numbers.HAND_XYZ,
        quat=quaternion_from_rpy(numbers.HAND_RPY),
        gravcomp=1.0,
    )


def _add_head(shoulder: mujoco.MjsBody) -> None:
    head = shoulder.add_body(name=numbers.HEAD.name, pos=numbers.HEAD_XYZ, gravcomp=1.0)
    _set_inertia(head, numbers.HEAD)
    position, half = numbers.HEAD_BOX
    head.add_geom(
        name="display", type=mujoco.mjtGeom.mjGEOM_BOX, pos=position, size=half, rgba=_ARM_RGBA
    )


def _set_inertia(body: mujoco.MjsBody, link: Link) -> None:
    body.explicitinertial = True
    body.mass = link.mass
    body.ipos = link.com
    body.fullinertia = link.inertia
    for number, (start, end, radius) in enumerate(link.capsules):
        body.add_geom(
            name=f"{link.name}_{number}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=(*start, *end),
            size=(radius, 0.0, 0.0),
            rgba=_ARM_RGBA,
        )


def _add_hinge(body: mujoco.MjsBody, joint: Joint) -> None:
    """Adds the joint; its drive carries the gravity compensation (qfrc_actuator includes it)."""
    hinge = body.add_joint(
        name=joint.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=(0.0, 0.0, 1.0),
        limited=True,
        range=(joint.lower, joint.upper),
        armature=numbers.ARMATURE,
        actgravcomp=True,
    )
    hinge.damping[0] = numbers.DAMPING


def _add_actuator(spec: mujoco.MjSpec, joint: Joint, command: CommandKind) -> None:
    """Adds the drive of one joint; the servo's torque is limited, the compensation beside it."""
    actuator = spec.add_actuator(
        name=joint.name,
        target=joint.name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        ctrllimited=True,
        forcelimited=True,
        forcerange=(-joint.effort, joint.effort),
    )
    match command:
        case CommandKind.POSITION:
            actuator.set_to_position(kp=joint.kp, kv=joint.kd)
            actuator.ctrlrange = (joint.lower, joint.upper)
        case CommandKind.VELOCITY:
            actuator.set_to_velocity(kv=numbers.VELOCITY_GAIN)
            actuator.ctrlrange = (-joint.velocity, joint.velocity)
        case CommandKind.EFFORT:
            actuator.set_to_motor()
            actuator.ctrlrange = (-joint.effort, joint.effort)


def _add_key(spec: mujoco.MjSpec, name: str, pose: Array, command: CommandKind) -> None:
    """Adds a keyframe: the arm in `pose`, commanded to stay there, the object where it rests."""
    qpos = spec.compile().qpos0.copy()
    qpos[: len(pose)] = pose
    ctrl = pose if command is CommandKind.POSITION else np.zeros(len(pose))
    spec.add_key(name=name, qpos=qpos, ctrl=ctrl)


def quaternion_from_rpy(rpy: Vector) -> Array:
    """Returns w x y z of roll, pitch, yaw about fixed axes (URDF's convention), rad."""
    (cr, cp, cy), (sr, sp, sy) = ([f(angle / 2) for angle in rpy] for f in (math.cos, math.sin))
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )
