"""Which motion shows which effect."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from gfm.excitation.motion import Purpose, Shape
from gfm.excitation.multisine import crest_multisine
from gfm.excitation.shapes import (
    bursts,
    friction_ladder,
    holds,
    load_reversals,
    steps,
    sweep,
    wander,
)
from gfm.excitation.waypoints import multisine


@dataclass(frozen=True, kw_only=True)
class Family:
    """One kind of motion.

    Attributes:
        label: Its name.
        words: What the robot does in it.
        shape: Makes it.
        shows: The effects that it is there for, by name.
        purpose: Training, or held out to measure errors on.
    """

    label: str
    words: str
    shape: Shape
    shows: tuple[str, ...] = ()
    purpose: Purpose = Purpose.TRAINING


FAMILIES = (
    Family(
        label="holds",
        words="rests in postures all over the range",
        shape=holds,
        shows=(
            "gravity_direction",
            "payload",
            "encoder_offset",
            "torque_offset",
            "joint_spring",
            "actuator_gain",
        ),
    ),
    Family(
        label="ladder",
        words="back and forth at constant speeds, from creeping to fast",
        shape=friction_ladder,
        shows=(
            "coulomb_friction",
            "viscous_friction",
            "quadratic_drag",
            "stribeck_friction",
            "asymmetric_friction",
        ),
    ),
    Family(
        label="load_reversals",
        words="slow reversals in postures all over the range, under different loads",
        shape=load_reversals,
        shows=(
            "load_dependent_friction",
            "drive_loss",
            "drive_dead_zone",
            "coulomb_friction",
            "asymmetric_friction",
            "torque_offset",
            "actuator_gain",
            "backlash",
        ),
    ),
    Family(
        label="sweep",
        words="slowly to both ends of the range and back",
        shape=sweep,
        shows=("cogging_torque", "joint_spring", "encoder_offset"),
    ),
    Family(
        label="multisine",
        words="a band of sines, each joint with frequencies of its own",
        shape=crest_multisine,
        shows=(
            "armature",
            "payload",
            "joint_elasticity",
            "actuator_lag",
            "command_delay",
            "servo_delay",
            "position_delay",
            "effort_delay",
            "clock_offset",
            "coupled_friction",
            "quadratic_drag",
            "backlash",
        ),
    ),
    Family(
        label="steps",
        words="steps between three levels, as fast as allowed",
        shape=steps,
        shows=(
            "command_delay",
            "servo_delay",
            "position_delay",
            "effort_delay",
            "clock_offset",
            "actuator_lag",
            "joint_elasticity",
        ),
    ),
    Family(
        label="bursts",
        words="bursts at the largest accelerations, in several postures",
        shape=bursts,
        shows=("torque_saturation", "armature", "actuator_gain", "joint_elasticity"),
    ),
    Family(
        label="waypoints",
        words="moves through random postures, with short rests",
        shape=wander,
        purpose=Purpose.HELDOUT,
    ),
    Family(
        label="four_sines",
        words="sums of four slow sines",
        shape=multisine,
        purpose=Purpose.HELDOUT,
    ),
)


def families_for(effects: Collection[str]) -> tuple[Family, ...]:
    """Returns the motions that show any of `effects`, and those to measure errors on.

    All of them where no effect is named, or one that no motion is there for.
    """
    known = {effect for family in FAMILIES for effect in family.shows}
    if not effects or not known.issuperset(effects):
        return FAMILIES
    return tuple(
        family
        for family in FAMILIES
        if family.purpose is Purpose.HELDOUT or not set(effects).isdisjoint(family.shows)
    )


def shown_by(effect: str) -> tuple[str, ...]:
    """Returns the labels of the motions that are there for an effect."""
    return tuple(family.label for family in FAMILIES if effect in family.shows)
