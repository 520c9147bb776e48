"""In which unit positions are, and how they become rad.

Shape letters: T rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.importing.guess.names import DEGREES, RADIANS, words
from gfm.importing.guess.robot import Robot

_TURN = 2.0 * np.pi
#: Where LeRobot's normalised positions end: calibrated ranges are mapped to it, and clipped.
_END = 100.0
#: A joint that moves by less stands still, whatever its unit.
_MOVES = 0.1
#: How far a ratio may lie from degrees over rad: servos give way, or overshoot.
_NEAR = 2.0
#: Correlation from which a joint follows its commands.
_FOLLOWS = 0.8


class Unit(StrEnum):
    """What positions are counted in."""

    RAD = "rad"
    DEGREES = "degrees"
    NORMALISED = "normalised"


@dataclass(frozen=True, kw_only=True)
class Told:
    """A unit, and how it was told."""

    unit: Unit
    why: str


def named_unit(column: str) -> Unit | None:
    """Returns the unit that a column's name says."""
    said = set(words(column))
    if said & DEGREES:
        return Unit.DEGREES
    return Unit.RAD if said & RADIANS else None


def unit_of(column: str, otherwise: Told) -> Told:
    """Returns the unit that a column's name says, or another one where it says none."""
    named = named_unit(column)
    return Told(unit=named, why=f"{named}, as the name says") if named else otherwise


def told_unit(values: Mapping[str, Array], robot: Robot, *, lerobot: bool) -> Told:
    """Returns the unit of positions, by their size.

    Args:
        values: Measured and commanded, by joint, as they are in the file; grippers left out.
        robot: The model's ranges.
        lerobot: Written by LeRobot, which knows three units; else normalised ones are not expected.

    Raises:
        ConfigError: several units explain the numbers.
    """
    turning = {name: x for name, x in values.items() if name not in robot.slides}
    reaches = {name: float(np.abs(x).max()) for name, x in turning.items()}
    reach = max(reaches.values(), default=0.0)
    if reach <= _TURN:
        return Told(unit=Unit.RAD, why=f"rad: nothing beyond 2 pi (at most {reach:.3g})")
    told = _by_the_end(turning, reach) if lerobot else _by_the_ranges(turning, reach, robot)
    if told is None:
        others = "degrees, or normalised to 100" if lerobot else "rad of several turns, or degrees"
        widest = max(reaches, key=reaches.__getitem__)
        raise ConfigError(
            f"{widest} reaches {reach:.4g}: {others}; expected a unit that can be told (--unit "
            f"{'|'.join(Unit)} says which, for all joints)"
        )
    return told


def _by_the_end(values: Mapping[str, Array], reach: float) -> Told | None:
    if reach > _END:
        why = f"degrees: reaches {reach:.4g}; LeRobot's normalised positions end at 100"
        return Told(unit=Unit.DEGREES, why=why)
    if reach == _END:
        joint = next(name for name, x in values.items() if np.abs(x).max() == _END)
        why = f"normalised to the model's range: {joint} ends exactly at 100, where LeRobot clips"
        return Told(unit=Unit.NORMALISED, why=why)
    return None


def _by_the_ranges(values: Mapping[str, Array], reach: float, robot: Robot) -> Told | None:
    limited = {name: x for name, x in values.items() if name in robot.ranges}
    strange = [name for name, x in limited.items() if not _fits(x, robot.ranges[name])]
    if limited and not strange:
        return Told(unit=Unit.RAD, why=f"rad: within the model's ranges (at most {reach:.3g})")
    if limited and all(_fits(np.radians(x), robot.ranges[name]) for name, x in limited.items()):
        _check_alike(values, strange[0])
        why = f"degrees: as rad {strange[0]} leaves the model's range, as degrees none does"
        return Told(unit=Unit.DEGREES, why=why)
    return None


def _check_alike(values: Mapping[str, Array], in_degrees: str) -> None:
    """Refuses a joint beside one in degrees that moves so little that it may be in rad."""
    for name, x in values.items():
        reach = float(np.abs(x).max())
        if name != in_degrees and reach <= _TURN and np.ptp(x) > _MOVES:
            raise ConfigError(
                f"{in_degrees} is in degrees, for as rad it leaves the model's range; {name} "
                f"reaches {reach:.3g}: rad, or degrees; expected --unit degrees if all joints are "
                "(else save the mapping that this prints, and take `scale` from joints in rad)"
            )


def _fits(values: Array, limits: tuple[float, float]) -> bool:
    """Returns whether positions lie in a range, by half of its width more or less."""
    low, high = limits
    room = 0.5 * (high - low)
    return bool(values.min() > low - room and values.max() < high + room)


def check_same_unit(joint: str, measured: Array, told: Array) -> None:
    """Refuses a joint that follows its commands some 57 times as wide, or as narrow.

    Args:
        joint: Whose.
        measured: Positions, shape (T,).
        told: Commands of the same rows, shape (T,).

    Raises:
        ConfigError: one of them is in degrees, the other in rad.
    """
    widths = float(np.std(measured)), float(np.std(told))
    if min(widths) <= 0.0 or np.corrcoef(measured, told)[0, 1] < _FOLLOWS:
        return
    ratio = max(widths) / min(widths)
    if 1.0 / _NEAR < np.radians(ratio) < _NEAR:
        degrees = "measured" if widths[0] > widths[1] else "commanded"
        raise ConfigError(
            f"{joint}: {degrees} positions are {ratio:.3g} times as wide as the others, as degrees "
            "are beside rad; expected one unit (a mapping of your own gives each its scale)"
        )


def to_rad(unit: Unit, joint: str, robot: Robot, *, percent: bool) -> tuple[float, float]:
    """Returns scale and offset from a unit to rad.

    Args:
        unit: Of the file.
        joint: Whose.
        robot: Its ranges.
        percent: Counted from 0 to 100 over its range, as LeRobot does with grippers.

    Raises:
        ConfigError: a normalised joint has no range in the model.
    """
    if unit is Unit.RAD or (joint in robot.slides and not percent):
        return 1.0, 0.0
    if unit is Unit.DEGREES and not percent:
        return float(np.radians(1.0)), 0.0
    if joint not in robot.ranges:
        raise ConfigError(
            f"{joint} is normalised, and has no range in the model; expected one (range in MJCF)"
        )
    low, high = robot.ranges[joint]
    if percent:
        return (high - low) / _END, low
    return (high - low) / (2.0 * _END), (high + low) / 2.0
