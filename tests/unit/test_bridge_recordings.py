"""What the bridge's recordings hold for people and their viewers."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from gfm.core import Command, CommandKind, ManualClock, Observation, Reason
from gfm.experiments.recording_words import delay_counts
from gfm.recording import read_recording
from gfm.recording.overview import overview
from gfm.recording.periods import safety, timing
from gfm.recording.punctuality import delays
from gfm.recording.raw import read_raw
from gfm.report.recording import delay_picture, recording_html
from gfm.sim.sawyer import JOINT_NAMES, sawyer_spec
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.background import AtOnce
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.content import content_of
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.service import BridgeService
from gfm_wire import Message, RecordStart, RecordStop, RobotClock

LAYOUTS = Path(__file__).parents[2] / "docs" / "layouts"
OBJECT_AT = np.array([0.5, 0.1, 0.2])
ALWAYS = {
    "/bridge/safety",
    "/joint_command",
    "/joint_command_reason",
    "/joint_command_requested",
    "/joint_states",
    "/robot_description",
    "/tf",
    "/tf_static",
}


class Session:
    """A bridge with a mirror of the arm, and its driver, in one thread."""

    def __init__(self, folder: Path, clock: str) -> None:
        hub, self.clock = MemoryHub(), ManualClock()
        config = BridgeConfig(name="bridge", recordings=str(folder), clock=RobotClock(clock))
        transport = MemoryTransport(hub, clock=self.clock)
        self.bridge = BridgeService(config, MirrorRobot(JOINT_NAMES), transport, self.clock)
        self.driver = MemoryTransport(hub, name="driver", clock=self.clock)

    def ask(self, key: str, message: Message) -> Message:
        pending = self.driver.request(key, message, timeout_s=5.0)
        while (answer := pending.poll()) is None:
            self.clock.advance_s(1e-3)
            while self.bridge.step():
                pass
        return answer

    def record(self, name: str, commands: int = 40) -> None:
        self.ask("robot/record", RecordStart(name=name))
        for number in range(commands):
            speed = np.full(7, 0.002 * number)
            stamp_ns = self.clock.utc_ns()
            command = Command(
                kind=CommandKind.VELOCITY,
                joint_names=JOINT_NAMES,
                values=speed,
                stamp_ns=stamp_ns,
                number=number,
            )
            self.ask("robot/command", command)
        self.ask("robot/record", RecordStop())


def recorded(folder: Path, clock: str = "lockstep") -> Path:
    Session(folder, clock).record("one")
    return folder / "one.mcap"


def messages(path: Path, topic: str) -> list[Any]:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [message for *_, message in reader.iter_decoded_messages(topics=[topic])]


def seen_object(folder: Path) -> Path:
    """Records one report of an arm, with an object."""
    config = BridgeConfig(recordings=str(folder), object_spread_m=0.002, object_spread_rad=0.02)
    content = content_of(config, MirrorRobot(JOINT_NAMES))
    recorder = Recorder(folder, lambda: config.about, AtOnce(), content)
    recorder.start(RecordStart(name="object"))
    zeros = np.zeros(7)
    report = Observation(
        joint_names=JOINT_NAMES,
        position=zeros,
        velocity=zeros,
        effort=zeros,
        stamp_ns=10**9,
        object_position=OBJECT_AT,
        object_quaternion=np.array([0.0, 1.0, 0.0, 0.0]),
        object_stamp_ns=9 * 10**8,
    )
    recorder.report(report)
    recorder.stop()
    return folder / "object.mcap"


@pytest.mark.parametrize(
    ("clock", "topics"), [("lockstep", ALWAYS), ("wall", ALWAYS | {"/bridge/timing"})]
)
def test_a_recording_has_what_viewers_open(tmp_path: Path, clock: str, topics: set[str]) -> None:
    seen = overview(recorded(tmp_path, clock))
    assert {one.topic for one in seen.topics} == topics
    assert (seen.profile, {one.encoding for one in seen.topics}) == ("ros2", {"cdr"})
    assert set(seen.attachments) == {"model.xml"}
    assert read_recording(tmp_path / "one.mcap").joint_names == JOINT_NAMES


def test_frames_are_where_the_model_has_its_bodies(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    fixed = messages(path, "/tf_static")[0].transforms
    last = messages(path, "/tf")[-1].transforms
    states = messages(path, "/joint_states")
    stamp = last[0].header.stamp
    state = next(s for s in states if s.header.stamp.nanosec == stamp.nanosec)
    model = sawyer_spec(command=CommandKind.EFFORT).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = state.position
    mujoco.mj_kinematics(model, data)
    frames = {one.child_frame_id: one for one in [*fixed, *last]}
    assert len(frames) == model.nbody - 1
    for name in frames:
        place, chain = np.zeros(3), name
        while chain != "base":
            one = frames[chain].transform
            turn = [getattr(one.rotation, axis) for axis in "wxyz"]
            mujoco.mju_rotVecQuat(place, place.copy(), np.array(turn))
            place += [getattr(one.translation, axis) for axis in "xyz"]
            chain = frames[chain].header.frame_id
        np.testing.assert_allclose(place, data.body(name).xpos, atol=1e-12)


def test_frames_are_written_20_times_a_second(tmp_path: Path) -> None:
    raw = read_raw(recorded(tmp_path))
    stamps = raw.stamps_ns("/tf", raw.by_topic()["/tf"])
    assert set(np.diff(stamps).tolist()) == {50_000_000}


def test_the_description_names_the_frames(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    robot = Xml.fromstring(messages(path, "/robot_description")[0].data)
    links = {link.get("name") for link in robot.iter("link")}
    frames = [*messages(path, "/tf_static")[0].transforms, *messages(path, "/tf")[0].transforms]
    assert links == {"base", *(frame.child_frame_id for frame in frames)}
    limit = next(j for j in robot.iter("joint") if j.get("name") == "right_j6").find("limit")
    assert limit is not None
    assert (limit.get("velocity"), limit.get("effort")) == ("4.545", "9")


def test_the_attached_model_is_the_arm(tmp_path: Path) -> None:
    (attached,) = read_raw(recorded(tmp_path)).attachments
    model = mujoco.MjModel.from_xml_string(attached.data.decode())
    assert [model.joint(i).name for i in range(model.njnt)] == list(JOINT_NAMES)


def test_metadata_tell_settings_and_limits(tmp_path: Path) -> None:
    about = overview(recorded(tmp_path)).metadata
    text = about["gfm"]["config"]
    assert json.loads(text)["velocity_share"] == 0.5
    assert about["gfm"]["config_sha256"] == hashlib.sha256(text.encode()).hexdigest()
    assert json.loads(about["gfm.limits"]["right_j6"])["velocity_rad_s"] == 4.545


def test_the_same_commands_in_lockstep_give_the_same_file(tmp_path: Path) -> None:
    files = []
    for _ in range(2):
        path = recorded(tmp_path)
        files.append(path.read_bytes())
        path.unlink()
    assert files[0] == files[1]


def observation(**fields: Any) -> Observation:
    zeros = np.zeros(7)
    return Observation(
        joint_names=JOINT_NAMES, position=zeros, velocity=zeros, effort=zeros, stamp_ns=0, **fields
    )


def test_every_bit_of_the_reason_has_a_name_of_its_own() -> None:
    for one in Reason:
        told = safety(observation(reason=int(one)))
        assert [name for name, value in told.items() if value is True] == [str(one.name).lower()]


def test_timing_is_in_milliseconds_and_nan_where_the_bridge_acted_itself() -> None:
    own = timing(observation(received_ns=9_000_000, sent_ns=2_000_000))
    assert own["sent_to_received_ms"] == 7.0
    assert np.isnan(own["heard_to_decided_ms"])
    asked = timing(observation(heard_ns=1, decided_ns=500_001, sent_ns=2_000_001))
    assert (asked["heard_to_decided_ms"], asked["decided_to_sent_ms"]) == (0.5, 1.5)


def test_an_object_s_pose_has_a_twin_with_its_covariance_and_a_frame(tmp_path: Path) -> None:
    path = seen_object(tmp_path)
    (pose,), (spread,) = (
        messages(path, "/object_pose"),
        messages(path, "/object_pose_with_covariance"),
    )
    assert pose.header.frame_id == spread.header.frame_id == "base"
    assert pose.pose.position.x == spread.pose.pose.position.x == 0.5
    covariance = np.reshape(spread.pose.covariance, (6, 6))
    np.testing.assert_allclose(np.diag(covariance), [4e-6] * 3 + [4e-4] * 3)
    assert np.count_nonzero(covariance) == 6
    frame = messages(path, "/tf")[0].transforms[0]  # seen before the report that tells of it
    assert (frame.header.frame_id, frame.child_frame_id) == ("base", "object")
    assert (frame.transform.translation.z, frame.transform.rotation.x) == (0.2, 1.0)


# Layouts


def has_field(message: Any, path: str) -> bool:
    """Returns whether a message has a.b[2].c."""
    for field in path.split("."):
        name, _, index = field.partition("[")
        if not hasattr(message, name):
            return False
        message = getattr(message, name)
        if index:
            message = message[int(index.removesuffix("]"))]
    return True


def test_foxglove_s_layout_names_fields_that_are_recorded(tmp_path: Path) -> None:
    path = recorded(tmp_path, "wall")
    layout = json.loads((LAYOUTS / "foxglove.json").read_text())
    panels = layout["configById"]
    placed = re.findall(r'"([A-Za-z0-9]+![a-z]+)"', json.dumps(layout["layout"]))
    assert sorted(placed) == sorted(panels)
    values = [one["value"] for panel in panels.values() for one in panel.get("paths", [])]
    assert len(values) > 40
    assert {f"/bridge/safety.{one.name.lower()}" for one in Reason if one} <= set(values)
    for value in values:
        topic, _, fields = value.partition(".")
        # The velocity session fills no position command.
        if topic == "/joint_command" and fields.startswith("position"):
            fields = fields.replace("position", "velocity")
        assert has_field(messages(path, topic)[-1], fields), value


def test_plotjuggler_s_layout_names_series_that_are_recorded(tmp_path: Path) -> None:
    known = {"/object_pose": messages(seen_object(tmp_path), "/object_pose")[0]}
    path = recorded(tmp_path, "wall")
    known |= {
        topic: messages(path, topic)[-1] for topic in read_raw(path).by_topic() if topic != "/tf"
    }
    curves = [c.get("name", "") for c in Xml.parse(LAYOUTS / "plotjuggler.xml").iter("curve")]
    assert len(curves) > 60
    assert {f"/bridge/safety/{one.name.lower()}" for one in Reason if one} <= set(curves)
    for curve in curves:
        topic = next(topic for topic in known if curve.startswith(f"{topic}/"))
        fields = curve.removeprefix(f"{topic}/").split("/")
        if topic.startswith("/joint"):  # by joint: NAME/FIELD
            assert fields[0] in known[topic].name
            assert hasattr(known[topic], fields[1])
        elif fields[-1].endswith("_deg"):  # PlotJuggler turns quaternions into angles
            assert has_field(known[topic], ".".join(fields[:-1]))
        else:
            assert has_field(known[topic], ".".join(fields)), curve


def test_an_overview_has_histograms_of_the_bridge_s_delays(tmp_path: Path) -> None:
    seen = overview(recorded(tmp_path, "wall")).punctuality
    assert set(seen) == {"heard_to_sent", "uneven"}
    assert all(sum(one.bins.values()) == one.count == 40 for one in seen.values())
    assert seen["uneven"].bins["0.1"] == 39  # by a clock that is moved by hand, in steps
    assert seen["uneven"].most_ms <= 1.0
    assert seen["heard_to_sent"].most_ms == 0.0
    assert overview(recorded(tmp_path / "lockstep")).punctuality == {}


def test_a_recording_s_page_shows_the_bridge_s_delays(tmp_path: Path) -> None:
    path = recorded(tmp_path, "wall")
    told = delay_counts(overview(path).punctuality)
    assert [sum(counts.values()) for counts in told.values()] == [40, 40]
    figure = delay_picture(told).figure
    assert [list(bars.y) for bars in figure.data] == [
        list(counts.values()) for counts in told.values()
    ]
    titles = [one.text for one in figure.layout.annotations]
    assert titles[0].startswith("from a command heard to sent: 0.00 ms (median)")
    assert "How punctual the bridge was" in recording_html(read_recording(path), told)
    assert "How punctual" not in recording_html(read_recording(path), {})


def test_delays_are_counted_up_to_the_end_of_each_bin() -> None:
    told = delays(np.array([0.1, 0.10001, 5.0, 5.1, 80.0]))
    assert {end: count for end, count in told.bins.items() if count} == {
        "0.1": 1,
        "0.2": 1,
        "5": 1,
        "10": 1,
        "over": 1,
    }
    assert (told.count, told.median_ms, told.most_ms) == (5, 5.0, 80.0)
