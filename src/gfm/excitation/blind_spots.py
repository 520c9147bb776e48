"""Which effects recordings could not have shown, and which motion would.

From simple statistics of how the joints moved (`gfm.excitation.sightings`); no model is needed, and
none is asked. A threshold is where the effect begins to look like another one or like nothing, for
joints in radians; each is explained where it stands. What is not listed may still be hidden by
noise: only a fit can tell.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gfm.core import Trajectory
from gfm.excitation.programme import FAMILIES
from gfm.excitation.sightings import Sighting, sightings

#: A joint that covers less has not moved, rad: play, noise and sag reach that far.
_MOVED = 0.02
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
#: Stands for all effects of a joint, where it did not move.
ANY = "any"


@dataclass(frozen=True, kw_only=True)
class BlindSpot:
    """An effect that recordings could not have shown.

    Attributes:
        effect: Name in the effect library, or `ANY` for all effects of joints that did not move.
        joints: Where; empty for an effect of the whole robot.
        why: What the recordings lack, in words with figures.
        motion: What would show it: label of a motion of `gfm excite`, and words.
    """

    effect: str
    joints: tuple[str, ...]
    why: str
    motion: str


@dataclass(frozen=True, kw_only=True)
class _Rule:
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


def blind_spots(
    recordings: Sequence[Trajectory], torque_limit_nm: Mapping[str, float] | None = None
) -> tuple[BlindSpot, ...]:
    """Returns the effects that recordings could not have shown, and the motion that would.

    Args:
        recordings: Of one robot, with the same joints in one order; those that are fitted to.
        torque_limit_nm: Of the drives, by joint: without one nothing is said of saturation.
    """
    if not recordings:
        return ()
    seen = sightings(recordings)
    still = tuple(one.joint for one in seen if one.span < _MOVED)
    moved = [one for one in seen if one.span >= _MOVED]
    found = [_still(still)] if still else []
    for rule in (*_RULES, _saturation(torque_limit_nm or {})):
        lacking = {one.joint: words for one in moved if (words := rule.lack(one))}
        one_is_enough = rule.whole and len(lacking) < len(moved)
        if not lacking or one_is_enough or len(seen) < rule.joints:
            continue
        found.append(
            BlindSpot(
                effect=rule.effect,
                joints=() if rule.whole else tuple(lacking),
                why=f"{_listed(lacking)}; expected {rule.expected}",
                motion=_motion(rule.motion),
            )
        )
    return tuple(found)


def _still(joints: tuple[str, ...]) -> BlindSpot:
    return BlindSpot(
        effect=ANY,
        joints=joints,
        why=f"moved over less than {_MOVED:g} rad",
        motion="all: nothing is seen of a joint that stands still",
    )


def _listed(lacking: Mapping[str, str]) -> str:
    """Returns "a, b: moved over 0.1 rad; c: moved over 0.2 rad"."""
    joints: dict[str, list[str]] = {}
    for joint, words in lacking.items():
        joints.setdefault(words, []).append(joint)
    return "; ".join(f"{', '.join(names)}: {words}" for words, names in joints.items())


def _motion(label: str) -> str:
    family = next(one for one in FAMILIES if one.label == label)
    return f"{label}: {family.words}"


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


def _saturation(limits: Mapping[str, float]) -> _Rule:
    def unused(seen: Sighting) -> str:
        limit = limits.get(seen.joint, np.inf)
        if seen.peak_torque is None or not np.isfinite(limit):
            return ""
        if seen.peak_torque >= _LIMIT_SHARE * limit:
            return ""
        return f"took {seen.peak_torque:.3g} of {limit:.3g} N m"

    return _Rule(
        effect="torque_saturation",
        motion="bursts",
        lack=unused,
        expected=f"{100 * _LIMIT_SHARE:.0f} % of what the drive may give",
    )


_BOTH = f"at least {100 * _BOTH_WAYS:.0f} %"

_RULES = (
    _Rule(
        effect="coulomb_friction",
        motion="ladder",
        lack=_few_reversals,
        expected=f"at least {_REVERSALS} reversals",
    ),
    _Rule(
        effect="viscous_friction",
        motion="ladder",
        lack=partial(_missing_speeds, (0, 2)),
        expected="slow and fast motion: at one speed it is dry friction",
    ),
    _Rule(
        effect="quadratic_drag",
        motion="ladder",
        lack=partial(_missing_speeds, (0, 1, 2)),
        expected="three speeds: at two it is viscous friction",
    ),
    _Rule(
        effect="stribeck_friction",
        motion="ladder",
        lack=lambda seen: _missing_speeds((0,), seen) or _few_reversals(seen),
        expected="slow motion with reversals",
    ),
    _Rule(effect="asymmetric_friction", motion="ladder", lack=_one_way, expected=_BOTH),
    _Rule(
        effect="load_dependent_friction",
        motion="load_reversals",
        lack=_even_load,
        expected=f"at least {100 * _LOAD_SPREAD:.0f} %",
    ),
    _Rule(
        effect="coupled_friction",
        motion="multisine",
        lack=_alone,
        expected=f"at least {_LEAST_S:g} s",
        joints=2,
    ),
    _Rule(
        effect="joint_spring",
        motion="sweep",
        lack=partial(_too_narrow, _SPRING_SPAN),
        expected=f"at least {_SPRING_SPAN:g} rad: over less it is a constant torque",
    ),
    _Rule(
        effect="payload",
        motion="holds",
        lack=partial(_too_narrow, _POSTURE_SPAN),
        expected=f"{_POSTURE_SPAN:g} rad of one joint at least",
        whole=True,
    ),
    _Rule(
        effect="gravity_direction",
        motion="holds",
        lack=partial(_too_narrow, _POSTURE_SPAN),
        expected=f"{_POSTURE_SPAN:g} rad of one joint at least",
        whole=True,
    ),
    _Rule(
        effect="armature",
        motion="bursts",
        lack=partial(_slow_motion, _INERTIA_HZ),
        expected=f"at least {_INERTIA_HZ:g} Hz",
    ),
    _Rule(
        effect="command_delay",
        motion="steps",
        lack=_slow_command,
        expected=f"{_COMMAND_HZ:g} Hz of one joint at least: below, a delay and a lag are alike",
        whole=True,
    ),
    _Rule(
        effect="actuator_lag",
        motion="steps",
        lack=_slow_command,
        expected=f"at least {_COMMAND_HZ:g} Hz: below, a lag and a delay are alike",
    ),
    _Rule(effect="torque_offset", motion="load_reversals", lack=_one_way, expected=_BOTH),
    _Rule(
        effect="cogging_torque",
        motion="sweep",
        lack=_ripples,
        expected=f"whole periods of {_RIPPLES} a turn ({2 * np.pi / _RIPPLES:.2g} rad)",
    ),
    _Rule(
        effect="backlash",
        motion="load_reversals",
        lack=_one_sided,
        expected=f"{_REVERSALS} reversals, and a load that changes its sign",
    ),
    _Rule(
        effect="joint_elasticity",
        motion="multisine",
        lack=partial(_slow_motion, _RESONANCE_HZ),
        expected=f"at least {_RESONANCE_HZ:g} Hz",
    ),
    _Rule(
        effect="encoder_offset",
        motion="holds",
        lack=partial(_too_narrow, _ANGLE_SPAN),
        expected=f"at least {_ANGLE_SPAN:g} rad: over less it is a constant torque",
    ),
)
