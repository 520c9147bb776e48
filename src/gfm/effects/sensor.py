"""What the sensors report."""

from __future__ import annotations

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
    Values,
    angle,
    find_joint,
)


@final
class EncoderOffset(Effect):
    """The reported position is the true one plus an offset: a shifted zero (MuJoCo's `ref`)."""

    name = "encoder_offset"
    law_of = "position"
    displaces = True
    confused_with = ("gravity_direction", "torque_offset")
    parameters = (Parameter(name="offset", unit="rad", lower=-3.2, upper=3.2),)
    shown_by = "rest in several postures under gravity"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        joint = find_joint(spec, joints[0])
        joint.ref += angle(spec, joint, values["offset"])

    @override
    def compensation(
        self, model: mujoco.MjModel, joints: Sequence[str], values: Values
    ) -> Compensation | None:
        shift = np.zeros(model.nq)
        shift[model.jnt_qposadr[model.joint(joints[0]).id]] = values["offset"]
        return Compensation(shift=shift)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"offset": 0.01}]]
