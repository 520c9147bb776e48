"""Words and figures as a reader sees them: verdicts, effects, rounded numbers, what to look for."""

from __future__ import annotations

import inspect
import math
from collections.abc import Sequence
from dataclasses import dataclass

from gfm.diagnosis.evidence.plots import MISFIT
from gfm.diagnosis.output.result import (
    EvidencePlot,
    NamedEffect,
    ParameterEstimate,
    Suspect,
    Verdict,
)
from gfm.effects import effect_library

NOTHING = "–"
NAMES_SHOWN = 4


@dataclass(frozen=True, kw_only=True)
class VerdictWords:
    """A verdict for people: its name, how good the news is, and what it claims."""

    title: str
    tone: str
    meaning: str


@dataclass(frozen=True, kw_only=True)
class EffectWords:
    """An effect for people.

    Attributes:
        law: What it does to the joint, q and v being the joint's position and velocity.
        axis: Word in the x label of the picture that `look_for` describes.
        look_for: What the effect looks like in that picture.
    """

    law: str
    axis: str = ""
    look_for: str = ""


VERDICTS = {
    Verdict.NO_GAP: VerdictWords(
        title="No gap",
        tone="good",
        meaning="What the model gets wrong is no larger than the measurement noise; "
        "nothing was added to it.",
    ),
    Verdict.EXPLAINED: VerdictWords(
        title="Explained",
        tone="good",
        meaning="The effects below account for the gap: what is left is comparable to the "
        "measurement noise.",
    ),
    Verdict.PARTLY_EXPLAINED: VerdictWords(
        title="Partly explained",
        tone="warn",
        meaning="The effects below account for a part of the gap; what is left is not noise.",
    ),
    Verdict.UNEXPLAINED: VerdictWords(
        title="Unexplained",
        tone="bad",
        meaning="There is a gap, and no named effect takes any of it away on held-out recordings.",
    ),
    Verdict.INSUFFICIENT_DATA: VerdictWords(
        title="Insufficient data",
        tone="warn",
        meaning="These recordings cannot decide; the notes say what to record next.",
    ),
}

EFFECTS = {
    "coulomb_friction": EffectWords(
        law="constant torque against the motion",
        axis="velocity",
        look_for="a step at zero velocity, flat on both sides (upwards, where the model has too "
        "much); its half height is the friction torque. A slope on the sides would be viscous "
        "friction, a peak next to the step Stribeck friction.",
    ),
    "viscous_friction": EffectWords(
        law="torque −coefficient · v",
        axis="velocity",
        look_for="a straight line through the origin that falls with velocity (rises, where the "
        "model has too much); its slope is the coefficient. A step at zero would be dry friction, "
        "a bend quadratic drag.",
    ),
    "quadratic_drag": EffectWords(
        law="torque −coefficient · v · |v|",
        axis="velocity",
        look_for="an S through the origin, flat near zero and ever steeper with speed. A straight "
        "line would be viscous friction.",
    ),
    "stribeck_friction": EffectWords(
        law="extra dry friction near standstill: static_excess · exp(−(v / stribeck_velocity)²)",
        axis="velocity",
        look_for="two peaks close to zero velocity that decay with speed, on top of the step of "
        "dry friction.",
    ),
    "asymmetric_friction": EffectWords(
        law="dry friction that differs between the two directions",
        axis="velocity",
        look_for="a step at zero velocity whose two sides differ in height.",
    ),
    "load_dependent_friction": EffectWords(
        law="dry friction that grows with the drive torque: coefficient · |drive|",
        axis="torque",
        look_for="friction that rises linearly with the magnitude of the drive torque; its slope "
        "is the coefficient, its value at zero load the plain dry friction.",
    ),
    "coupled_friction": EffectWords(
        law="viscous torque between two joints: −viscous · (v_a − v_b)",
        axis="velocity",
        look_for="a straight line against the difference of the two velocities, with the opposite "
        "sign on the other joint.",
    ),
    "joint_spring": EffectWords(
        law="torque −stiffness · (q − rest_angle)",
        axis="position",
        look_for="a straight line against position that falls through zero at the rest angle; its "
        "slope is the stiffness. A wave would be cogging or a wrong mass.",
    ),
    "payload": EffectWords(law="point mass on the last link"),
    "gravity_direction": EffectWords(law="the base is tilted: gravity points elsewhere"),
    "armature": EffectWords(law="inertia of the motor side, seen at the joint"),
    "actuator_gain": EffectWords(law="drive torque times scale (1 = as in the model)"),
    "drive_loss": EffectWords(
        law="the stronger the drive, the less arrives: drive · (1 − coefficient · |drive|)"
    ),
    "drive_dead_zone": EffectWords(
        law="the drive gives nothing below a torque, and that much less above it"
    ),
    "command_delay": EffectWords(law="commands take effect later"),
    "servo_delay": EffectWords(law="the drive's torque acts later, feedback included"),
    "position_delay": EffectWords(law="reported positions are those of a moment ago"),
    "effort_delay": EffectWords(law="reported efforts are those of a moment ago"),
    "clock_offset": EffectWords(law="measurements are stamped by another clock than commands"),
    "actuator_lag": EffectWords(law="first-order lag of the command"),
    "torque_saturation": EffectWords(law="drive torque limited: |drive| ≤ limit"),
    "torque_offset": EffectWords(
        law="constant torque",
        axis="velocity",
        look_for="a level that differs from zero by the same amount in both directions of motion.",
    ),
    "cogging_torque": EffectWords(
        law="amplitude · sin(per_revolution · q + phase)",
        axis="position",
        look_for="a wave that repeats a whole number of times per revolution and does not change "
        "with velocity.",
    ),
    "backlash": EffectWords(law="free play between motor side and link"),
    "joint_elasticity": EffectWords(law="spring between motor side and link"),
    "encoder_offset": EffectWords(law="reported position = true position + offset"),
    "surface_contact": EffectWords(
        law="a point of the last link does not get below a level surface"
    ),
    "object_friction": EffectWords(law="friction of the pushed object"),
    "object_mass": EffectWords(law="mass of the pushed object"),
    "object_com": EffectWords(law="centre of mass of the pushed object"),
    "object_damping": EffectWords(law="damping of the pushed object"),
}


