"""Every recording that cannot be trusted is refused with one line: file, topic, field, expected."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mcap_ros2.writer
import numpy as np
import pytest

from gfm.core import CommandKind, ObjectTrack, RecordingError, Trajectory
from gfm.recording import read_recording, schemas, write_recording

Messages = dict[str, list[Any]]


def joint_state(stamp_ns: int, **fields: Any) -> Any:
    stamp = {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}
    empty = {"name": ["a", "b"], "position": [], "velocity": [], "effort": []}
    return SimpleNamespace(header={"stamp": stamp, "frame_id": ""}, **(empty | fields))


def good() -> Messages:
    """A recording in which nothing is wrong."""
    steps = range(1, 21)
    states = [joint_state(i * 10**7, position=[0.1, 0.2], velocity=[0.0, 0.0]) for i in steps]
    commands = [joint_state(i * 10**7, position=[0.1, 0.2]) for i in steps]
    return {"/joint_states": states, "/joint_command": commands}


def write(path: Path, messages: Messages) -> Path:
    with path.open("wb") as file, mcap_ros2.writer.Writer(file) as writer:
        schema = writer.register_msgdef(*schemas.JOINT_STATE)
        for topic, listed in messages.items():
            for log_time, message in enumerate(listed):
                writer.write_message(topic, schema, message, log_time=log_time)
    return path


def refusal(path: Path, **options: Any) -> str:
    with pytest.raises(RecordingError) as refused:
        read_recording(path, **options)
    message = str(refused.value)
    assert "\n" not in message
    assert str(path) in message
    assert "expected" in message
    return message


def test_the_good_one_is_read(tmp_path: Path) -> None:
    assert read_recording(write(tmp_path / "a.mcap", good())).joint_names == ("a", "b")


def spoil(topic: str, index: int, **fields: Any) -> Callable[[Messages], None]:
    return lambda messages: vars(messages[topic][index]).update(fields)


def stamp(sec: int, nanosec: int = 0) -> dict[str, Any]:
    return {"header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda m: m.pop("/joint_command"), "topic /joint_command: is missing"),
        (lambda m: m.pop("/joint_states"), "topics in the file: /joint_command"),
        (spoil("/joint_states", 5, name=["a", "c"]), "field name: message 5 names a, c"),
        (spoil("/joint_states", 5, name=["a"], position=[0], velocity=[0]), "message 5 names a"),
        (spoil("/joint_states", 0, name=["a", "a"]), "each joint once"),
        (spoil("/joint_states", 5, **stamp(0, 1)), r"message 5 is stamped 0.05\d+ s before"),
        (spoil("/joint_states", 5, **stamp(0, 50_000_000)), "strictly increasing"),
        (spoil("/joint_states", -1, **stamp(3600)), "gaps of at most 10 s"),
        (spoil("/joint_states", -1, **stamp(-5)), "message 19 has -5 s"),
        (spoil("/joint_states", -1, **stamp(0, 2 * 10**9)), "nanosec < 10"),
        (spoil("/joint_states", 7, position=[0.1, np.nan]), "message 7, joint b is nan"),
        (spoil("/joint_states", 7, velocity=[np.inf, 0.0]), "field velocity: message 7, joint a"),
        (spoil("/joint_states", 7, position=[0.1]), "message 7 has 1 values for 2 joints"),
        (spoil("/joint_states", 7, velocity=[]), "message 7 has 0 values for 2 joints"),
        (spoil("/joint_command", 3, effort=[1.0, 1.0]), "field effort: message 0 has 0 values"),
        (spoil("/joint_command", 3, position=[np.nan, 0.0]), "/joint_command: field position"),
        (spoil("/joint_command", 0, name=["a", "z"]), "message 1 names a, b"),
        (lambda m: m["/joint_states"].__delitem__(slice(5, None)), "only 5 messages"),
        (lambda m: m["/joint_command"].clear(), "/joint_command: is missing"),
    ],
)
def test_refuses(tmp_path: Path, change: Callable[[Messages], object], words: str) -> None:
    messages = good()
    change(messages)
    with pytest.raises(RecordingError, match=words):
        read_recording(write(tmp_path / "a.mcap", messages))
    refusal(tmp_path / "a.mcap")


@pytest.mark.parametrize("fields", [{"position": []}, {"velocity": [0.0, 0.0]}])
def test_a_command_has_exactly_one_filled_field(tmp_path: Path, fields: dict[str, Any]) -> None:
    messages = good()
    for message in messages["/joint_command"]:
        vars(message).update(fields)
    assert "exactly one of position" in refusal(write(tmp_path / "a.mcap", messages))


def test_commands_of_unmeasured_joints_are_refused(tmp_path: Path) -> None:
    messages = good()
    for message in messages["/joint_command"]:
        message.name = ["a", "gripper"]
    words = refusal(write(tmp_path / "a.mcap", messages))
    assert "commands joint gripper; expected joints measured on /joint_states: a, b" in words


def test_commands_on_another_clock_are_refused(tmp_path: Path) -> None:
    messages = good()
    for i, message in enumerate(messages["/joint_command"]):
        vars(message).update(stamp(1_700_000_000, i))
    assert "expected the clock of the measurements" in refusal(write(tmp_path / "a.mcap", messages))


def test_measurements_without_position_are_refused(tmp_path: Path) -> None:
    messages = good()
    for message in messages["/joint_states"]:
        message.position = []
    assert "/joint_states: position: is empty" in refusal(write(tmp_path / "a.mcap", messages))


def test_other_topics_can_be_named(tmp_path: Path) -> None:
    messages = {f"/arm{topic}": listed for topic, listed in good().items()}
    path = write(tmp_path / "a.mcap", messages)
    names = {"joint_states": "/arm/joint_states", "command": "/arm/joint_command"}
    assert len(read_recording(path, **names).command) == 20
    assert "/arm/joint_states" in refusal(path)


def test_a_topic_of_another_type_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with path.open("wb") as file, mcap_ros2.writer.Writer(file) as writer:
        schema = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/joint_states", schema, {"data": "hello"}, log_time=0)
    assert "is std_msgs/msg/String in 'cdr'; expected sensor_msgs" in refusal(path)


@pytest.mark.parametrize("content", [b"", b"time,pos\n0,1\n", b"\x89MCAP", b"#ROSBAG V2.0\n"])
def test_other_formats_are_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    assert "not an MCAP file" in refusal(tmp_path / "a.mcap")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "none.mcap")
    (tmp_path / "folder").mkdir()
    assert "directory" in refusal(tmp_path / "folder")


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        ([np.nan, 0, 0, 1, 0, 0, 0], "field pose.position: message 1 has position nan, 0, 0"),
        (
            [0, 0, 0, 1, 1, 0, 0],
            "field pose.orientation: message 1 has a quaternion of length 1.41",
        ),
        (
            [0, 0, 0, np.nan, 0, 0, 0],
            "field pose.orientation: message 1 has a quaternion of length nan",
        ),
    ],
)
def test_poses_that_cannot_be_are_refused(tmp_path: Path, pose: list[float], words: str) -> None:
    good_one = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    poses = np.array([good_one, pose, good_one])
    stamp_ns = 10_000_000 * np.arange(1, 13)
    track = ObjectTrack(stamp_ns=stamp_ns[:3], position=poses[:, :3], quaternion=poses[:, 3:])
    still = np.zeros((12, 1))
    recorded = Trajectory(
        name="a",
        joint_names=("a",),
        stamp_ns=stamp_ns,
        position=still,
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns,
        command=still,
        object_track=track,
    )
    write_recording(tmp_path / "a.mcap", recorded)
    assert f"/object_pose: {words}" in refusal(tmp_path / "a.mcap")
