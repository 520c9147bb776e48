"""What happens between a command and the torque at the joint."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core.checks import Array
from gfm.effects.delays import LEAST_S
from gfm.effects.effect import (
    DRIVE,
    Effect,
    Motion,
    Parameter,
    ProbeGroup,
    Scales,
    Values,
    find_actuator,
)
from gfm.effects.elements import add_cogging, add_constant_torque

#: Activations that follow the command with a first-order lag.
LAGS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)

#: Share of a drive's torque that is lost at most.
MOST_LOST = 0.5


@final
class ActuatorGain(Effect):
    """The drive's torque is that of the model times a factor."""

    name = "actuator_gain"
    law_of = DRIVE
    needs_drive = True
    parameters = (Parameter(name="scale", unit="1", lower=1e-3, upper=50.0),)
    shown_by = "known load: gravity or acceleration"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        drive = find_actuator(spec, joints[0])
        drive.gainprm = np.asarray(drive.gainprm) * values["scale"]
        drive.biasprm = np.asarray(drive.biasprm) * values["scale"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"scale": 1.05}]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        values = {"scale": 1.0 + amplitudes[0] * (group[0]["scale"] - 1.0)}
        # To first order a weak drive looks like minus infinity of it: keep the sign of the answer.
        values["scale"] = max(values["scale"], 0.2)
        return values


@final
class DriveLoss(Effect):
    """The stronger a drive, the less of it arrives: its supply sags, its stages lose voltage.

    To first order in the torque, and at most a half. MuJoCo cannot express it.
    """

    name = "drive_loss"
    law_of = DRIVE
    needs_drive = True
    costly = True
    native = False
    confused_with = ("torque_saturation",)
    parameters = (Parameter(name="coefficient", unit="N^-1 m^-1", lower=0.0, upper=1e3),)
    shown_by = "strong drive torques beside weak ones"

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"coefficient": 0.1 / max(scales.servo_nm, 1e-9)}]]

    @override
    def drive_change(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        share = np.minimum(values["coefficient"] * np.abs(motion.drive), MOST_LOST)
        return np.asarray(-share * motion.drive)


@final
class DriveDeadZone(Effect):
    """A drive gives nothing of a torque below a limit, and that much less of what is above it.

    The dead band of a servo (as a torque: gain times band), dry friction of its motor. MuJoCo
    cannot express it.
    """

    name = "drive_dead_zone"
    law_of = DRIVE
    needs_drive = True
    costly = True
    native = False
    confused_with = ("actuator_gain", "backlash")
    parameters = (Parameter(name="torque", unit="N m", lower=0.0, upper=1e3),)
    shown_by = "weak drive torques beside strong ones"

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"torque": 0.05 * scales.servo_nm}]]

    @override
    def drive_change(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        return np.asarray(-np.clip(motion.drive, -values["torque"], values["torque"]))


@final
class ActuatorLag(Effect):
    """The drive follows its command with a first-order lag."""

    name = "actuator_lag"
    needs_drive = True
    confused_with = ("command_delay",)
    parameters = (Parameter(name="time_constant", unit="s", lower=0.0, upper=1.0, least=LEAST_S),)
    shown_by = "steps and fast changes of the command"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        drive = find_actuator(spec, joints[0])
        if values["time_constant"] > 0.0:
            before = float(drive.dynprm[0]) if drive.dyntype in LAGS else 0.0
            drive.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
            drive.dynprm[0] = before + values["time_constant"]
            drive.actdim = 1

    @override
    def lag_s(self, values: Values) -> float:
        return values["time_constant"]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"time_constant": 0.004}]]


@final
class TorqueSaturation(Effect):
    """The drive's torque is limited."""

    name = "torque_saturation"
    law_of = DRIVE
    needs_drive = True
    abrupt = True
    valleys = ("limit",)
    parameters = (Parameter(name="limit", unit="N m", lower=1e-3, upper=1e4),)
    shown_by = "the largest accelerations and loads"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        drive = find_actuator(spec, joints[0])
        limit = values["limit"]
        limited = drive.forcelimited == mujoco.mjtLimited.mjLIMITED_TRUE or any(drive.forcerange)
        low, high = drive.forcerange if limited else (-math.inf, math.inf)
        drive.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        drive.forcerange = [max(float(low), -limit), min(float(high), limit)]

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        # A fit finds a limit from above, where it cuts off too little: nothing below looks like it.
        # Each cuts off twice as much as the one before. The motion takes less than the drive gives
        # by what friction takes, and by smoothing.
        shares = (1.5, 1.25, 1.12, 1.06, 1.03, 1.0, 0.985, 0.97, 0.94, 0.88, 0.75, 0.5)
        return [[{"limit": share * scales.servo_nm}] for share in shares]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        # The response is far from linear in the limit: a probe either looks like it or does not.
        return dict(group[0]) if amplitudes[0] > 0.2 else None


@final
class TorqueOffset(Effect):
    """A constant torque behind the drive."""

    name = "torque_offset"
    law_of = "position"
    parameters = (Parameter(name="torque", unit="N m", lower=-1e3, upper=1e3),)
    shown_by = "rest, and the same speeds in both directions"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        add_constant_torque(spec, joints[0], values["torque"])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"torque": 0.5 * scales.excess_nm}]]

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return np.full_like(motion.position, values["torque"])


@final
class CoggingTorque(Effect):
    """A torque that repeats over the angle: magnets and slots, gear teeth."""

    name = "cogging_torque"
    law_of = "position"
    seen_over = "position"
    parameters = (
        Parameter(name="amplitude", unit="N m", lower=0.0, upper=1e3),
        Parameter(name="per_revolution", unit="1", lower=1.0, upper=400.0),
        Parameter(name="phase", unit="rad", lower=-10.0, upper=10.0),
    )
    fixed = ("per_revolution",)
    shown_by = "slow motion over more than a period"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        periods = round(values["per_revolution"])
        add_cogging(spec, joints[0], values["amplitude"], periods, values["phase"])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        amplitude = 0.5 * scales.excess_nm
        return [
            [
                {"amplitude": amplitude, "per_revolution": float(order), "phase": phase}
                for phase in (0.0, 0.5 * math.pi)
            ]
            for order in scales.cogging_per_revolution
        ]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        return {
            "amplitude": group[0]["amplitude"] * math.hypot(*amplitudes),
            "per_revolution": group[0]["per_revolution"],
            "phase": math.atan2(amplitudes[1], amplitudes[0]),
        }

    @override
    def canonical(self, values: Values) -> Values:
        phase = math.remainder(values["phase"], 2.0 * math.pi)
        return {**values, "phase": phase}

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        angle = round(values["per_revolution"]) * motion.position + values["phase"]
        return values["amplitude"] * np.sin(angle)
