"""Springs, and what lies between a motor and its link."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.effects.effect import (
    MOTOR_SIDE,
    Compensation,
    Effect,
    Motion,
    Parameter,
    ProbeGroup,
    Scales,
    Values,
    find_joint,
    find_motor_side,
)
from gfm.effects.elements import add_spring

#: Mass and inertia of the body that carries a motor side; its real inertia is the armature.
MOTOR_MASS, MOTOR_INERTIA = 1e-6, 1e-9
#: Least inertia of a motor side, so that it can be integrated.
LEAST_ARMATURE = 1e-5


@final
class JointSpring(Effect):
    """A spring between a joint and its parent: cables, a balancer."""

    name = "joint_spring"
    law_of = "position"
    seen_over = "position"
    parameters = (
        Parameter(name="stiffness", unit="N m/rad", lower=0.0, upper=1e5),
        Parameter(name="rest_angle", unit="rad", lower=-20.0, upper=20.0),
    )
    shown_by = "rest or slow motion over the whole range"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        add_spring(spec, joints[0], values["stiffness"], values["rest_angle"])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        stiffness = 0.5 * scales.excess_nm / max(scales.position_rad, 0.05)
        return [[{"stiffness": stiffness, "rest_angle": rest} for rest in (0.0, 1.0)]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        share = sum(amplitudes)
        if share <= 0.0:
            return None
        values = {
            "stiffness": share * group[0]["stiffness"],
            "rest_angle": float(np.clip(amplitudes[1] / share, -19.0, 19.0)),
        }
        return values if self.admissible(values) else None

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return -values["stiffness"] * (motion.position - values["rest_angle"])


@final
class Backlash(Effect):
    """Free play between the motor side and the link."""

    name = "backlash"
    needs_drive = True
    abrupt = True
    confused_with = ("joint_elasticity",)
    parameters = (Parameter(name="gap", unit="rad", lower=0.0, upper=0.5, rough_below=0.1),)
    #: Where the motor is in its play at first depends on how large that is.
    valleys = ("gap",)
    separates_motor = True
    shown_by = "reversals under changing load"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        tendon = separate_motor(spec, joints[0], "backlash")
        half = max(0.5 * values["gap"], 1e-6)
        tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        tendon.range = [-half, half]
        tendon.solref_limit = [0.004, 1.0]

    @override
    def compensation(
        self, model: mujoco.MjModel, joints: Sequence[str], values: Values
    ) -> Compensation | None:
        return moved_to_motor(model, joints[0])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"gap": gap}] for gap in (1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2, 3.2e-2)]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        # Twice the play is not twice the answer: a probe either looks like it or does not.
        return dict(group[0]) if amplitudes[0] > 0.0 else None


@final
class JointElasticity(Effect):
    """A spring between the motor side and the link: a harmonic drive, a belt."""

    name = "joint_elasticity"
    needs_drive = True
    confused_with = ("backlash",)
    rings = True
    parameters = (Parameter(name="stiffness", unit="N m/rad", lower=0.5, upper=1e6),)
    #: Wrong by a third it rings at another frequency: no small step leads from one to the other.
    valleys = ("stiffness",)
    separates_motor = True
    shown_by = "fast reversals: steps and multisine near the resonance"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        tendon = separate_motor(spec, joints[0], "elasticity")
        tendon.stiffness[0] = values["stiffness"]
        tendon.springlength = [0.0, 0.0]

    @override
    def compensation(
        self, model: mujoco.MjModel, joints: Sequence[str], values: Values
    ) -> Compensation | None:
        return moved_to_motor(model, joints[0])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        peak = max(scales.peak_nm, 1e-6)
        return [[{"stiffness": peak / bend}] for bend in (0.2, 0.12, 0.07, 0.04, 0.015, 0.005)]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        if amplitudes[0] <= 0.0:
            return None
        values = {"stiffness": group[0]["stiffness"] / amplitudes[0]}
        return values if self.admissible(values) else None


def moved_to_motor(model: mujoco.MjModel, joint: str) -> Compensation | None:
    """Returns that the drive cancels gravity from the motor side; None where there is none."""
    motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint + MOTOR_SIDE)
    if motor < 0:
        return None
    return Compensation(
        moved=(int(model.jnt_dofadr[model.joint(joint).id]), int(model.jnt_dofadr[motor])),
    )


def separate_motor(spec: mujoco.MjSpec, name: str, what: str) -> mujoco.MjsTendon:
    """Moves a joint's armature, friction, damping and drive to a motor side of its own.

    Returns:
        The tendon whose length is motor angle minus link angle; the caller says how it couples
        them.

    Raises:
        ConfigError: the joint has a motor side already.
    """
    link = find_joint(spec, name)
    if find_motor_side(spec, name) is not link:
        raise ConfigError(
            f"{what} on {name}: the model has a motor side {name}{MOTOR_SIDE} already, and what "
            "lies between the two cannot be added to; expected a joint without one"
        )
    carrier = link.parent.parent.add_body(
        name=f"{name}{MOTOR_SIDE}", pos=link.parent.pos, quat=link.parent.quat
    )
    carrier.mass = MOTOR_MASS
    carrier.inertia, carrier.ipos = [MOTOR_INERTIA] * 3, [0.0] * 3  # else not written to XML
    carrier.explicitinertial = True
    motor = carrier.add_joint(name=f"{name}{MOTOR_SIDE}", type=link.type, axis=link.axis)
    motor.pos, motor.ref, motor.limited = link.pos, link.ref, mujoco.mjtLimited.mjLIMITED_FALSE
    motor.armature = max(float(link.armature), LEAST_ARMATURE)
    motor.frictionloss, motor.damping = float(link.frictionloss), link.damping
    motor.solref_friction = link.solref_friction
    motor.solimp_friction = link.solimp_friction
    link.armature, link.frictionloss, link.damping = 0.0, 0.0, [0.0, 0.0, 0.0]
    for actuator in (a for a in spec.actuators if a.target == name):
        actuator.target = motor.name
    tendon = spec.add_tendon(name=f"{name}_{what}")
    tendon.wrap_joint(motor.name, 1.0)
    tendon.wrap_joint(name, -1.0)
    return tendon
