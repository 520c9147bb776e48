"""A payload that a diagnosis named, for the robot to be told of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from gfm_wire import SetPayload

#: Of the effect, and of the body that stands for it in a corrected model.
_NAME = "payload"


def named_payload(diagnosis: Mapping[str, Any]) -> SetPayload | None:
    """Returns the payload that a diagnosis names, as a robot is told of it; None without one.

    Args:
        diagnosis: As its report.json has it.
    """
    for effect in diagnosis["effects"]:
        if effect["effect"] == _NAME:
            said = {name: float(one["value"]) for name, one in effect["parameters"].items()}
            com = np.array([said["com_x"], said["com_y"], said["com_z"]])
            return SetPayload(mass_kg=said["mass"], com_m=com)
    return None


def bearing_payload(corrected: mujoco.MjSpec) -> mujoco.MjSpec:
    """Returns a corrected model whose gravity compensation bears the payload, too.

    Args:
        corrected: With a body for the payload; it stays as it is.
    """
    spec = corrected.copy()
    spec.body(_NAME).gravcomp = 1.0
    return spec
