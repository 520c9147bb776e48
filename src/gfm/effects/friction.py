"""Friction laws: what opposes motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core.checks import Array
from gfm.effects.effect import (
    Effect,
    Motion,
    Parameter,
    ProbeGroup,
    Scales,
    Scope,
    Values,
    find_motor_side,
    free_name,
    sign,
)
from gfm.effects.elements import (
    add_constant_torque,
    add_dry_friction,
)

#: Velocity over which the sign of a *measured* velocity is taken to pass through zero.
SIGN_WIDTH_RAD_S = 0.01


@final
class CoulombFriction(Effect):
    """A dry friction torque that opposes motion and holds at rest (MuJoCo's frictionloss)."""

    name = "coulomb_friction"
    law_of = "velocity"
    abrupt = True
    parameters = (Parameter(name="torque", unit="N m", lower=0.0, upper=1e3, takes_off=True),)
    shown_by = "reversals at several speeds, and rest under load"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        add_dry_friction(spec, joints[0], values["torque"])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"torque": 0.5 * scales.excess_nm}]]

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return -values["torque"] * sign(motion.velocity, SIGN_WIDTH_RAD_S)


@final
class ViscousFriction(Effect):
    """A torque proportional to the velocity (MuJoCo's damping)."""

    name = "viscous_friction"
    law_of = "velocity"
    parameters = (
        Parameter(name="coefficient", unit="N m s/rad", lower=0.0, upper=1e4, takes_off=True),
    )
    shown_by = "motion at several speeds"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        find_motor_side(spec, joints[0]).damping[0] += values["coefficient"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"coefficient": 0.5 * scales.excess_nm / scales.velocity_rad_s}]]

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return -values["coefficient"] * motion.velocity


@final
class QuadraticDrag(Effect):
    """A torque proportional to velocity times speed (MuJoCo's second damping coefficient)."""

    name = "quadratic_drag"
    law_of = "velocity"
    parameters = (Parameter(name="coefficient", unit="N m s^2/rad^2", lower=0.0, upper=1e4),)
    shown_by = "fast motion beside slow motion"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        find_motor_side(spec, joints[0]).damping[1] += values["coefficient"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"coefficient": 0.5 * scales.excess_nm / scales.velocity_rad_s**2}]]

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return -values["coefficient"] * motion.velocity * np.abs(motion.velocity)


@final
class StribeckFriction(Effect):
    """Extra dry friction at low speed that fades with it.

    MuJoCo's bristle model (LuGre, of its DC motor) has such a term, but with a level of its own in
    place of the joint's; on top of any other friction the level is set at every step.
    """

    name = "stribeck_friction"
    law_of = "velocity"
    abrupt = True
    costly = True
    valleys = ("stribeck_velocity",)
    excess_of = "coulomb_friction"
    rugged = True
    native = False
    parameters = (
        Parameter(name="static_excess", unit="N m", lower=0.0, upper=1e3),
        Parameter(name="stribeck_velocity", unit="rad/s", lower=1e-3, upper=5.0),
    )
    shown_by = "slow reversals: speeds below the Stribeck velocity"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        add_dry_friction(spec, joints[0], 0.0)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        excess = 0.5 * scales.excess_nm
        speeds = [max(share * scales.velocity_rad_s, 2e-3) for share in (0.1, 0.3, 0.6)]
        return [[{"static_excess": excess, "stribeck_velocity": speed}] for speed in speeds]

    @override
    def extra_friction(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        fade = np.exp(-((motion.velocity / values["stribeck_velocity"]) ** 2))
        return np.asarray(values["static_excess"] * fade)

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        fade = np.exp(-((motion.velocity / values["stribeck_velocity"]) ** 2))
        width = min(SIGN_WIDTH_RAD_S, 0.3 * values["stribeck_velocity"])
        return -values["static_excess"] * fade * sign(motion.velocity, width)


@final
class AsymmetricFriction(Effect):
    """Friction that differs with the direction of motion.

    While the dry friction is larger than half the difference, this is a constant torque of minus
    half the difference beside it, moving or at rest.
    """

    name = "asymmetric_friction"
    law_of = "velocity"
    abrupt = True
    parameters = (Parameter(name="difference", unit="N m", lower=-1e3, upper=1e3),)
    twin = "torque_offset"
    shown_by = (
        "the same speeds in both directions, and rest without friction to tell it from an offset"
    )

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        add_constant_torque(spec, joints[0], -0.5 * values["difference"])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"difference": scales.excess_nm}]]

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return np.full_like(motion.velocity, -0.5 * values["difference"])


@final
class LoadDependentFriction(Effect):
    """Dry friction that grows with the torque of the drive. MuJoCo cannot express it."""

    name = "load_dependent_friction"
    needs_drive = True
    abrupt = True
    seen_over = "drive"
    costly = True
    parameters = (Parameter(name="coefficient", unit="1", lower=0.0, upper=0.9),)
    native = False
    shown_by = "reversals under different loads"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        add_dry_friction(spec, joints[0], 0.0)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        share = 0.5 * scales.excess_nm / max(scales.torque_nm, 1e-9)
        return [[{"coefficient": min(max(share, 1e-3), 0.3)}]]

    @override
    def extra_friction(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        return np.asarray(values["coefficient"] * np.abs(motion.drive))

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        level = values["coefficient"] * np.abs(motion.drive)
        return -level * sign(motion.velocity, SIGN_WIDTH_RAD_S)


@final
class CoupledFriction(Effect):
    """Viscous friction between two joints (a fixed tendon with damping)."""

    name = "coupled_friction"
    scope = Scope.PAIR
    parameters = (Parameter(name="viscous", unit="N m s/rad", lower=0.0, upper=1e4),)
    shown_by = "both joints moving, together and against each other"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        name = free_name(spec.tendons, f"{joints[0]}_{joints[1]}_coupled_friction")
        tendon = spec.add_tendon(name=name)
        tendon.damping[0] = values["viscous"]
        tendon.wrap_joint(joints[0], 1.0)
        tendon.wrap_joint(joints[1], -1.0)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"viscous": 0.5 * scales.excess_nm / scales.velocity_rad_s}]]

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        if motion.other_velocity is None:
            return None
        return -values["viscous"] * (motion.velocity - motion.other_velocity)
