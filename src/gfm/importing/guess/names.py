"""What a column's name says: which joint, measured or told, and of which kind."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from gfm.core import CommandKind


def _words(listed: str) -> frozenset[str]:
    return frozenset(listed.split())


#: Words of a name that say that something was told, not measured.
TOLD = _words(
    "action cmd cmds command commanded commands con control ctrl des desired goal goals output ref "
    "reference setpoint target targets"
)
_KINDS = {
    CommandKind.VELOCITY: _words("dq qd qdot qvel speed speeds vel velocities velocity"),
    CommandKind.EFFORT: _words("effort efforts tau torque torques"),
    CommandKind.POSITION: _words("angle angles pos position positions q qpos"),
}
#: Words beside which a measurement that names no kind is a position ("main": the bus of an arm's
#: motors in LeRobot's datasets of version 2).
_PLAIN = _words(
    "actual deg degrees feedback joint joints main meas measured motor observation present rad "
    "state states"
)
#: Words of what is neither of the three kinds, whatever else is named.
OTHER = _words(
    "acc acceleration accelerations current duty enable enabled err error gain index kd kp load "
    "max min pwm stamp temp temperature time timestamp voltage"
)
#: Words of what was measured itself: such a column comes before one that was filtered or computed.
MEASURED = _words("actual meas measured")
DEGREES = _words("deg degree degrees")
RADIANS = _words("rad radian radians")
#: Words of joints' names that a file may leave out.
_GENERIC = _words("axis joint link motor servo")


@dataclass(frozen=True, kw_only=True)
class Role:
    """What a signal is.

    Attributes:
        told: A command, not a measurement.
        kind: None where the name of a command does not say.
    """

    told: bool
    kind: CommandKind | None


def words(name: str) -> tuple[str, ...]:
    """Returns the words and numbers of a name, in lower case."""
    found = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+", name)
    return tuple(word.lower() for word in found)


def has_word(name: str, use: Sequence[str]) -> bool:
    """Returns whether one of the words that were asked for stands in a name: "left"."""
    return bool({one.lower() for one in use} & {*words(name)})


def role_of(rest: Sequence[str], *, told: bool = False) -> Role | None:
    """Returns what the words of a name say beside the joint's; None where that is no signal.

    Args:
        rest: The words.
        told: It was told, whatever they say.
    """
    said = {word for word in rest if not word.isdigit()}
    if said & OTHER:
        return None
    told = told or bool(said & TOLD)
    kind = next((kind for kind, named in _KINDS.items() if said & named), None)
    if kind is None and not told:
        kind = CommandKind.POSITION if said <= _PLAIN else None
        return None if kind is None else Role(told=False, kind=kind)
    return Role(told=told, kind=kind)


def joint_of(name: Sequence[str], joints: Sequence[str]) -> tuple[str | None, tuple[str, ...]]:
    """Returns the joint that a name names, and its other words.

    The longest name counts; words like "joint" may be missing in the file.
    """
    full = sorted(((words(j), j) for j in joints), key=lambda one: -len(one[0]))
    short = [(tuple(w for w in said if w not in _GENERIC), joint) for said, joint in full]
    for said, joint in [*full, *(one for one in short if not all(w.isdigit() for w in one[0]))]:
        place = next((i for i in range(len(name)) if tuple(name[i : i + len(said)]) == said), None)
        if said and place is not None:
            return joint, (*name[:place], *name[place + len(said) :])
    return None, tuple(name)
