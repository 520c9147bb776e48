"""ROS bags become recordings, number for number; written by rosbags, read by `gfm import`."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfm.core import CommandKind, RecordingError
from gfm.importing import imported
from gfm.importing.controller_state import LAYOUTS
from gfm.importing.mapping import Mapping, load_mapping
from gfm.importing.ros_bag import read_bag
from gfm.recording import read_recording
from made_bags import (
    COMMAND,
    CONTROLLER_STATE,
    JOINT_STATE,
    JOINTS,
    MULTI_ARRAY,
    POSITION,
    STAMP_NS,
    TRAJECTORY,
    Maker,
    Message,
    arrays,
    controller_states,
    joint_states,
    states,
    trajectories,
    write,
)


def mapping(
    tmp_path: Path,
    columns: tuple[str, str],
    kind: str = "position",
    more: str = "",
    topics: tuple[str, str] = ("/arm/joint_states", "/arm/commands"),
) -> Mapping:
    text = f"""
format = "rosbag"
command_kind = "{kind}"
time = {{ column = "stamp", scale = 1e-9 }}
{more}
[topics]
states = "{topics[0]}"
commands = "{topics[1]}"
[[joints]]
name = "shoulder"
position = "position.shoulder"
command = "{columns[1]}"
[[joints]]
name = "elbow"
position = "position.elbow"
command = "{columns[0]}"
"""
    (tmp_path / "map.toml").write_text(text)
    return load_mapping(tmp_path / "map.toml")


LOGGED = 'command_time = { column = "log_time", scale = 1e-9 }'
COMMANDS = {
    "Float64MultiArray": (arrays, ("data.0", "data.1"), "position", LOGGED, 500),
    "JointTrajectory": (trajectories, ("positions.elbow", "positions.shoulder"), "position", "", 0),
    "JointState": (joint_states, ("effort.elbow", "effort.shoulder"), "effort", "", 0),
    "JointTrajectoryControllerState": (
        controller_states,
        ("desired.positions.elbow", "desired.positions.shoulder"),
        "position",
        "",
        0,
    ),
}
each_bag = pytest.mark.parametrize("kind", ["mcap", "db3", "bag"])


@each_bag
@pytest.mark.parametrize("commands", COMMANDS)
def test_numbers_arrive_exactly(tmp_path: Path, kind: str, commands: str) -> None:
    messages, columns, command_kind, more, later_ns = COMMANDS[commands]
    path = write(tmp_path, kind, lambda maker: states(maker) + messages(maker))
    (trajectory,) = imported([path], mapping(tmp_path, columns, command_kind, more))
    assert trajectory.name == "run"
    assert trajectory.joint_names == ("shoulder", "elbow")
    assert trajectory.command_kind is CommandKind(command_kind)
    np.testing.assert_array_equal(trajectory.stamp_ns, STAMP_NS)
    np.testing.assert_array_equal(trajectory.command_stamp_ns, STAMP_NS + later_ns)
    np.testing.assert_array_equal(trajectory.position, POSITION[:, ::-1])
    np.testing.assert_array_equal(trajectory.command, COMMAND[:, ::-1])
    assert trajectory.velocity is None


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_storage_file_alone_is_a_bag(tmp_path: Path, kind: str) -> None:
    folder = write(tmp_path, kind, lambda maker: states(maker) + arrays(maker))
    (file,) = folder.glob(f"*.{kind}")
    (trajectory,) = imported([file], mapping(tmp_path, ("data.0", "data.1"), more=LOGGED))
    np.testing.assert_array_equal(trajectory.position, POSITION[:, ::-1])


def test_one_topic_may_hold_both(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", controller_states)
    named = ("desired.positions.elbow", "desired.positions.shoulder")
    text = mapping(tmp_path, named, topics=("/arm/commands", "/arm/commands"))
    both = (tmp_path / "map.toml").read_text().replace('"position.', '"actual.positions.')
    (tmp_path / "map.toml").write_text(both)
    (trajectory,) = imported([path], load_mapping(tmp_path / "map.toml"))
    np.testing.assert_array_equal(trajectory.position, POSITION[:, ::-1])
    np.testing.assert_array_equal(trajectory.command, COMMAND[:, ::-1])
    assert text.topics is not None


def test_messages_of_a_gripper_on_the_same_topic_are_passed_over(tmp_path: Path) -> None:
    def messages(maker: Maker) -> list[Message]:
        fingers = [
            (
                "/arm/joint_states",
                JOINT_STATE,
                t + 1,
                maker.joint_state(t, ["finger"], position=[1]),
            )
            for t in np.repeat(STAMP_NS, 2)
        ]
        return states(maker) + fingers + trajectories(maker)

    path = write(tmp_path, "mcap", messages)
    named = ("positions.elbow", "positions.shoulder")
    (trajectory,) = imported([path], mapping(tmp_path, named))
    np.testing.assert_array_equal(trajectory.stamp_ns, STAMP_NS)


def refusal(path: Path, told: Mapping) -> str:
    with pytest.raises(RecordingError) as refused:
        list(imported([path], told))
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)
    return str(refused.value)


DATA = ("data.0", "data.1")


@each_bag
def test_a_missing_topic_is_refused_with_those_that_are_there(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, states)
    words = refusal(path, mapping(tmp_path, DATA, more=LOGGED))
    assert "topic /arm/commands: is missing" in words
    assert f"/arm/joint_states ({JOINT_STATE})" in words


@each_bag
def test_a_truncated_bag_is_refused(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, lambda maker: states(maker) + arrays(maker))
    file = path if path.is_file() else next(path.glob(f"*.{kind}"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    words = refusal(path, mapping(tmp_path, DATA, more=LOGGED))
    assert "cannot be read (" in words
    assert "a whole ROS bag" in words


@each_bag
def test_a_damaged_bag_is_read_or_refused(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path, kind, lambda maker: states(maker) + arrays(maker))
    file = path if path.is_file() else next(path.glob(f"*.{kind}"))
    told, whole = mapping(tmp_path, DATA, more=LOGGED), file.read_bytes()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        damaged = np.frombuffer(whole, np.uint8).copy()
        damaged[rng.integers(len(whole), size=30)] = rng.integers(256, size=30)
        file.write_bytes(damaged.tobytes())
        with contextlib.suppress(RecordingError):
            list(imported([path], told))


def old_bag(tmp_path: Path, layout: str, messages: Callable[[Maker], list[Message]]) -> Path:
    """A bag in sqlite3 as ROS 2 Humble writes it: without definitions."""
    path = write(tmp_path, "db3", messages, layout)
    with contextlib.closing(sqlite3.connect(next(path.glob("*.db3")))) as database:
        database.execute("DELETE FROM message_definitions")
        database.commit()
    return path


def laid_out(layout: str) -> Callable[[Maker], list[Message]]:
    """States of a controller that are told 1, measured 2, and have as many points as a layout."""
    values = {"desired": 1.0, "reference": 1.0, "actual": 2.0, "feedback": 2.0, "error": -1.0}

    def filled(maker: Maker, kind: str, name: str) -> Any:
        if kind == "string[]":
            return []
        kind = kind.replace("/", "/msg/")
        if "MultiDOF" in kind:
            took = maker.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
            return maker.make(
                kind, transforms=[], velocities=[], accelerations=[], time_from_start=took
            )
        return maker.point([values[name]] * 2 if name in values else [])

    def made(maker: Maker) -> list[Message]:
        fields = [line.split() for line in layout.splitlines()[2:]]
        rest = {name: filled(maker, kind, name) for kind, name in fields}
        one = maker.make(
            CONTROLLER_STATE, header=maker.header(STAMP_NS[0]), joint_names=JOINTS, **rest
        )
        return [("/arm/state", CONTROLLER_STATE, int(STAMP_NS[0]), one)]

    return made


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_old_bag_is_read_by_the_layout_that_its_messages_have(
    tmp_path: Path, layout: str
) -> None:
    bag = read_bag(old_bag(tmp_path, layout, lambda m: states(m) + laid_out(layout)(m)))
    assert len(bag.rows["/arm/joint_states"]) == len(STAMP_NS)
    (row,) = bag.rows["/arm/state"]
    told, measured = ("reference", "feedback") if "reference" in layout else ("desired", "actual")
    assert {row[f"{told}.positions.{joint}"] for joint in JOINTS} == {1.0}
    assert {row[f"{measured}.positions.{joint}"] for joint in JOINTS} == {2.0}
    assert {column.partition(".")[0] for column in row} == {"log_time", "stamp", told, measured}


def test_an_old_bag_with_states_of_another_layout_is_refused(tmp_path: Path) -> None:
    layout = f"{LAYOUTS[0]}\ntrajectory_msgs/JointTrajectoryPoint more"
    path = old_bag(tmp_path, layout, lambda maker: states(maker) + laid_out(layout)(maker))
    assert set(read_bag(path).rows) == {"/arm/joint_states"}
    named = ("desired.positions.elbow", "desired.positions.shoulder")
    words = refusal(path, mapping(tmp_path, named, topics=("/arm/joint_states", "/arm/state")))
    assert f"topic /arm/state: is {CONTROLLER_STATE}, which the bag does not define" in words


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.txt").write_text("hello")
    told = mapping(tmp_path, DATA, more=LOGGED)
    assert "cannot be read" in refusal(tmp_path / "run.txt", told)
    assert "cannot be read" in refusal(tmp_path / "absent.bag", told)
    (tmp_path / "empty").mkdir()
    assert "metadata" in refusal(tmp_path / "empty", told)


def test_an_unknown_joint_is_refused_with_those_that_are_there(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", lambda maker: states(maker) + trajectories(maker))
    words = refusal(path, mapping(tmp_path, ("positions.elbow", "positions.hand")))
    assert "topic /arm/commands: column positions.hand: is missing" in words
    assert "positions.elbow, positions.shoulder" in words


def test_a_plan_of_many_points_is_refused(tmp_path: Path) -> None:
    def messages(maker: Maker) -> list[Message]:
        plan = maker.trajectory(STAMP_NS[0], JOINTS, [[0, 0], [1, 1]])
        return [*states(maker), ("/arm/commands", TRAJECTORY, STAMP_NS[0], plan)]

    path = write(tmp_path, "mcap", messages)
    words = refusal(path, mapping(tmp_path, ("positions.elbow", "positions.shoulder")))
    assert "message 0: has 2 points" in words


def spoiled(**fields: Any) -> Callable[[Maker], list[Message]]:
    """Returns messages of which the one in the middle is another."""

    def messages(maker: Maker) -> list[Message]:
        good = states(maker)
        topic, msgtype, log_ns, message = good[15]
        given = {"stamp_ns": STAMP_NS[15], "names": JOINTS, "position": POSITION[15]} | fields
        good[15] = (topic, msgtype, log_ns, maker.joint_state(**given))
        assert message is not good[15][3]
        return good + arrays(maker)

    return messages


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"position": [np.nan, 0.0]}, "column position.elbow: row 16: is nan"),
        ({"position": [0.0]}, "message 15: has 1 values of position for 2 joints"),
        ({"stamp_ns": STAMP_NS[10]}, "column stamp: row 16 is 0.040000 s before the row above"),
    ],
)
def test_bad_messages_are_refused(tmp_path: Path, fields: dict[str, Any], words: str) -> None:
    path = write(tmp_path, "db3", spoiled(**fields))
    assert words in refusal(path, mapping(tmp_path, DATA, more=LOGGED))


def test_commands_without_a_header_have_no_stamp(tmp_path: Path) -> None:
    path = write(tmp_path, "mcap", lambda maker: states(maker) + arrays(maker))
    words = refusal(path, mapping(tmp_path, DATA))
    assert "column stamp: is missing; expected one of the columns in the file: log_time" in words


def test_commands_on_another_clock_are_refused(tmp_path: Path) -> None:
    def messages(maker: Maker) -> list[Message]:
        late = maker.multi_array([0.0, 0.0])
        other = [("/arm/commands", MULTI_ARRAY, t + 10**12, late) for t in STAMP_NS]
        return states(maker) + other

    path = write(tmp_path, "mcap", messages)
    words = refusal(path, mapping(tmp_path, DATA, more=LOGGED))
    assert "commands run from 1000.000 s" in words
    assert "the clock of the measurements" in words


def test_types_without_joints_are_refused(tmp_path: Path) -> None:
    def messages(maker: Maker) -> list[Message]:
        text = maker.make("std_msgs/msg/String", data="go")
        return [*states(maker), ("/arm/commands", "std_msgs/msg/String", STAMP_NS[0], text)]

    path = write(tmp_path, "mcap", messages)
    words = refusal(path, mapping(tmp_path, DATA, more=LOGGED))
    assert "topic /arm/commands: is std_msgs/msg/String; expected sensor_msgs" in words


def test_a_diagnosis_says_to_import_bags_first(tmp_path: Path) -> None:
    folder = write(tmp_path, "mcap", lambda maker: states(maker) + arrays(maker))
    with pytest.raises(RecordingError, match="other formats: `gfm import`"):
        read_recording(folder)
    (file,) = folder.glob("*.mcap")
    with pytest.raises(RecordingError, match="other types: `gfm import`"):
        read_recording(file, joint_states="/arm/joint_states", command="/arm/commands")
