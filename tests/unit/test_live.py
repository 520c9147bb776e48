"""A robot as viewers see it while it is driven."""

from __future__ import annotations

import logging
import socket
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap_ros2._dynamic import generate_dynamic

from gfm.cli import main
from gfm.core import BadInputError, ManualClock, Observation, Reason
from gfm.live.retelling import Retelling
from gfm.live.viewer import Viewer
from gfm.live.watching import KEEP, KEY, Watching
from gfm.recording import schemas
from gfm.recording.raw import read_raw
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_wire import Role, permissions
from watched import Watched

TOPICS = {
    "/bridge/safety",
    "/bridge/timing",
    "/joint_command",
    "/joint_command_reason",
    "/joint_command_requested",
    "/joint_states",
    "/robot_description",
    "/tf",
    "/tf_static",
}


class Notes(Viewer):
    """Remembers what is written, by topic."""

    def __init__(self) -> None:
        self.messages: dict[str, list[tuple[int, Mapping[str, Any]]]] = {}

    def welcome(self) -> None:
        pass

    def close(self) -> None:
        pass

    def write_message(
        self, topic: str, _kind: schemas.MessageType, message: Mapping[str, Any], stamp_ns: int
    ) -> None:
        self.messages.setdefault(topic, []).append((stamp_ns, message))


def observation(stamp_ns: int, **fields: Any) -> Observation:
    joints = fields.pop("joint_names", JOINT_NAMES)
    at = np.full(len(joints), 1e-9 * stamp_ns)
    return Observation(
        joint_names=joints, position=at, velocity=at, effort=at, stamp_ns=stamp_ns, **fields
    )


def told(*observations: Observation) -> dict[str, list[tuple[int, Mapping[str, Any]]]]:
    notes = Notes()
    retelling = Retelling(notes)
    for one in observations:
        retelling.take(one)
    return notes.messages


def test_what_is_told_twice_is_written_once() -> None:
    pose = {"object_position": np.zeros(3), "object_quaternion": np.array([1.0, 0.0, 0.0, 0.0])}
    seen = [observation(10**9 + 10_000_000 * k, object_stamp_ns=5, **pose) for k in range(3)]
    messages = told(*seen, seen[-1])
    assert [stamp for stamp, _ in messages["/joint_states"]] == [one.stamp_ns for one in seen]
    assert [stamp for stamp, _ in messages["/object_pose"]] == [5]
    assert len(messages["/tf"]) == 2  # the arm, and the object
    assert len(messages["/bridge/safety"]) == 4


def test_frames_are_told_20_times_a_second() -> None:
    messages = told(*(observation(10**9 + 5_000_000 * k) for k in range(101)))
    stamps = [stamp for stamp, _ in messages["/tf"]]
    assert np.diff(stamps).tolist() == [50_000_000] * 10


def test_a_robot_that_was_started_again_is_told_from_the_beginning() -> None:
    messages = told(observation(10**9), observation(5))
    assert [stamp for stamp, _ in messages["/joint_states"]] == [10**9, 5]
    assert [stamp for stamp, _ in messages["/robot_description"]] == [10**9, 5]


def test_a_robot_without_a_model_has_curves_and_no_frames() -> None:
    assert set(told(observation(1, joint_names=("a", "b")))) == {
        "/joint_states",
        "/bridge/safety",
        "/bridge/timing",
    }


def test_lost_periods_are_counted_and_told(caplog: pytest.LogCaptureFixture) -> None:
    hub, clock = MemoryHub(), ManualClock()
    watching = Watching(MemoryTransport(hub, clock=clock), [], clock)
    bridge = MemoryTransport(hub, name="bridge", clock=clock)
    bridge.publish(KEY, observation(0))
    assert watching.turn()
    for number in range(1, KEEP + 31):
        bridge.publish(KEY, observation(number))
    clock.advance_s(11.0)
    assert watching.turn()
    assert (watching.heard.periods, watching.heard.lost) == (KEEP + 1, 30)
    assert "30 of 287 periods were lost: too slow here, or on the way" in caplog.messages
    MemoryTransport(hub, name="bridge", clock=clock).publish(KEY, observation(5))
    watching.turn()
    assert watching.heard.lost == 30  # another life of it counts from 0


def test_silence_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    hub, clock = MemoryHub(), ManualClock()
    watching = Watching(MemoryTransport(hub, clock=clock), [], clock)
    bridge = MemoryTransport(hub, clock=clock)
    for _ in range(2):
        bridge.publish(KEY, observation(0))
        watching.turn()
        clock.advance_s(2.1)
        watching.turn()
        watching.turn()
    said = [one.getMessage() for one in caplog.records if one.levelno == logging.WARNING]
    assert said == ["the bridge is silent", "the bridge is heard again", "the bridge is silent"]


