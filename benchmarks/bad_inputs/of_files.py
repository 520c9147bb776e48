"""Bad input of `gfm import`, `gfm doctor` and `gfm recording`."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.parquet

import made_bags
import made_datasets
from bad_inputs.making import (
    MODEL,
    Case,
    cases,
    folder,
    half,
    model,
    recording,
    renamed,
    text,
    written,
)
from gfm.recording import write_recording

Topic: TypeAlias = Callable[[made_bags.Maker], list[made_bags.Message]]
MAPPING = """
format = "csv"
time = { column = "t", scale = 1.0 }
command_kind = "position"

[[joints]]
name = "a"
position = { column = "q" }
command = { column = "u" }
"""
URDF = """
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial><mass value="1"/><origin xyz="0 0 -0.15"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><mesh filename="package://arm/upper.stl"/></geometry></collision>
  </link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="10" velocity="5"/></joint>
</robot>
"""
#: The same arm with its elbow welded.
_WITHOUT_B = MODEL.replace('<joint name="b" axis="0 1 0"/>', "").replace(
    '<position name="b" joint="b" kp="20" kv="1"/>', ""
)
_SERVOS = ("--actuators", "position:kp=50,kv=1")
_BAG_JOINTS = {"a": "shoulder", "b": "elbow"}
_DATASET_JOINTS = {"a": "shoulder_pan", "b": "gripper"}


def _table(time_s: Callable[[int], float] = lambda k: 0.01 * k, count: int = 50) -> str:
    rows = [
        f"{time_s(k):.6f},{np.sin(0.1 * k):.6f},{np.sin(0.1 * k + 0.3):.6f}" for k in range(count)
    ]
    return "\n".join(["t,q,u", *rows]) + "\n"


def _named(*, back_s: float = 0.0, measured: float = 1.0, told: float = 1.0) -> str:
    """Makes a table whose columns name their joints; returns its name.

    Args:
        back_s: By how much its clock is set back in the middle.
        measured: Factor of the positions.
        told: Factor of the commands.
    """
    k = np.arange(50)
    time_s = 0.01 * k - back_s * (k > 25)
    values = [measured * np.sin(0.1 * k), told * np.sin(0.1 * k + 0.1)]
    rows = [",".join(f"{x:.6f}" for x in row) for row in zip(time_s, *values, *values, strict=True)]
    return text("run.csv", "\n".join(["t,a_pos,a_cmd,b_pos,b_cmd", *rows]) + "\n")


def _one_in_degrees() -> str:
    """Makes a table in which joint a is in degrees and joint b in rad; returns its name."""
    wave = np.sin(0.1 * np.arange(50))
    rows = [f"{0.01 * k},{57.3 * x},{57.3 * x},{x},{x}" for k, x in enumerate(wave)]
    return text("run.csv", "\n".join(["t,a_pos,a_cmd,b_pos,b_cmd", *rows]) + "\n")


def _mapped(table: str, mapping: str = MAPPING) -> list[str]:
    """Returns the words that import a table by a mapping."""
    return [text("run.csv", table), "--mapping", text("map.toml", mapping), "--out", "out"]


def _guessed(file: str, **names: str) -> list[str]:
    """Returns the words that import a file by a guessed mapping for a model."""
    return [file, "--model", model(renamed(MODEL, **names)), "--yes", "--out", "out"]


def _parquet() -> str:
    t = 0.01 * np.arange(500)
    columns = {"t": t, "a.position": np.sin(t), "a.command": np.sin(t + 0.1)}
    pyarrow.parquet.write_table(pa.table(columns), "run.parquet")
    return "run.parquet"


def _bag(*topics: Topic) -> str:
    def messages(maker: made_bags.Maker) -> list[made_bags.Message]:
        return [message for topic in topics for message in topic(maker)]

    made_bags.write(Path(), "sqlite", messages)
    return "run"


def _other_states(maker: made_bags.Maker) -> list[made_bags.Message]:
    return [(f"/other{topic}", *rest) for topic, *rest in made_bags.states(maker)]


def _jumping(maker: made_bags.Maker) -> list[made_bags.Message]:
    """Returns joint states that are logged evenly, and stamped by a clock that is set back."""
    half = made_bags.COUNT // 2
    stamps = made_bags.STAMP_NS - np.where(np.arange(made_bags.COUNT) < half, 0, 5 * 10**9)
    return [
        (topic, kind, log_ns, maker.joint_state(stamp, made_bags.JOINTS, position=q))
        for (topic, kind, log_ns, _), stamp, q in zip(
            made_bags.states(maker), stamps, made_bags.POSITION, strict=True
        )
    ]


def _without(feature: str) -> str:
    """Makes a LeRobot dataset without one of its features; returns its folder."""
    made_datasets.dataset(Path("data"), "v2.1")
    path = Path("data/meta/info.json")
    about = json.loads(path.read_text())
    del about["features"][feature]
    path.write_text(json.dumps(about))
    for table in Path("data/data").rglob("*.parquet"):
        kept = pyarrow.parquet.read_table(table).drop_columns([feature])
        pyarrow.parquet.write_table(kept, table)
    return "data"


def _one_joint() -> str:
    write_recording(Path("r.mcap"), recording("r").with_joints(["a"]))
    return "r.mcap"


def _full_disk() -> list[str]:
    """Returns the words that export a recording to a disk that is full."""
    words = ["export", written("r"), "--format", "csv", "--out", "tables"]
    with suppress(OSError), Path("filling").open("wb", buffering=0) as file:
        while file.write(bytes(1024)):
            pass
    return words


def _cut(*words: str) -> list[str]:
    return [written("r"), *words, "--out", "part.mcap"]


IMPORT = cases(
    "gfm import",
    ("no mapping", lambda: [text("run.csv", _table()), "--out", "out"]),
    ("nowhere to write to", lambda: _mapped(_table())[:-2]),
    ("a table that is not there", lambda: ["absent.csv", *_mapped(_table())[1:]]),
    ("a table without rows", lambda: _mapped("t,q,u\n")),
    ("a column that is not there", lambda: _mapped(_table().replace("t,q,u", "t,p,u"))),
    ("a word among numbers", lambda: _mapped(_table().replace("0.100000,", "ten,", 1))),
    ("a row that is too short", lambda: _mapped(_table() + "0.6,1\n")),
    ("a clock that jumps back", lambda: _mapped(_table(lambda k: 0.01 * k - (k > 25)))),
    ("a clock that stands still", lambda: _mapped(_table(lambda _: 1.0))),
    ("a mapping that is no TOML", lambda: _mapped(_table(), "hello")),
    ("a mapping with an unknown key", lambda: _mapped(_table(), "speed = 1\n" + MAPPING)),
    ("a mapping without joints", lambda: _mapped(_table(), MAPPING[: MAPPING.index("[[")])),
    (
        "an unknown kind of command",
        lambda: _mapped(_table(), MAPPING.replace('"position"', '"push"', 1)),
    ),
    ("a table whose clock is set back, without a mapping", lambda: _guessed(_named(back_s=0.1))),
    (
        "positions in an unknown unit",
        lambda: _guessed(_named(measured=500.0, told=500.0)),
    ),
    ("measured in degrees, told in radians", lambda: _guessed(_named(measured=57.2958))),
    ("a joint in degrees, another in radians", lambda: _guessed(_one_in_degrees())),
    ("a parquet file cut in half", lambda: _guessed(half(_parquet()))),
    ("a MATLAB file that is none", lambda: _guessed(text("run.mat", "hello"))),
    ("a kind of file that nothing reads", lambda: _guessed(text("run.docx", "hello"))),
    ("a LeRobot dataset without actions", lambda: _guessed(_without("action"), **_DATASET_JOINTS)),
    (
        "a LeRobot dataset without states",
        lambda: _guessed(_without("observation.state"), **_DATASET_JOINTS),
    ),
    (
        "a bag without joint states",
        lambda: _guessed(_bag(made_bags.trajectories), **_BAG_JOINTS),
    ),
    ("a bag without commands", lambda: _guessed(_bag(made_bags.states), **_BAG_JOINTS)),
    (
        "two robots in one bag",
        lambda: _guessed(
            _bag(made_bags.states, _other_states, made_bags.trajectories), **_BAG_JOINTS
        ),
    ),
    (
        "a bag whose clock jumps back by 5 s",
        lambda: _guessed(_bag(_jumping, made_bags.trajectories), **_BAG_JOINTS),
    ),
    ("a bag that is an empty folder", lambda: _guessed(folder("run"), **_BAG_JOINTS)),
    ("a model of another robot", lambda: _guessed(_parquet(), a="x", b="y")),
    ("a guess that is not saved", lambda: [text("run.csv", _table()), "--yes", "--out", "out"]),
    (
        "a results folder that is a file",
        lambda: [*_mapped(_table())[:-1], text("out", "")],
    ),
)
DOCTOR = (
    *cases(
        "gfm doctor",
        ("no recordings", lambda: [model()]),
        ("a model that is not there", lambda: ["absent.xml", written("r"), "--json"]),
        ("a robot by its bare name", lambda: ["panda", written("r"), "--json"]),
        ("a recording that is not there", lambda: [model(), "absent.mcap", "--json"]),
        ("a recording cut in half", lambda: [model(), half(written("r")), "--json"]),
        (
            "a model of another robot",
            lambda: [model(renamed(MODEL, a="x", b="y")), written("r"), "--json"],
        ),
        (
            "a model that has fewer joints than were commanded",
            lambda: [model(_WITHOUT_B), written("r"), "--json"],
        ),
    ),
    Case(
        command="gfm doctor",
        wrong="a URDF whose meshes are missing: it goes on",
        words=lambda: [
            text("arm.urdf", URDF),
            _one_joint(),
            "--actuators",
            "position:kp=50,kv=1",
            "--json",
        ],
        status=0,
    ),
)
RECORDING = cases(
    "gfm recording",
    ("a tool that does not exist", lambda: ["frobnicate"]),
    ("info: a file that is not there", lambda: ["info", "absent.mcap"]),
    ("info: a file that is no recording", lambda: ["info", text("r.mcap", "hello")]),
    ("check: a recording that was cut off", lambda: ["check", half(written("r"))]),
    ("cut: from behind to", lambda: ["cut", *_cut("--from", "2", "--to", "1")]),
    ("cut: past the end", lambda: ["cut", *_cut("--from", "99")]),
    ("cut: a name that exists", lambda: ["cut", written("r"), "--from", "1", "--out", "r.mcap"]),
    (
        "export: an unknown format",
        lambda: ["export", written("r"), "--format", "xls", "--out", "t"],
    ),
    ("plot: a topic that it lacks", lambda: ["plot", written("r"), "--joint-states", "/q"]),
    ("salvage: a file in which nothing is", lambda: ["salvage", text("r.mcap.part", "hello")]),
)
SMALL_DISK = Case(
    command="gfm recording",
    wrong="export: a full disk",
    words=_full_disk,
    small_disk=True,
)
CASES: tuple[Case, ...] = (*IMPORT, *DOCTOR, *RECORDING, SMALL_DISK)
