"""Poses of the object from outside: believed by their age, recorded, and missed where needed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from gfm.core import Command, CommandKind, ManualClock, Observation, Reason, RefusedError
from gfm.recording import schemas
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.service import BridgeService
from gfm_wire import (
    Ack,
    Message,
    ObjectPose,
    RecordStart,
    RecordStop,
    RobotClock,
    TrackedObject,
)

UTC_NS = 1_700_000_000_000_000_000
JOINTS = ("a", "b")
LIMITS = Limits(
    lower=np.full(2, -1.0),
    upper=np.full(2, 1.0),
    velocity=np.full(2, 1.0),
    acceleration=np.full(2, 10.0),
    effort=np.full(2, 5.0),
)
PERIOD_S = 0.02


def pose(x: float = 0.5, **changed: Any) -> ObjectPose:
    told = ObjectPose(
        position=np.array([x, 0.1, 0.2]),
        quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        covariance=np.diag([1e-6] * 3 + [1e-4] * 3),
    )
    return replace(told, **changed)


class Rig:
    """A bridge on the wall clock, a robot that sees no object, a driver and trackers."""

    def __init__(self, folder: Path, clock: RobotClock = RobotClock.WALL) -> None:
        self.clock, self.hub = ManualClock(UTC_NS), MemoryHub()
        self.robot = MirrorRobot(JOINTS, LIMITS)
        config = BridgeConfig(name="bridge", recordings=str(folder), clock=clock)
        transport = self.connect("bridge")
        self.bridge = BridgeService(config, self.robot, transport, self.clock)
        self.driver, self.tracker = self.connect("driver"), self.connect("tracker")
        self.number = 0
        self.pass_time(2 * PERIOD_S)

    def connect(self, name: str) -> MemoryTransport:
        return MemoryTransport(self.hub, name=name, clock=self.clock)

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            self.clock.advance_s(1e-3)
            while self.bridge.step():
                pass

    def ask(self, key: str, message: Message, of: MemoryTransport | None = None) -> Message:
        pending = (of or self.driver).request(key, message, timeout_s=5.0)
        while (answer := pending.poll()) is None:
            self.pass_time(1e-3)
        return answer

    def command(self, *, needs_object: bool) -> Observation:
        sent = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINTS,
            values=np.full(2, 0.01),
            stamp_ns=self.clock.utc_ns(),
            number=self.number,
            needs_object=needs_object,
        )
        self.number += 1
        answer = self.ask("robot/command", sent)
        assert isinstance(answer, Observation)
        return answer

    def track(
        self, *, age_s: float = 0.0, of: MemoryTransport | None = None, **parts: Any
    ) -> Message:
        stamp_ns = self.clock.utc_ns() - round(age_s * 1e9)
        message = TrackedObject(stamp_ns=stamp_ns, **({"pose": pose()} | parts))
        return self.ask("robot/tracked", message, of or self.tracker)

    def counter(self, name: str) -> int:
        return self.bridge.status().counters[name]


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_a_pose_is_reported_as_old_as_it_is_on_the_robot_s_clock(rig: Rig) -> None:
    assert rig.command(needs_object=False).object_position is None
    before_ns = rig.robot.time_ns()
    assert rig.track(age_s=0.03) == Ack()
    seen = rig.command(needs_object=True)
    assert seen.object_position is not None
    assert seen.object_quaternion is not None
    assert seen.object_position.tolist() == [0.5, 0.1, 0.2]
    assert seen.object_stamp_ns == pytest.approx(before_ns - 30_000_000, abs=PERIOD_S * 1e9)
    assert rig.counter("tracked_poses") == 1


def test_the_same_pose_told_again_is_no_new_one(rig: Rig) -> None:
    rig.track(age_s=0.0)
    said_ns = rig.clock.utc_ns()
    first = rig.command(needs_object=True).object_stamp_ns
    for _ in range(2):
        told = TrackedObject(stamp_ns=said_ns, pose=pose())
        rig.ask("robot/tracked", told, rig.tracker)
    again = rig.command(needs_object=True).object_stamp_ns
    assert again == pytest.approx(first, abs=5e6)
    assert rig.counter("tracked_poses") == 2


def test_a_tracker_that_is_dead_leaves_no_pose_and_stops_who_needs_one(rig: Rig) -> None:
    rig.track()
    for _ in range(24):
        seen = rig.command(needs_object=True)
        assert seen.object_position is not None
    rig.command(needs_object=False)
    rig.command(needs_object=False)
    with pytest.raises(RefusedError, match=r"object: its pose is 5\d\d ms old, expected at most"):
        rig.command(needs_object=True)
    assert rig.counter("unknown_objects") == 1
    rig.pass_time(0.2)
    rig.number = 0
    answer = rig.command(needs_object=False)
    assert answer.object_position is None


def test_the_stop_says_in_its_mask_that_the_object_was_missing(rig: Rig) -> None:
    observations = rig.driver.subscribe("robot/observation", keep=100)
    rig.command(needs_object=False)
    with pytest.raises(RefusedError, match="object: nobody says where it is"):
        rig.command(needs_object=True)
    rig.pass_time(0.1)
    masks = []
    while isinstance(seen := observations.take(), Observation):
        masks.append(seen.reason)
    assert any(mask & Reason.OBJECT for mask in masks)


def test_who_says_that_nobody_knows_takes_the_pose_away_at_once(rig: Rig) -> None:
    rig.track()
    assert rig.command(needs_object=True).object_position is not None
    rig.track(pose=None)
    with pytest.raises(RefusedError, match="object: nobody says where it is"):
        rig.command(needs_object=True)
    rig.track()
    rig.number = 0
    assert rig.command(needs_object=True).object_position is not None
    assert rig.counter("invalid_poses") == 1


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"age_s": -0.1}, r"pose is \d+ ms in the future, expected at most 50: the clocks differ"),
        ({"age_s": 0.6}, r"pose is 60\d ms old, expected at most 500"),
        ({"pose": pose(quaternion=np.full(4, 1.0))}, "quaternion of length 2, expected 1"),
        ({"pose": pose(covariance=-np.eye(6))}, "covariance that is none"),
        ({"views": {"left": pose(covariance=np.tri(6))}}, "covariance that is none"),
        ({"views": {"a/b": pose()}}, "camera 'a/b': expected letters, digits, - or _"),
    ],
)
def test_what_cannot_be_is_refused_and_counted(rig: Rig, parts: dict[str, Any], words: str) -> None:
    refused = rig.counter("rejected_messages")
    with pytest.raises(RefusedError, match=words):
        rig.track(**parts)
    assert rig.counter("rejected_messages") == refused + 1
    assert rig.command(needs_object=False).object_position is None


def test_an_older_pose_does_not_replace_a_newer_one(rig: Rig) -> None:
    rig.track(age_s=0.0)
    with pytest.raises(RefusedError, match="ms older than the last"):
        rig.track(age_s=0.1, pose=pose(x=9.0))


def test_a_second_tracker_has_to_wait_until_the_first_is_silent(rig: Rig) -> None:
    rig.track()
    other = rig.connect("other")
    with pytest.raises(RefusedError, match="the object's pose is held by tracker"):
        rig.track(of=other)
    rig.pass_time(1.1)
    assert rig.track(of=other) == Ack()


def test_in_lockstep_nobody_tells_poses(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="the robot's clock is lockstep; expected wall"):
        Rig(tmp_path, RobotClock.LOCKSTEP).track()


def test_a_robot_s_own_pose_is_not_replaced(rig: Rig) -> None:
    rig.track()
    own = replace(
        rig.command(needs_object=False),
        object_position=np.zeros(3),
        object_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
    )
    assert rig.bridge._objects.added_to(own) is own


def test_poses_are_recorded_with_covariance_and_by_camera(rig: Rig, tmp_path: Path) -> None:
    rig.ask("robot/record", RecordStart(name="one"))
    rig.command(needs_object=False)
    rig.track(views={"left": pose(x=0.51), "right": pose(x=0.49)})
    rig.command(needs_object=True)
    rig.ask("robot/record", RecordStop())
    found: dict[str, Any] = {}
    with (tmp_path / "one.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found[channel.topic] = message
    for camera, x in (("", 0.5), ("/camera/left", 0.51), ("/camera/right", 0.49)):
        assert found[camera + schemas.OBJECT_POSE].pose.position.x == x
        spread = found[camera + schemas.OBJECT_POSE_SPREAD].pose.covariance
        assert np.reshape(spread, (6, 6)).tolist() == pose().covariance.tolist()
    stamps = {found[topic].header.stamp.nanosec for topic in found if "object_pose" in topic}
    assert len(stamps) == 1