def test_where_nobody_publishes_that_is_one_line() -> None:
    clock = ManualClock()
    watching = Watching(MemoryTransport(MemoryHub(), clock=clock), [], clock)
    with pytest.raises(BadInputError, match=r"^nothing is published under .* within 3 s; expected"):
        watching.watch(lambda: False, 3.0)
    assert clock.now_ns() == pytest.approx(3e9, rel=0.01)


def test_a_watcher_may_not_command() -> None:
    asked = permissions(Role.WATCHER)
    assert KEY in asked.hears
    assert {one for one in asked.asks if one.startswith("robot/")} == {"robot/stop"}


@pytest.fixture(autouse=True)
def _quiet() -> Iterator[None]:
    """Takes back what a command changes of the process's log."""
    root = logging.getLogger()
    before = (root.level, list(root.handlers))
    yield
    root.setLevel(before[0])
    root.handlers[:] = before[1]


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no viewer is named; expected --foxglove, --rerun, or both"),
        (("--foxglove", "8765"), "--foxglove '8765': expected HOST:PORT"),
        (("--foxglove", "0.0.0.0:1"), "--foxglove 0.0.0.0:1 lets anybody on the network read"),
        (("--rerun", "nowhere"), "--rerun 'nowhere': expected HOST:PORT"),
        (("--rerun", "--wait-s", "nan"), "--wait-s is nan, expected more than 0"),
    ],
)
def test_what_makes_no_sense_is_one_line(words, said, capsys) -> None:
    pytest.importorskip("rerun")
    assert main(["watch", *words]) == 2
    assert one_line(capsys).startswith(f"error: {said}")


@pytest.mark.parametrize("extra", ["foxglove", "rerun"])
def test_without_its_package_it_says_what_to_install(extra, capsys, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, extra, None)
    for module in ("gfm.live.foxglove_server", "gfm.live.rerun_stream"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    assert main(["watch", f"--{extra}"]) == 2
    assert one_line(capsys).endswith(f"pip install 'gfm-sim2real[{extra}]'")


def test_without_a_rerun_viewer_it_says_how_to_open_one(capsys) -> None:
    pytest.importorskip("rerun")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))  # and nobody listens
        place = f"127.0.0.1:{free.getsockname()[1]}"
        assert main(["watch", "--rerun", place]) == 2
    assert one_line(capsys).startswith(f"error: no Rerun viewer at {place} (Connection refused)")


def viewer_of(server: Any) -> Any:
    from foxglove_viewer import Foxglove

    return Foxglove(server.port)


@pytest.fixture
def server() -> Iterator[Any]:
    pytest.importorskip("foxglove")
    pytest.importorskip("websockets")
    from gfm.live.foxglove_server import FoxgloveServer

    with FoxgloveServer("127.0.0.1", 0) as made:
        yield made


def test_foxglove_gets_what_recordings_have_byte_for_byte(server, tmp_path: Path) -> None:
    watched = Watched(tmp_path, [server])
    watched.drive(1)
    watched.watching.turn()
    viewer = viewer_of(server)
    viewer.subscribe(*TOPICS)
    got: dict[str, dict[int, bytes]] = {topic: {} for topic in TOPICS}
    _hear_until(watched, viewer, got, "/robot_description")
    published = watched.published()
    watched.record("one", 30)
    watched.watching.turn()
    while (one := viewer.received(0.5)) is not None:
        got[one[0]][one[1]] = one[2]
    raw = read_raw(tmp_path / "one.mcap")
    recorded: dict[str, dict[int, bytes]] = {topic: {} for topic in TOPICS}
    for message in raw.messages:
        recorded[raw.channels[message.channel_id].topic][message.log_time] = message.data
    for topic in ("/joint_command", "/joint_command_requested", "/joint_command_reason"):
        both = got[topic].keys() & recorded[topic].keys()
        assert len(both) >= 29, topic
        assert {s: got[topic][s] for s in both} == {s: recorded[topic][s] for s in both}
    (description,) = recorded["/robot_description"].values()
    assert set(got["/robot_description"].values()) == {description}
    decode = generate_dynamic(*schemas.JOINT_STATE)[schemas.JOINT_STATE.name]
    states = published()
    assert len(states) >= 30
    for state in states:
        seen = decode(got["/joint_states"][state.stamp_ns])
        assert tuple(seen.name) == state.joint_names
        assert (seen.position, seen.velocity) == (state.position.tolist(), state.velocity.tolist())


