"""A payload that a diagnosis named, and the robot that is told of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any

import mujoco
import numpy as np

from gfm.core import GfmError
from gfm.experiments.driver import Driver
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


@contextmanager
def carrying(driver: Driver, payload: SetPayload | None) -> Iterator[None]:
    """Tells the robot what it carries; in the end lets go of it, and takes that back.

    Raises:
        BadInputError: it cannot be told.
        RefusedError: the bridge says no.
    """
    try:
        if payload is not None:
            driver.carry(payload)
        yield
    finally:
        with suppress(GfmError):  # where the bridge is gone, that was said already
            driver.release()
        if payload is not None:
            with suppress(GfmError):
                driver.carry(SetPayload(mass_kg=0.0, com_m=np.zeros(3)))
