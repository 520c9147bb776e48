"""What each effect takes to be seen: a rule for every one that motions can show.

A threshold is where the effect begins to look like another one or like nothing, for joints in
radians; each is explained where it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gfm.excitation.sightings import Sighting

#: With fewer reversals, a step of the friction's sign is one or two events.
_REVERSALS = 4
#: Speeds, and two joints side by side, that are seen for less time hardly weigh in a fit, s.
_LEAST_S = 0.5
#: With less than this the rarer way, friction and a constant torque look alike.
_BOTH_WAYS = 0.15
#: Over less, a spring (and gravity on a wrong angle) looks like a constant torque, rad.
_SPRING_SPAN, _ANGLE_SPAN = 0.5, 0.3
#: Over less, no posture differs enough for gravity to turn, rad.
_POSTURE_SPAN = 0.6
#: Ripples up to so many a turn are common; all of them should complete a period.
_RIPPLES = 12
#: Below, a delay and a lag of some 10 ms shift the motion alike, and by little, Hz.
_COMMAND_HZ = 0.2
#: Below, inertia takes little of the torque; a resonance is not excited, Hz.
_INERTIA_HZ, _RESONANCE_HZ = 0.2, 0.4
#: Load that varies less shows one friction, whatever it depends on.
_LOAD_SPREAD = 0.4
#: Teeth change sides where the load changes its sign: it should be the other for so long, s.
_LOAD_BACKWARD_S = 0.2
#: A limit beyond what was used by this factor would not have been met.
_LIMIT_SHARE = 0.8


@dataclass(frozen=True, kw_only=True)
class Rule:
    """What an effect takes to be seen.

    Attributes:
        effect: Its name.
        motion: Label of the motion that shows it.
        lack: Says what a sighting lacks ("moved over 0.1 rad"), or nothing.
        expected: In words.
        whole: Whether one joint is enough: an effect of the whole robot.
        joints: How many a robot must have for it.
    """

    effect: str
    motion: str
    lack: Callable[[Sighting], str]
    expected: str
    whole: bool = False
    joints: int = 1


def _too_narrow(least: float, seen: Sighting) -> str:
    return f"moved over {seen.span:.3g} rad" if seen.span < least else ""


def _few_reversals(seen: Sighting) -> str:
    return f"{seen.reversals} reversals" if seen.reversals < _REVERSALS else ""


def _missing_speeds(bands: Sequence[int], seen: Sighting) -> str:
    names = ("slow", "middling", "fast")
    missing = [names[i] for i in bands if seen.bands_s[i] < _LEAST_S]
    if not missing:
        return ""
    return f"no {' or '.join(missing)} motion (top speed {seen.top_speed:.2g} rad/s)"


def _one_way(seen: Sighting) -> str:
    if seen.backward >= _BOTH_WAYS:
        return ""
    return f"moved the rarer way {100 * seen.backward:.0f} % of the time"


def _slow_motion(least: float, seen: Sighting) -> str:
    return f"moved at {seen.motion_hz:.2g} Hz" if seen.motion_hz < least else ""


def _slow_command(seen: Sighting) -> str:
    if seen.command_hz >= _COMMAND_HZ:
        return ""
    return f"commanded at {seen.command_hz:.2g} Hz" if seen.command_hz else "one command"


def _even_load(seen: Sighting) -> str:
    if seen.load_spread is None or seen.load_spread >= _LOAD_SPREAD:
        return ""
    return f"moved under a load that varied by {100 * seen.load_spread:.0f} %"


def _one_sided(seen: Sighting) -> str:
    """Says that the load never changed its sign; without torques, that the motion hardly did."""
    if seen.load_backward_s is None:
        return _few_reversals(seen)
    if seen.load_backward_s >= _LOAD_BACKWARD_S:
        return ""
    return f"loaded the rarer way for {seen.load_backward_s:.2g} s"


def _alone(seen: Sighting) -> str:
    if seen.beside_s >= _LEAST_S:
        return ""
    return f"moved beside another, not as one, for {seen.beside_s:.2g} s"


def _ripples(seen: Sighting) -> str:
    per_turn = int(np.ceil(2 * np.pi / max(seen.span, 1e-9)))
    if per_turn <= _RIPPLES:
        return ""
    return f"moved over {seen.span:.2g} rad: ripples of less than {per_turn} a turn are not whole"


def saturation_rule(limits: Mapping[str, float]) -> Rule:
    """Returns the rule for a saturation, by the known torque limits of the drives, N m."""

    def unused(seen: Sighting) -> str:
        limit = limits.get(seen.joint, np.inf)
        if seen.peak_torque is None or not np.isfinite(limit):
            return ""
        if seen.peak_torque >= _LIMIT_SHARE * limit:
            return ""
        return f"took {seen.peak_torque:.3g} of {limit:.3g} N m"

    return Rule(
        effect="torque_saturation",
        motion="bursts",
        lack=unused,
        expected=f"{100 * _LIMIT_SHARE:.0f} % of what the drive may give",
    )


_BOTH = f"at least {100 * _BOTH_WAYS:.0f} %"

RULES = (
    Rule(
        effect="coulomb_friction",
        motion="ladder",
        lack=_few_reversals,
        expected=f"at least {_REVERSALS} reversals",
    ),
    Rule(
        effect="viscous_friction",
        motion="ladder",
        lack=partial(_missing_speeds, (0, 2)),
        expected="slow and fast motion: at one speed it is dry friction",
    ),
    Rule(
        effect="quadratic_drag",
        motion="ladder",
        lack=partial(_missing_speeds, (0, 1, 2)),
        expected="three speeds: at two it is viscous friction",
    ),
    Rule(
        effect="stribeck_friction",
        motion="ladder",
        lack=lambda seen: _missing_speeds((0,), seen) or _few_reversals(seen),
        expected="slow motion with reversals",
    ),
    Rule(effect="asymmetric_friction", motion="ladder", lack=_one_way, expected=_BOTH),
    Rule(
        effect="load_dependent_friction",
        motion="load_reversals",
        lack=_even_load,
        expected=f"at least {100 * _LOAD_SPREAD:.0f} %",
    ),
    Rule(
        effect="drive_loss",
        motion="load_reversals",
        lack=_even_load,
        expected=f"at least {100 * _LOAD_SPREAD:.0f} %",
    ),
    Rule(
        effect="drive_dead_zone",
        motion="load_reversals",
        lack=_even_load,
        expected=f"at least {100 * _LOAD_SPREAD:.0f} %",
    ),
    Rule(
        effect="coupled_friction",
        motion="multisine",
        lack=_alone,
        expected=f"at least {_LEAST_S:g} s",
        joints=2,
    ),
    Rule(
        effect="joint_spring",
        motion="sweep",
        lack=partial(_too_narrow, _SPRING_SPAN),
        expected=f"at least {_SPRING_SPAN:g} rad: over less it is a constant torque",
    ),
    Rule(
        effect="payload",
        motion="holds",
        lack=partial(_too_narrow, _POSTURE_SPAN),
        expected=f"{_POSTURE_SPAN:g} rad of one joint at least",
        whole=True,
    ),
    Rule(
        effect="gravity_direction",
        motion="holds",
        lack=partial(_too_narrow, _POSTURE_SPAN),
        expected=f"{_POSTURE_SPAN:g} rad of one joint at least",
        whole=True,
    ),
    Rule(
        effect="armature",
        motion="bursts",
        lack=partial(_slow_motion, _INERTIA_HZ),
        expected=f"at least {_INERTIA_HZ:g} Hz",
    ),
    Rule(
        effect="command_delay",
        motion="steps",
        lack=_slow_command,
        expected=f"{_COMMAND_HZ:g} Hz of one joint at least: below, a delay and a lag are alike",
        whole=True,
    ),
    Rule(
        effect="actuator_lag",
        motion="steps",
        lack=_slow_command,
        expected=f"at least {_COMMAND_HZ:g} Hz: below, a lag and a delay are alike",
    ),
    Rule(effect="torque_offset", motion="load_reversals", lack=_one_way, expected=_BOTH),
    Rule(
        effect="cogging_torque",
        motion="sweep",
        lack=_ripples,
        expected=f"whole periods of {_RIPPLES} a turn ({2 * np.pi / _RIPPLES:.2g} rad)",
    ),
    Rule(
        effect="backlash",
        motion="load_reversals",
        lack=_one_sided,
        expected=f"{_REVERSALS} reversals, and a load that changes its sign",
    ),
    Rule(
        effect="joint_elasticity",
        motion="multisine",
        lack=partial(_slow_motion, _RESONANCE_HZ),
        expected=f"at least {_RESONANCE_HZ:g} Hz",
    ),
    Rule(
        effect="encoder_offset",
        motion="holds",
        lack=partial(_too_narrow, _ANGLE_SPAN),
        expected=f"at least {_ANGLE_SPAN:g} rad: over less it is a constant torque",
    ),
)
