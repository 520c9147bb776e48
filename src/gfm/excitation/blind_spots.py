"""Which effects recordings could not have shown, and which motion would.

From simple statistics of how the joints moved (`gfm.excitation.sightings`) and what each effect
takes to be seen (`gfm.excitation.rules`); no model is needed, and none is asked. What is not listed
may still be hidden by noise: only a fit can tell.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gfm.core import Trajectory
from gfm.excitation.programme import FAMILIES
from gfm.excitation.rules import RULES, saturation_rule
from gfm.excitation.sightings import sightings

#: A joint that covers less has not moved, rad: play, noise and sag reach that far.
_MOVED = 0.02
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
    for rule in (*RULES, saturation_rule(torque_limit_nm or {})):
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