def effect_title(name: str) -> str:
    """Returns the effect's name as words."""
    return name.replace("_", " ")


def names_title(effect: NamedEffect) -> str:
    """Returns an effect's name, and those that the recordings do not tell from it."""
    others = dict.fromkeys(effect_title(one.effect) for one in effect.equals)
    return " or ".join([effect_title(effect.effect), *others])


def effect_law(name: str) -> str:
    """Returns what the effect does, in a few words.

    Of an effect that another package offers: the first line of its docstring.
    """
    if name in EFFECTS:
        return EFFECTS[name].law
    offered = effect_library().get(name)
    return (inspect.getdoc(offered) or "").partition("\n")[0] if offered else ""


def joints_title(joints: Sequence[str], effect: str = "") -> str:
    """Returns where an effect acts."""
    if effect.startswith("object_"):
        return "the object"
    return ", ".join(joints) if joints else "whole robot"


def named(effect: NamedEffect | Suspect) -> str:
    """Returns what and where, in one phrase."""
    return f"{effect_title(effect.effect)} ({joints_title(effect.joints, effect.effect)})"


def look_for(plot: EvidencePlot) -> str:
    """Returns the caption of an evidence plot: what it shows and what to look for."""
    if plot.y_label == MISFIT:
        return (
            "Line: position error on training data if this number is another one, all else as "
            "fitted; what is far off counts little. Point: the fitted value. Look for a valley at "
            "the point: the flatter it is, the less the recordings say about this number."
        )
    drawn = {series.style for series in plot.series}
    legend = {
        frozenset({"points", "line"}): "Points: measured. Line: the fitted law.",
        frozenset({"points"}): "Points: measured.",
    }.get(frozenset(drawn), "")
    words = EFFECTS.get(plot.effect)
    if words is not None and words.axis and words.axis in plot.x_label.lower():
        hint = f"Look for {words.look_for}"
    elif drawn == {"points", "line"}:
        hint = (
            "Look for points that follow the line over its whole length; where they leave it, "
            "something else is at work."
        )
    else:
        hint = "Look for structure: a signal without structure is noise."
    return f"{legend} {hint}".strip()


def number(value: float | None) -> str:
    """Returns three significant digits, or a dash for what is not a number."""
    if value is None or not math.isfinite(value):
        return NOTHING
    if abs(value) >= 1000.0:
        return f"{value:,.0f}"
    return f"{value:#.3g}".rstrip(".") if value else "0"


def quantity(value: float | None, unit: str) -> str:
    """Returns the number with its unit; "1" is the unit of pure numbers and is not shown."""
    digits = number(value)
    return digits if digits == NOTHING or unit in {"", "1"} else f"{digits} {unit}"


def some(names: Sequence[str]) -> str:
    """Returns a few names, and how many more there are."""
    more = len(names) - NAMES_SHOWN
    return ", ".join(names[:NAMES_SHOWN]) + (f" and {more} more" if more > 0 else "") or NOTHING


def ratio(value: float, floor: float) -> float | None:
    """Returns value / floor, or None where that means nothing."""
    if not (math.isfinite(value) and math.isfinite(floor) and floor > 0.0):
        return None
    return value / floor


def times(value: float, floor: float, digits: int = 1) -> str:
    """Returns "1.2 ×" for value / floor."""
    share = ratio(value, floor)
    return NOTHING if share is None else f"{share:.{digits}f} ×"


def percent(share: float) -> str:
    """Returns a share of 1 as "42 %"."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else NOTHING


def known_interval(estimate: ParameterEstimate) -> tuple[float, float] | None:
    """Returns the 95 % interval, or None where it is withheld or has no end."""
    if estimate.ci95 is None or not all(math.isfinite(bound) for bound in estimate.ci95):
        return None
    return estimate.ci95


def interval(estimate: ParameterEstimate) -> str:
    """Returns the 95 % interval in words; where it is withheld, the spread."""
    known = known_interval(estimate)
    if known is not None:
        return f"{number(known[0])} … {number(known[1])}"
    if estimate.spread is None:
        return "withheld"
    return f"roughly ± {number(estimate.spread)}"


def duration(seconds: float) -> str:
    """Returns "42.3 s" below a minute, "3:07 min" above it."""
    if not math.isfinite(seconds):
        return NOTHING
    if seconds < 60.0:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} min"
