"""Mass, inertia and gravity."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.effects.effect import (
    Compensation,
    Effect,
    Parameter,
    ProbeGroup,
    Scales,
    Scope,
    Values,
    find_joint,
    find_motor_side,
    free_name,
)

GRAVITY = 9.81
UPRIGHT = (0.0, 0.0, -GRAVITY)
#: How far from a link's frame a load is looked for at first at most, and where if nothing says.
FARTHEST_M, USUAL_M = 0.5, 0.2


@final
class Payload(Effect):
    """A point mass that the last link carries."""

    name = "payload"
    scope = Scope.LAST
    parameters = (
        Parameter(name="mass", unit="kg", lower=0.0, upper=200.0),
        Parameter(name="com_x", unit="m", lower=-2.0, upper=2.0),
        Parameter(name="com_y", unit="m", lower=-2.0, upper=2.0),
        Parameter(name="com_z", unit="m", lower=-2.0, upper=2.0),
    )
    shown_by = "rest in several postures, and fast motion of the last joints"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        if values["mass"] <= 0.0:
            return
        load = find_joint(spec, joints[0]).parent.add_body(
            name=free_name(spec.bodies, "payload"),
            pos=[values["com_x"], values["com_y"], values["com_z"]],
        )
        load.mass = values["mass"]
        load.inertia, load.ipos = [1e-9] * 3, [0.0] * 3  # without ipos it is not written to XML
        load.explicitinertial = True

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        mass, arm = 0.05, 0.1
        places = [(0.0, 0.0, 0.0), (arm, 0.0, 0.0), (0.0, arm, 0.0), (0.0, 0.0, arm)]
        return [[{"mass": mass, "com_x": x, "com_y": y, "com_z": z} for x, y, z in places]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        masses = np.array([a * p["mass"] for a, p in zip(amplitudes, group, strict=True)])
        axes = ("com_x", "com_y", "com_z")
        moment = masses @ np.array([[p[axis] for axis in axes] for p in group])
        mass, size = float(masses.sum()), float(np.linalg.norm(moment))
        # Joints with parallel axes tell the moment only: what the mass is, the fit has to find.
        if mass * FARTHEST_M < size:
            mass = size / USUAL_M
        if mass <= 1e-4:
            return None
        return {"mass": mass, **{a: float(m) / mass for a, m in zip(axes, moment, strict=True)}}


@final
class GravityDirection(Effect):
    """A base that does not stand upright.

    A model is written in the frame of the base. What was set up and measured in that frame (the
    arm, the basket, the tracked object) stays where it is; gravity turns, and pulls at all of it
    alike: at the links, at a payload, at an object in the basket. A controller that cancels gravity
    goes on to cancel the upright one, for the bodies that it bears and no others.
    """

    name = "gravity_direction"
    confused_with = ("encoder_offset",)
    scope = Scope.ROBOT
    parameters = (
        Parameter(name="tilt_x", unit="rad", lower=-1.6, upper=1.6),
        Parameter(name="tilt_y", unit="rad", lower=-1.6, upper=1.6),
    )
    shown_by = "rest in several postures"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        spec.option.gravity = tilted_gravity(values["tilt_x"], values["tilt_y"])

    @override
    def compensation(
        self, model: mujoco.MjModel, joints: Sequence[str], values: Values
    ) -> Compensation | None:
        return Compensation(gravity=np.array(UPRIGHT))

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"tilt_x": 0.02, "tilt_y": 0.0}, {"tilt_x": 0.0, "tilt_y": 0.02}]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        values = {
            "tilt_x": amplitudes[0] * group[0]["tilt_x"],
            "tilt_y": amplitudes[1] * group[1]["tilt_y"],
        }
        return values if self.admissible(values) else None


def tilted_gravity(tilt_x: float, tilt_y: float) -> list[float]:
    """Returns the gravity vector, m/s^2, in the frame of a base tilted about x and y."""
    return [
        -GRAVITY * math.cos(tilt_x) * math.sin(tilt_y),
        GRAVITY * math.sin(tilt_x),
        -GRAVITY * math.cos(tilt_x) * math.cos(tilt_y),
    ]


@final
class Armature(Effect):
    """Inertia of the motor side, seen at the joint."""

    name = "armature"
    parameters = (Parameter(name="inertia", unit="kg m^2", lower=0.0, upper=1e3, takes_off=True),)
    shown_by = "fast reversals"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        find_motor_side(spec, joints[0]).armature += values["inertia"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"inertia": 0.05 * scales.inertia}]]