def test_foxglove_is_told_the_topics_and_types_of_recordings(server, tmp_path: Path) -> None:
    watched = Watched(tmp_path, [server])
    watched.record("one", 5)
    watched.watching.turn()
    viewer = viewer_of(server)
    viewer.advertised(*TOPICS)
    assert viewer.channels.keys() == TOPICS
    raw = read_raw(tmp_path / "one.mcap")
    for channel in raw.channels.values():
        told, schema = viewer.channels[channel.topic], raw.schemas[channel.schema_id]
        assert (told["schemaName"], told["schema"]) == (schema.name, schema.data.decode())
        assert (told["encoding"], told["schemaEncoding"]) == ("cdr", "ros2msg")


def _hear_until(
    watched: Watched, viewer: Any, got: dict[str, dict[int, bytes]], topic: str
) -> None:
    """Lets the server look after who came, until a message came under a topic."""
    for _ in range(100):
        watched.watching.turn()
        while (one := viewer.received(0.05)) is not None:
            got[one[0]][one[1]] = one[2]
        if got[topic]:
            return
    raise AssertionError(f"nothing under {topic}")


def test_whoever_comes_late_to_foxglove_gets_the_robot_s_description(server, tmp_path) -> None:
    watched = Watched(tmp_path, [server])
    watched.drive(5)
    watched.watching.turn()
    for _ in range(2):
        viewer = viewer_of(server)
        viewer.subscribe("/robot_description", "/tf_static")
        got: dict[str, dict[int, bytes]] = {"/robot_description": {}, "/tf_static": {}}
        _hear_until(watched, viewer, got, "/robot_description")
        _hear_until(watched, viewer, got, "/tf_static")
        (body,) = got["/robot_description"].values()
        assert b"<robot" in body
        viewer.leave()


def test_a_slow_viewer_loses_the_oldest_and_holds_nobody_up(server) -> None:
    def say(number: int, letters: int = 1) -> None:
        server.write_message("/note", schemas.TEXT, {"data": "x" * letters}, number)

    say(0)
    slow, gone = viewer_of(server), viewer_of(server)
    for viewer in (slow, gone):
        viewer.subscribe("/note")
        while viewer.received(0.1) is None:  # until the server knows of it
            say(0)
    gone.vanish()
    for number in range(1, 2001):
        say(number, 50_000)  # far more than waits here, or in sockets
    stamps = [0]
    while (one := slow.received(1.0)) is not None:
        stamps.append(one[1])
    assert stamps[-1] == 2000
    assert len(stamps) < 1900
    assert (np.diff(stamps) >= 0).all()
    slow.leave()


def test_a_port_that_is_taken_is_one_line(server, capsys) -> None:
    place = f"127.0.0.1:{server.port}"
    assert main(["watch", "--foxglove", place]) == 2
    said = one_line(capsys)
    assert said.startswith(f"error: cannot listen on {place} for Foxglove: ")
    assert "in use" in said


def test_rerun_has_every_period(tmp_path: Path) -> None:
    rr = pytest.importorskip("rerun")
    from rerun.chunk import RrdReader

    from gfm.live.rerun_stream import RerunStream, blueprint

    path = tmp_path / "live.rrd"
    stream = rr.RecordingStream("test")
    stream.save(path, default_blueprint=blueprint())
    notes = Notes()
    with RerunStream(stream) as viewer:
        watched = Watched(tmp_path, [viewer, notes])
        watched.drive(30)
        watched.watching.turn()
        pose = {"object_position": np.ones(3), "object_quaternion": np.array([0.0, 1.0, 0.0, 0.0])}
        last = observation(10**10, object_stamp_ns=10**10, **pose, reason=int(Reason.LOAD))
        Retelling(viewer).take(last)
    read: dict[str, dict[int, Any]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if "stamp" not in batch.schema.names:
            read.setdefault(chunk.entity_path, {})
            continue
        names = [one for one in batch.schema.names if ":" in one]
        name = "TextLog:text" if "TextLog:text" in names else names[0]
        stamps = np.asarray(batch["stamp"].cast("int64"))
        rows = dict(zip(stamps.tolist(), batch[name].to_pylist(), strict=True))
        read.setdefault(chunk.entity_path, {}).update(rows)
    for kind in ("position", "velocity", "effort"):
        published = {stamp: m[kind] for stamp, m in notes.messages["/joint_states"]}
        assert len(published) >= 30
        assert {s: read[f"/joint_states/{kind}"][s] for s in published} == published
    asked = {stamp: m["velocity"] for stamp, m in notes.messages["/joint_command_requested"]}
    assert read["/joint_command_requested/velocity"] == asked
    assert [row[0] for row in read["/bridge/safety"].values()][-1] == "load"
    assert read["/object_pose"].keys() == {10**10}
    assert {"/tf/object", *(f"/tf/right_l{number}" for number in range(7))} <= read.keys()
    assert any(where.startswith("/base/visual_geometries/right_l6") for where in read)
