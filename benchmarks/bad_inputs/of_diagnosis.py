"""Bad input of `gfm diagnose` and `gfm fit`."""

from __future__ import annotations

import numpy as np

from bad_inputs.making import (
    EPOCH_NS,
    MODEL,
    TICKS,
    WITH_OBJECT,
    cases,
    diagnose,
    folder,
    half,
    model,
    recording,
    renamed,
    text,
    written,
)
from gfm.core import CommandKind

_GOOD, _OTHER = recording("any", 0), recording("any", 1)
_MILLISECONDS = EPOCH_NS + TICKS * 10_000
_VELOCITY = MODEL.replace("<position", "<velocity").replace('kp="20" kv="1"', 'kv="1"')
_TABLE = "\n".join(["t,a_pos,b_pos", *(f"{0.01 * k:.2f},{0.001 * k},0.5" for k in range(50))])
_BARE = MODEL[: MODEL.index("  <actuator>")] + "</mujoco>"


def _spoilt(**changes: object) -> list[str]:
    """Returns the words of a diagnosis with one good and one spoilt recording."""
    return diagnose(written("good"), holdout=written("spoilt", 1, **changes))


def _given(what: str) -> list[str]:
    return diagnose(written("r"), given=model(what))


def _mixed_units() -> list[str]:
    scale = np.array([1.0, np.degrees(1.0)])
    return _spoilt(position=scale * _OTHER.position, command=scale * _OTHER.command)


def _nan() -> list[str]:
    position = _OTHER.position.copy()
    position[100, 0] = np.nan
    return _spoilt(position=position)


def _in_use() -> list[str]:
    text(f"{folder('used')}/thesis.tex", "")
    return ["--out", "used"]


DIAGNOSE = cases(
    "gfm diagnose",
    ("no recordings", lambda: ["--model", model(), "--out", "out"]),
    ("no model", lambda: [written("r"), "--out", "out"]),
    ("a recording that is not there", lambda: diagnose("absent.mcap")),
    ("a folder without recordings", lambda: diagnose(folder("empty"))),
    ("a recording that is no MCAP file", lambda: diagnose(text("r.mcap", "hello"))),
    ("an empty file", lambda: diagnose(text("r.mcap", ""))),
    ("a table, without --yes", lambda: diagnose(text("run.csv", _TABLE))),
    ("a table without commands, by --yes", lambda: [*diagnose(text("run.csv", _TABLE)), "--yes"]),
    (
        "a unit for a guess that is not asked for",
        lambda: [*diagnose(written("r")), "--unit", "rad"],
    ),
    ("a recording cut in half", lambda: diagnose(half(written("r")))),
    ("the same recording twice", lambda: diagnose(written("r"), "r.mcap")),
    ("a held-out recording that is learned from", lambda: diagnose(written("r"), holdout="r.mcap")),
    (
        "a copy held out under another name",
        lambda: _spoilt(position=_GOOD.position, command=_GOOD.command),
    ),
    ("a model that is not there", lambda: diagnose(written("r"), given="absent.xml")),
    ("a model that is no XML", lambda: _given("hello")),
    ("a model with an unknown element", lambda: _given("<mujoco><robot/></mujoco>")),
    ("a model without actuators", lambda: _given(_BARE)),
    ("velocity servos for position commands", lambda: _given(_VELOCITY)),
    ("a model of another robot", lambda: _given(renamed(MODEL, a="x", b="y"))),
    (
        "a rule for actuators that makes no sense",
        lambda: diagnose(written("r"), actuators="spring:k=1"),
    ),
    ("no time", lambda: diagnose(written("r"), minutes="0")),
    ("time that is no number", lambda: diagnose(written("r"), minutes="soon")),
    (
        "a results folder that is a file",
        lambda: [written("r"), "--model", model(), "--out", text("out", "")],
    ),
    (
        "a topic that the recording lacks",
        lambda: [*diagnose(written("r")), "--joint-states", "/states"],
    ),
    (
        "positions in degrees, commands in radians",
        lambda: _spoilt(position=np.degrees(_OTHER.position)),
    ),
    ("one joint in degrees, the other in radians", _mixed_units),
    ("NaN among the positions", _nan),
    (
        "stamps in milliseconds taken for seconds",
        lambda: _spoilt(stamp_ns=_MILLISECONDS, command_stamp_ns=_MILLISECONDS),
    ),
    (
        "velocity commands for position servos",
        lambda: _spoilt(command_kind=CommandKind.VELOCITY),
    ),
    ("a joint that never moves", lambda: _spoilt(position=_OTHER.position * np.array([1.0, 0.0]))),
    ("torques that are 0 throughout", lambda: _spoilt(effort=np.zeros((300, 2)))),
    (
        "a command of one joint that is missing",
        lambda: _spoilt(command=_OTHER.command * np.array([1.0, np.nan])),
    ),
    ("recordings of two robots", lambda: _spoilt(joint_names=("a", "c"))),
    ("forces that are not there", lambda: diagnose(written("r"), gfm="forces.npz")),
    ("forces that are no force model", lambda: diagnose(written("r"), gfm=text("f.npz", "hello"))),
    ("an earlier set that is today's", lambda: diagnose(written("r"), since="r.mcap")),
)
FIT = cases(
    "gfm fit",
    ("a recording that is not there", lambda: diagnose(written("r"), "absent.mcap")),
    (
        "no object poses, though the model has an object",
        lambda: diagnose(written("r"), written("s", 1), given=model(WITH_OBJECT)),
    ),
    ("one recording alone, nothing held out", lambda: diagnose(written("r"))),
    (
        "a results folder that is in use",
        lambda: [*diagnose(written("r"), written("s", 1)), *_in_use()],
    ),
    ("less than no time", lambda: diagnose(written("r"), written("s", 1), minutes="-1")),
    (
        "a control period of 0",
        lambda: [*diagnose(written("r"), written("s", 1)), "--period-ms", "0"],
    ),
)
CASES = (*DIAGNOSE, *FIT)
