"""The bridge: what it lets through, what it refuses, what it records, when it stops the robot."""

from __future__ import annotations

import errno
import json
import os
import re
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from gfm.core import (
    Command,
    CommandKind,
    ConfigError,
    ManualClock,
    Observation,
    Reason,
    RefusedError,
)
from gfm.recording import RecordingWriter, read_recording
from gfm.transport import MemoryHub, MemoryTransport, PendingReply
from gfm_robot_bridge.background import Background, InThread, Piece
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.recorder import Recorder
from gfm_robot_bridge.service import BridgeService
from gfm_wire import (
    Ack,
    ByHand,
    Message,
    PlaceObject,
    PowerAction,
    PowerRobot,
    RecordDone,
    RecordStart,
    RecordStop,
    ReleaseRobot,
    RobotClock,
    ScaleSpeed,
    SetPayload,
    StopRobot,
)

JOINTS = ("a", "b")
LIMITS = Limits(
    lower=np.array([-1.0, -2.0]),
    upper=np.array([1.0, 2.0]),
    velocity=np.array([1.0, 2.0]),
    acceleration=np.array([10.0, 10.0]),
    effort=np.array([5.0, 3.0]),
)
PERIOD_S = 0.02


class Rig:
    """A bridge, a mirror robot and somebody who asks, in one thread."""

    def __init__(self, folder: Path, *, clock: str = "lockstep", **settings: Any) -> None:
        self.hub = MemoryHub()
        self.clock = ManualClock()
        self.robot = MirrorRobot(JOINTS, LIMITS)
        config = BridgeConfig(
            name="bridge", recordings=str(folder), clock=RobotClock(clock), **settings
        )
        transport = MemoryTransport(self.hub, clock=self.clock)
        self.bridge = BridgeService(config, self.robot, transport, self.clock)
        self.asker = self.connect("first")
        self.observations = self.asker.subscribe("robot/observation", keep=1000)
        self.number = 0
        self.pass_time(PERIOD_S)

    def connect(self, name: str) -> MemoryTransport:
        return MemoryTransport(self.hub, name=name, clock=self.clock)

    def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            self.clock.advance_s(1e-3)
            while self.bridge.step():
                pass

    def ask(self, key: str, message: Message) -> Message:
        pending = self.asker.request(key, message, timeout_s=5.0)
        while (answer := pending.poll()) is None:
            self.pass_time(1e-3)
        return answer

    def command(
        self,
        kind: str,
        values: list[float],
        *,
        number: int | None = None,
        names: Any = JOINTS,
        share: float = 1.0,
    ) -> Observation:
        sent = Command(
            kind=CommandKind(kind),
            joint_names=names,
            values=np.array(values),
            stamp_ns=self.clock.utc_ns(),
            number=self.number if number is None else number,
            speed_share=share,
        )
        self.number = sent.number + 1
        answer = self.ask("robot/command", sent)
        assert isinstance(answer, Observation)
        return answer

    def send(self, speed: float, *, age_s: float = 0.0) -> PendingReply:
        """Sends a velocity command without waiting for its answer."""
        sent = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINTS,
            values=np.full(2, speed),
            stamp_ns=self.clock.utc_ns() - round(age_s * 1e9),
            number=self.number,
        )
        self.number += 1
        return self.asker.request("robot/command", sent, timeout_s=5.0)

    def counter(self, name: str) -> int:
        return self.bridge.status().counters[name]


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_a_command_is_answered_by_what_it_did(rig: Rig) -> None:
    answer = rig.command("velocity", [0.02, -0.02])
    assert answer.reason == Reason.NONE
    assert answer.applied is not None
    assert answer.applied.values.tolist() == [0.02, -0.02]
    assert answer.stamp_ns == answer.applied.stamp_ns + 20_000_000
    newest = rig.observations.latest()
    assert isinstance(newest, Observation)
    assert newest.stamp_ns == answer.stamp_ns


def test_a_robot_without_a_model_has_no_geometry_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    status = Rig(tmp_path).bridge.status()
    assert status.gauges["geometry_guarded"] == 0.0
    assert status.counters["workspace_limits"] == status.counters["collision_limits"] == 0
    assert "no model of this robot: nothing keeps it from running into something" in caplog.text


def test_joints_may_be_named_in_any_order(rig: Rig) -> None:
    rig.command("velocity", [0.02, 0.01], names=("b", "a"))
    assert rig.robot.told[-1].values.tolist() == [0.01, 0.02]
    assert rig.robot.told[-1].joint_names == JOINTS


def test_in_lockstep_time_passes_only_with_commands(rig: Rig) -> None:
    before = rig.robot.time_ns()
    rig.pass_time(1.0)
    assert rig.robot.time_ns() == before
    rig.command("velocity", [0.0, 0.0])
    assert rig.robot.time_ns() == before + 20_000_000


@pytest.mark.parametrize(
    ("kind", "values", "reason", "applied"),
    [
        ("velocity", [0.9, 0.0], Reason.VELOCITY | Reason.ACCELERATION, [0.1, 0.0]),
        ("velocity", [0.4, 0.0], Reason.ACCELERATION, [0.1, 0.0]),
        ("position", [0.003, 0.0], Reason.ACCELERATION, [0.002, 0.0]),
        ("position", [0.5, 0.0], Reason.VELOCITY | Reason.ACCELERATION, [0.002, 0.0]),
        (
            "position",
            [3.0, 0.0],
            Reason.POSITION | Reason.VELOCITY | Reason.ACCELERATION,
            [0.002, 0.0],
        ),
        ("effort", [6.0, -1.0], Reason.EFFORT | Reason.VELOCITY, [2.0, -1.0]),
    ],
)
def test_what_was_changed_is_said(
    rig: Rig, kind: str, values: list[float], reason: Reason, applied: list[float]
) -> None:
    answer = rig.command(kind, values)
    assert Reason(answer.reason) == reason
    assert answer.applied is not None
    np.testing.assert_allclose(answer.applied.values, applied, atol=1e-12)
    assert rig.counter("clipped_commands") == 1


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (RecordStop(), "got RecordStop, expected Command"),
        (
            Command(kind=CommandKind.EFFORT, joint_names=("z",), values=np.zeros(1), stamp_ns=0),
            "command names joints z, expected a, b",
        ),
        (
            Command(
                kind=CommandKind.EFFORT,
                joint_names=JOINTS,
                values=np.zeros(2),
                stamp_ns=0,
                number=3,
            ),
            "expected 0 to begin a session",
        ),
        (
            Command(
                kind=CommandKind.EFFORT,
                joint_names=JOINTS,
                values=np.array([0.0, np.nan]),
                stamp_ns=0,
            ),
            "NaN",
        ),
    ],
)
def test_what_is_no_command_never_reaches_the_robot(rig: Rig, message: Message, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        rig.ask("robot/command", message)
    assert rig.robot.told == []


def test_stale_commands_are_refused(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.0])
    rig.command("velocity", [0.2, 0.0])
    with pytest.raises(RefusedError, match="command 1 came after 1: stale"):
        rig.command("velocity", [0.1, 0.0], number=1)


@pytest.mark.parametrize("clock", ["lockstep", "wall"])
def test_of_many_that_wait_the_newest_command_acts_at_once(tmp_path: Path, clock: str) -> None:
    rig = Rig(tmp_path, clock=clock)
    rig.command("velocity", [0.1, 0.1])
    waiting = [rig.send(0.1) for _ in range(200)]
    stop = rig.send(0.0)
    rig.pass_time(PERIOD_S)
    assert rig.robot.told[-1].values.tolist() == [0.0, 0.0]
    assert rig.counter("superseded_commands") == 200
    with pytest.raises(RefusedError, match="command 1: a newer one came, 2"):
        waiting[0].poll()
    rig.pass_time(PERIOD_S)
    assert isinstance(stop.poll(), Observation)


@pytest.mark.parametrize(
    ("age_s", "words"),
    [
        (0.21, "command 1 is 230 ms old, expected at most 200 ms"),
        (-0.5, "command 1 is 480 ms in the future, expected at most 200 ms"),
    ],
)
def test_commands_of_another_time_are_refused_and_counted(
    wall: Rig, age_s: float, words: str
) -> None:
    wall.command("velocity", [0.1, 0.1])
    late = wall.send(0.2, age_s=age_s)
    wall.pass_time(PERIOD_S)
    with pytest.raises(RefusedError, match=words):
        late.poll()
    assert wall.counter("stale_commands") == 1
    assert max(told.values.max() for told in wall.robot.told) == pytest.approx(0.1)


# One driver


def test_a_stranger_does_not_take_the_robot(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    rig.asker = rig.connect("second")
    for number in (0, 5):
        with pytest.raises(RefusedError, match=r"the robot is held by first, heard 0\.0 s ago"):
            rig.command("velocity", [0.3, 0.3], number=number)
    with pytest.raises(RefusedError, match="held by first"):
        rig.ask("robot/object", PlaceObject(pose=np.array([0.6, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0])))
    with pytest.raises(RefusedError, match="held by first"):
        rig.ask("robot/release", ReleaseRobot())
    assert rig.robot.told[-1].values.tolist() == pytest.approx([0.1, 0.1])


def test_a_stranger_of_the_same_name_is_a_stranger(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    rig.asker = rig.connect("first")
    with pytest.raises(RefusedError, match="the robot is held by first"):
        rig.command("velocity", [0.3, 0.3], number=0)


def test_a_newer_command_of_a_stranger_does_not_hide_the_drivers(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    stop = rig.send(0.0)
    rig.asker, rig.number = rig.connect("second"), 0
    stranger = rig.send(0.3)
    rig.pass_time(PERIOD_S)
    assert isinstance(stop.poll(), Observation)
    with pytest.raises(RefusedError, match="held by first"):
        stranger.poll()


def test_a_released_robot_may_be_taken_and_its_session_is_over(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    assert rig.ask("robot/release", ReleaseRobot()) == Ack()
    rig.pass_time(0.1)
    assert rig.robot.told[-1].kind is CommandKind.POSITION
    with pytest.raises(RefusedError, match="command has number 1, expected 0"):
        rig.command("velocity", [0.1, 0.1])
    rig.asker = rig.connect("second")
    rig.command("velocity", [0.1, 0.1], number=0)


def test_a_robot_may_be_taken_from_a_driver_that_is_gone(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    rig.asker = rig.connect("second")
    rig.pass_time(4.9)
    with pytest.raises(
        RefusedError, match=r"heard 4\.9 s ago; expected that it lets go, or 5 s wit"
    ):
        rig.command("velocity", [0.1, 0.1], number=0)
    rig.pass_time(0.2)
    with pytest.raises(RefusedError, match="command has number 7, expected 0 to begin a session"):
        rig.command("velocity", [0.1, 0.1], number=7)
    rig.command("velocity", [0.1, 0.1], number=0)
    rig.asker = rig.connect("first")
    with pytest.raises(RefusedError, match="held by second"):
        rig.command("velocity", [0.1, 0.1], number=1)


# Recordings


def test_a_recording_holds_reports_and_both_commands(rig: Rig, tmp_path: Path) -> None:
    rig.command("position", [0.0, 0.0])
    rig.command("velocity", [0.0, 0.0])
    assert rig.ask("robot/record", RecordStart(name="one", metadata={"who": "me"})) == Ack()
    for step in range(1, 11):
        rig.command("velocity", [0.02 * step, 0.0])
    done = rig.ask("robot/record", RecordStop())
    assert isinstance(done, RecordDone)
    assert done == RecordDone(path=str(tmp_path / "one.mcap"), ticks=20)
    recording = read_recording(done.path)
    assert recording.joint_names == JOINTS
    assert len(recording.stamp_ns) == 20
    assert recording.command_kind is CommandKind.VELOCITY
    # The command that was in force when it began comes first.
    np.testing.assert_allclose(recording.command[:4, 0], [0.0, 0.02, 0.04, 0.06])
    assert recording.requested is not None
    np.testing.assert_array_equal(recording.requested, recording.command)
    assert recording.metadata["who"] == "me"
    assert recording.metadata["run"] == "default"
    assert rig.counter("recordings") == 1


def test_a_recording_says_why_commands_were_changed(rig: Rig, tmp_path: Path) -> None:
    rig.command("velocity", [0.0, 0.0])
    rig.ask("robot/record", RecordStart(name="one"))
    rig.command("velocity", [0.02, 0.0])
    rig.command("velocity", [9.0, 0.0])
    rig.ask("robot/record", RecordStop())
    with (tmp_path / "one.mcap").open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics=["/joint_command_reason"]))
    masks = [int.from_bytes(message.data[4:8], "little") for _, _, message in messages]
    changed = Reason.VELOCITY | Reason.ACCELERATION
    assert masks == [0, 0] + [changed] * 5  # five steps within the period
    stamps = [message.log_time for _, _, message in messages]
    assert np.diff(stamps)[-4:].tolist() == [4_000_000] * 4


def test_another_mode_ends_a_recording(rig: Rig) -> None:
    rig.command("velocity", [0.0, 0.0])
    rig.ask("robot/record", RecordStart(name="one"))
    for _ in range(6):
        rig.command("velocity", [0.0, 0.0])
    rig.command("position", [0.0, 0.0])
    done = rig.ask("robot/record", RecordStop())
    assert isinstance(done, RecordDone)
    assert done.ticks == 12
    assert read_recording(done.path).command_kind is CommandKind.VELOCITY


@pytest.mark.parametrize("name", ["", "../up", "a/b", ".hidden", "x" * 101])
def test_recordings_cannot_leave_their_folder(rig: Rig, name: str) -> None:
    with pytest.raises(RefusedError, match="expected letters, digits"):
        rig.ask("robot/record", RecordStart(name=name))


def test_recordings_are_never_overwritten(rig: Rig) -> None:
    rig.ask("robot/record", RecordStart(name="one"))
    with pytest.raises(RefusedError, match=r"one.mcap is being recorded"):
        rig.ask("robot/record", RecordStart(name="two"))
    rig.ask("robot/record", RecordStop())
    with pytest.raises(RefusedError, match="never overwritten"):
        rig.ask("robot/record", RecordStart(name="one"))
    with pytest.raises(RefusedError, match="nothing is being recorded"):
        rig.ask("robot/record", RecordStop())
    with pytest.raises(RefusedError, match="got Ack, expected RecordStart or RecordStop"):
        rig.ask("robot/record", Ack())


def test_closing_completes_the_recording_and_holds_the_robot(rig: Rig, tmp_path: Path) -> None:
    rig.command("velocity", [0.1, 0.0])
    rig.ask("robot/record", RecordStart(name="one"))
    for _ in range(10):
        rig.command("velocity", [0.1, 0.0])
    rig.bridge.close()
    assert [told.values.tolist() for told in rig.robot.told[-2:]] == [
        [0.0, 0.0],
        pytest.approx([0.022, 0.0]),
    ]
    assert rig.robot.told[-1].kind is CommandKind.POSITION
    assert len(read_recording(tmp_path / "one.mcap").stamp_ns) >= 20


class FullDisk:
    """A recording's file on a disk that takes no more."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        written = RecordingWriter.write_state

        def write(writer: RecordingWriter, *arguments: Any) -> None:
            if self.full:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            written(writer, *arguments)

        monkeypatch.setattr(RecordingWriter, "write_state", write)


def test_a_full_disk_ends_the_recording_and_control_goes_on(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = FullDisk(monkeypatch)
    rig.command("velocity", [0.0, 0.0])
    rig.ask("robot/record", RecordStart(name="one"))
    rig.command("velocity", [0.02, 0.0])
    disk.full = True
    for _ in range(5):
        assert rig.command("velocity", [0.02, 0.0]).reason == Reason.NONE
    words = r"one\.mcap: No space left on device; what there is stays in one\.mcap\.part"
    with pytest.raises(RefusedError, match=words):
        rig.ask("robot/record", RecordStop())
    assert (rig.counter("recordings"), rig.counter("lost_recordings")) == (0, 1)
    assert [path.name for path in tmp_path.iterdir()] == ["one.mcap.part"]
    disk.full = False
    assert rig.ask("robot/record", RecordStart(name="two")) == Ack()
    assert isinstance(rig.ask("robot/record", RecordStop()), RecordDone)


def test_what_a_crash_left_is_kept_aside(rig: Rig, tmp_path: Path) -> None:
    for crash in range(2):
        (tmp_path / "one.mcap.part").write_bytes(bytes([crash]) * 1000)
        rig.ask("robot/record", RecordStart(name="one"))
        rig.command("velocity", [0.0, 0.0], number=0)
        rig.ask("robot/record", RecordStop())
        (tmp_path / "one.mcap").unlink()
    kept = sorted(tmp_path.glob("*.part"))
    assert [path.name for path in kept] == [
        "one_crashed_1.mcap.part",
        "one_crashed_2.mcap.part",
    ]
    assert [path.read_bytes() for path in kept] == [b"\x00" * 1000, b"\x01" * 1000]


def test_a_recording_that_cannot_begin_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    rig = Rig(tmp_path / "file")
    with pytest.raises(RefusedError, match=r"one\.mcap: File exists$"):
        rig.ask("robot/record", RecordStart(name="one"))
    with pytest.raises(RefusedError, match="nothing is being recorded"):
        rig.ask("robot/record", RecordStop())


def test_work_in_a_thread_is_done_in_order_and_bounded() -> None:
    done: list[int] = []
    holds, began = threading.Event(), threading.Event()
    background = InThread(waiting=3)

    def wait() -> None:
        began.set()
        holds.wait()

    assert background.do(wait)
    began.wait()
    assert [background.do(partial(done.append, number)) for number in range(4)] == [
        True,
        True,
        True,
        False,
    ]
    holds.set()
    background.close(10.0)
    assert done == [0, 1, 2]


def test_a_disk_that_is_too_slow_ends_the_recording(tmp_path: Path) -> None:
    class Stuck(Background):
        def do(self, _piece: Piece) -> bool:
            return False

        def close(self, timeout_s: float) -> None:
            pass

    recorder = Recorder(tmp_path, dict, Stuck())
    answer = recorder.start(RecordStart(name="one"))
    with pytest.raises(RefusedError, match=r"one\.mcap: the disk is too slow"):
        answer()


# On the wall clock


@pytest.fixture
def wall(tmp_path: Path) -> Rig:
    return Rig(tmp_path, clock="wall")


def test_on_the_wall_clock_every_period_is_an_exchange(wall: Rig) -> None:
    before = wall.counter("ticks")
    wall.pass_time(1.0)
    assert wall.counter("ticks") - before == 50
    assert wall.counter("overruns") == 0


def test_silence_stops_the_robot_once(wall: Rig) -> None:
    wall.command("velocity", [0.1, 0.1])
    wall.pass_time(0.5)
    assert wall.counter("watchdog_trips") == 1
    speeds = [one.values[0] for one in wall.robot.told if one.kind is CommandKind.VELOCITY]
    top = int(np.argmax(speeds))
    np.testing.assert_allclose(speeds[top:], [0.1, 0.072, 0.044, 0.016, 0.0])
    assert [one.kind for one in wall.robot.told].count(CommandKind.POSITION) == 1
    newest = wall.observations.latest()
    assert isinstance(newest, Observation)
    assert newest.velocity.tolist() == [0.0, 0.0]


def test_silence_is_noticed_after_two_periods(wall: Rig) -> None:
    wall.command("velocity", [0.1, 0.1])
    wall.pass_time(0.015)
    assert wall.counter("watchdog_trips") == 0
    wall.pass_time(0.03)
    assert wall.counter("watchdog_trips") == 1


def test_after_silence_only_a_new_session_moves_the_robot(wall: Rig) -> None:
    wall.command("velocity", [0.1, 0.1])
    wall.pass_time(0.5)
    with pytest.raises(RefusedError, match=r"no command for \d+ ms, the robot holds; a command wi"):
        wall.command("velocity", [0.1, 0.1])
    assert wall.command("velocity", [0.1, 0.1], number=0).reason == Reason.NONE


def test_a_driver_that_keeps_up_is_not_stopped(wall: Rig) -> None:
    for _ in range(50):
        wall.command("velocity", [0.1, 0.1])
    assert wall.counter("watchdog_trips") == 0


def test_a_slow_bridge_counts_what_it_missed(wall: Rig) -> None:
    wall.clock.advance_s(0.1)
    wall.pass_time(0.02)
    assert wall.counter("overruns") == 4
    assert sum(wall.counter(f"jitter_to_{end}_ms") for end in (50, 20, 10)) == 0
    assert wall.counter("jitter_over_50_ms") == 1
    wall.pass_time(0.2)
    assert wall.counter("overruns") == 4
    assert wall.bridge.due_ns() is not None
    assert wall.bridge.due_ns() % 20_000_000 == 0  # where it would have been without the delay


def test_an_answer_says_when_its_command_was_heard_decided_and_sent(wall: Rig) -> None:
    answer = wall.command("velocity", [0.1, 0.1])
    now_ns = wall.clock.now_ns()
    assert 0 < answer.heard_ns <= answer.decided_ns <= answer.sent_ns <= now_ns
    assert answer.heard_ns % 20_000_000 == 0
    assert wall.bridge.status().gauges["read_to_send_p99_ms"] == 0.0
    assert wall.counter("command_age_to_20_ms") == 1


# Flight records


def flights(folder: Path) -> list[list[dict[str, Any]]]:
    files = sorted((folder / "flight").iterdir())
    return [[json.loads(line) for line in file.read_text().splitlines()] for file in files]


def test_every_stop_writes_what_came_before_it(wall: Rig, tmp_path: Path) -> None:
    for _ in range(300):
        wall.command("velocity", [0.1, 0.0])
    wall.pass_time(0.3)
    (head, *lines) = flights(tmp_path)[0]
    assert re.match(r"no command for 40 ms, the robot holds", head["why"])
    assert wall.counter("flight_records") == 1
    told = [line for line in lines if "applied" in line]
    reports = [line for line in lines if "position" in line]
    assert 200 <= len(reports) <= 500
    assert reports[-1]["stamp_ns"] - reports[0]["stamp_ns"] > 4.5e9
    asked = [line["requested"]["values"] for line in told if line["requested"]]
    assert asked[-1] == [0.1, 0.0]
    assert told[-1]["requested"] is None
    assert told[-1]["reason"] == ["WATCHDOG"]
    assert told[-1]["applied"][0]["kind"] == "position"


def test_only_so_many_flight_records_are_kept(tmp_path: Path) -> None:
    rig = Rig(tmp_path, clock="wall", flights_kept=2)
    for _ in range(4):
        rig.command("velocity", [0.1, 0.0], number=0)
        rig.pass_time(0.3)
    assert rig.counter("flight_records") == 4
    assert len(flights(tmp_path)) == 2


def test_a_flight_record_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    (tmp_path / "flight").write_text("")
    rig = Rig(tmp_path, clock="wall")
    rig.command("velocity", [0.1, 0.0])
    rig.pass_time(0.3)
    assert rig.counter("flight_records") == 0
    rig.command("velocity", [0.1, 0.0], number=0)


# Stops that somebody asks for


def test_anybody_may_stop_the_robot_and_only_a_new_session_moves_it(wall: Rig) -> None:
    for _ in range(10):
        wall.command("velocity", [0.1, 0.1])
    driver, wall.asker = wall.asker, wall.connect("person")
    assert wall.ask("robot/stop", StopRobot(reason="it smells")) == Ack()
    wall.pass_time(0.1)
    assert wall.robot.told[-1].kind is CommandKind.POSITION
    newest = wall.observations.latest()
    assert isinstance(newest, Observation)
    assert Reason.STOPPED in Reason(newest.reason)
    wall.asker = driver
    with pytest.raises(RefusedError, match="stopped by person: it smells; a command with number 0"):
        wall.command("velocity", [0.1, 0.1])
    wall.command("velocity", [0.1, 0.1], number=0)


def test_in_lockstep_a_stop_takes_the_time_that_it_needs(rig: Rig) -> None:
    for _ in range(10):
        rig.command("velocity", [0.4, 0.4])
    began_ns = rig.robot.time_ns()
    rig.ask("robot/stop", StopRobot(reason="enough"))
    rig.pass_time(1.0)
    assert rig.robot.told[-1].kind is CommandKind.POSITION
    assert rig.robot.time_ns() - began_ns == 80_000_000  # 0.4 rad/s at 7 rad/s^2, and the hold


@pytest.mark.parametrize("kind", ["velocity", "position", "effort"])
def test_a_soft_stop_scales_the_speed_to_zero_and_back(rig: Rig, kind: str) -> None:
    def go(step: int) -> Observation:
        wanted = 0.001 * step if kind == "position" else 0.05
        return rig.command(kind, [wanted, 0.0])

    for step in range(1, 20):
        go(step)
    driver, rig.asker = rig.asker, rig.connect("person")
    assert rig.ask("robot/speed", ScaleSpeed(scale=0.0)) == Ack()
    rig.asker = driver
    for step in range(20, 30):
        stands = go(step)
    assert Reason.SCALED in Reason(stands.reason)
    assert stands.velocity.tolist() == [0.0, 0.0]
    before = rig.robot.told[-1].values
    np.testing.assert_array_equal(go(30).position, stands.position)
    np.testing.assert_array_equal(rig.robot.told[-1].values, before)
    assert rig.ask("robot/speed", ScaleSpeed(scale=1.0)) == Ack()
    goes = [go(step) for step in range(31, 60)][-1]
    assert Reason(goes.reason) == Reason.NONE
    assert goes.applied is not None
    np.testing.assert_allclose(goes.applied.values[0], 0.059 if kind == "position" else 0.05)


def test_half_speed_is_half_of_every_speed(rig: Rig) -> None:
    rig.ask("robot/speed", ScaleSpeed(scale=0.5))
    answer = [rig.command("velocity", [0.04, -0.02]) for _ in range(5)][-1]
    assert answer.applied is not None
    np.testing.assert_allclose(answer.applied.values, [0.02, -0.01])


def test_who_did_not_slow_the_robot_down_does_not_let_it_go_faster(rig: Rig) -> None:
    rig.command("velocity", [0.0, 0.0])
    rig.asker = rig.connect("person")
    rig.ask("robot/speed", ScaleSpeed(scale=0.2))
    rig.asker = rig.connect("stranger")
    with pytest.raises(RefusedError, match="slowed down by person; expected that it or the driver"):
        rig.ask("robot/speed", ScaleSpeed(scale=1.0))
    rig.asker = rig.connect("person")
    assert rig.ask("robot/speed", ScaleSpeed(scale=1.0)) == Ack()
    for scale in (-0.1, 1.1, float("nan")):
        with pytest.raises(RefusedError, match=f"scale is {scale}, expected 0 to 1"):
            rig.ask("robot/speed", ScaleSpeed(scale=scale))


# Faults


def test_a_robot_whose_reports_grow_old_is_stopped(wall: Rig) -> None:
    wall.command("velocity", [0.1, 0.1])
    wall.robot.time_lead_ns = 201_000_000
    late = wall.send(0.1)
    wall.pass_time(PERIOD_S)
    with pytest.raises(
        RefusedError, match="robot: its newest report is 201 ms old, expected at mo"
    ):
        late.poll()
    assert wall.counter("stale_reports") == 1
    with pytest.raises(RefusedError, match="begins again"):
        wall.command("velocity", [0.1, 0.1])


def test_who_begins_while_the_bridge_closes_is_refused(wall: Rig) -> None:
    wall.command("velocity", [0.1, 0.1])
    wall.number = 0
    late = wall.send(0.2)
    wall.bridge.close()
    with pytest.raises(RefusedError, match="the bridge is closed"):
        late.poll()
    assert wall.robot.told[-1].kind is CommandKind.POSITION


def test_a_fault_of_the_robot_stops_it_and_nobody_begins_while_it_is_there(wall: Rig) -> None:
    wall.command("velocity", [0.02, 0.0])
    wall.robot.broken = "its button is pressed"
    wall.pass_time(0.5)
    assert wall.robot.told[-1].kind is CommandKind.POSITION
    for number in (0, 1):
        with pytest.raises(RefusedError, match="robot: its button is pressed"):
            wall.command("velocity", [0.02, 0.0], number=number)
    assert wall.counter("robot_faults") == 1
    assert wall.bridge.status().note == "robot: its button is pressed"
    wall.robot.broken = ""
    wall.pass_time(0.1)
    with pytest.raises(RefusedError, match="pressed; a command with number 0 begins again"):
        wall.command("velocity", [0.02, 0.0], number=2)
    assert wall.command("velocity", [0.02, 0.0], number=0).applied is not None


def test_after_a_fault_the_arm_begins_where_it_is_then(wall: Rig) -> None:
    wall.command("position", [0.0, 0.0])
    wall.robot.broken = "it is off"
    wall.pass_time(0.5)
    moved = Command(
        kind=CommandKind.POSITION, joint_names=JOINTS, values=np.array([0.4, -0.4]), stamp_ns=0
    )
    wall.robot.begin([moved], 0)  # by hand, while it was off
    wall.robot.broken = ""
    wall.pass_time(0.1)
    answer = wall.command("position", [0.4, -0.4], number=0)
    assert answer.applied is not None
    assert answer.applied.values.tolist() == [0.4, -0.4]
    assert answer.reason == Reason.NONE


def test_a_robot_that_has_a_fault_at_first_is_told_nothing(tmp_path: Path) -> None:
    rig = Rig(tmp_path, clock="wall")
    rig.robot.broken = "it is off"
    rig.pass_time(0.5)
    assert rig.robot.told == []
    with pytest.raises(RefusedError, match="robot: it is off"):
        rig.command("velocity", [0.0, 0.0])


def test_a_robot_without_drives_to_switch_says_so(wall: Rig) -> None:
    with pytest.raises(RefusedError, match="enable: this robot has nothing to switch"):
        wall.ask("robot/power", PowerRobot(action=PowerAction.ENABLE))
    with pytest.raises(RefusedError, match="got ReleaseRobot, expected PowerRobot"):
        wall.ask("robot/power", ReleaseRobot())


@pytest.mark.parametrize("kind", ["velocity", "position"])
def test_a_joint_that_something_holds_stops_the_robot(rig: Rig, kind: str) -> None:
    rig.robot.held = True

    def push() -> None:
        for step in range(200):
            rig.command(kind, [0.005 * step if kind == "position" else 0.4, 0.0])

    with pytest.raises(RefusedError, match=r"a is 0\.\d\d rad behind what it is told .* holds it"):
        push()
    assert rig.counter("stalls") == 1


@pytest.mark.parametrize("kind", ["velocity", "position"])
def test_a_joint_that_follows_does_not_stop_the_robot(rig: Rig, kind: str) -> None:
    for step in range(200):
        turn = 0.4 * np.sin(0.1 * step)
        rig.command(kind, [0.5 * turn if kind == "position" else turn, 0.0])
    assert rig.counter("stalls") == 0


def test_a_lost_robot_ends_the_session_and_is_tried_again(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    rig.robot.lost = True
    with pytest.raises(RefusedError, match="robot: no answer from the mirror robot"):
        rig.command("velocity", [0.1, 0.1])
    assert rig.counter("robot_failures") == 1
    rig.robot.lost = False
    with pytest.raises(RefusedError, match="a command with number 0 begins again"):
        rig.command("velocity", [0.1, 0.1])
    rig.command("velocity", [0.1, 0.1], number=0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("control_hz", 0.0), ("velocity_share", 1.5), ("position_margin_rad", -1.0)],
)
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match=f"{name} is {value}, expected"):
        BridgeConfig(**{name: value})


# The object


def test_where_the_robot_cannot_put_the_object_back_a_person_has_to(rig: Rig) -> None:
    pose = np.array([0.6, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0])
    assert rig.ask("robot/object", PlaceObject(pose=pose)) == ByHand()


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (PlaceObject(pose=np.zeros(7)), "quaternion of length 0, expected 1"),
        (RecordStop(), "got RecordStop, expected PlaceObject"),
    ],
)
def test_what_is_no_place_is_refused(rig: Rig, message: Message, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        rig.ask("robot/object", message)
    assert rig.counter("rejected_messages") == 1


LOAD = SetPayload(mass_kg=0.6, com_m=np.array([0.0, 0.0, 0.1]))


def test_where_the_robot_cannot_be_told_of_a_payload_a_person_has_to(rig: Rig) -> None:
    assert rig.ask("robot/payload", LOAD) == ByHand()


def test_nobody_but_its_driver_tells_a_robot_of_a_payload(rig: Rig) -> None:
    rig.command("velocity", [0.1, 0.1])
    rig.asker = rig.connect("second")
    with pytest.raises(RefusedError, match="held by first"):
        rig.ask("robot/payload", LOAD)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (replace(LOAD, mass_kg=-0.1), r"a mass of -0\.1 kg, expected 0 to 4 kg"),
        (replace(LOAD, mass_kg=6.0), r"a mass of 6 kg, expected 0 to 4 kg"),
        (replace(LOAD, mass_kg=float("nan")), r"a mass of nan kg, expected 0 to 4 kg"),
        (replace(LOAD, com_m=np.array([0.0, 0.6, 0.0])), r"its centre 0\.6 m from the last link"),
        (RecordStop(), "got RecordStop, expected SetPayload"),
    ],
)
def test_what_no_arm_carries_is_refused(rig: Rig, message: Message, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        rig.ask("robot/payload", message)
    assert rig.counter("rejected_messages") == 1


def settled(rig: Rig, share: float, kind: str = "velocity") -> Observation:
    """Commands as much as there is for a second; returns what came of the last command."""
    values = 100.0 * LIMITS.velocity
    return [rig.command(kind, values.tolist(), share=share) for _ in range(25)][-1]


@pytest.mark.parametrize(("share", "allowed"), [(0.05, 0.05), (0.4, 0.4), (0.9, 0.44), (1.0, 0.44)])
def test_no_joint_is_told_to_go_faster_than_the_share_of_its_task(tmp_path, share, allowed):
    seen = settled(Rig(tmp_path), share)
    assert seen.applied is not None
    assert seen.applied.values == pytest.approx(allowed * LIMITS.velocity)
    assert (Reason(seen.reason), seen.applied.speed_share) == (Reason.VELOCITY, share)


def test_a_share_holds_for_its_command_alone(tmp_path):
    rig = Rig(tmp_path)
    slow, fast = settled(rig, 0.05), settled(rig, 1.0)
    assert (slow.velocity < fast.velocity).all()
    assert fast.velocity == pytest.approx(0.44 * LIMITS.velocity)


def test_a_smaller_share_is_reached_by_a_ramp(tmp_path):
    rig = Rig(tmp_path)
    settled(rig, 1.0)
    speeds = [rig.command("velocity", [1.0, 2.0], share=0.05).velocity for _ in range(20)]
    steps = -np.diff(speeds, axis=0)
    assert (steps <= 0.5 * LIMITS.acceleration * PERIOD_S + 1e-12).all()
    assert speeds[-1] == pytest.approx(0.05 * LIMITS.velocity)


def test_positions_go_at_the_share_of_their_task(tmp_path):
    rig = Rig(tmp_path)
    ways = [rig.command("position", [0.9, 1.9], share=0.05).position for _ in range(30)]
    steps = np.diff(ways, axis=0)
    assert steps[-1] == pytest.approx(0.05 * LIMITS.velocity * PERIOD_S)
    assert (steps <= 0.05 * LIMITS.velocity * PERIOD_S + 1e-12).all()


def test_torques_lead_to_no_more_than_the_share_of_their_task(tmp_path):
    rig = Rig(tmp_path)
    told = rig.command("effort", [5.0, 3.0], share=0.05).applied
    assert told is not None
    # A joint of 1 kg m^2, in force until the robot stops by itself: 0.2 s and a period.
    assert (told.values * (0.2 + PERIOD_S) <= 0.05 * LIMITS.velocity + 1e-12).all()
    assert (told.values > 0.0).all()


@pytest.mark.parametrize("share", [float("nan"), float("inf"), -float("inf"), -0.05, 0.0, 1.0001])
def test_a_share_that_is_none_is_refused(tmp_path, share):
    rig = Rig(tmp_path)
    with pytest.raises(RefusedError, match=r"has the speed share .*, expected above 0 to 1"):
        rig.command("velocity", [0.1, 0.1], share=share)
    assert not rig.robot.told


def test_the_smallest_share_that_there_is_holds_the_arm(tmp_path):
    rig = Rig(tmp_path)
    seen = settled(rig, 5e-324)
    assert np.abs(seen.velocity).max() < 1e-300
    assert rig.bridge.status().note.startswith("commanded in velocity mode, at most 4.9e-324")


def test_an_observation_has_what_was_asked_for_beside_what_was_applied(tmp_path):
    rig = Rig(tmp_path, clock="wall")
    seen = rig.command("velocity", [9.0, -9.0])
    assert seen.requested is not None
    assert seen.applied is not None
    assert seen.requested.values.tolist() == [9.0, -9.0]
    assert seen.requested.stamp_ns == seen.applied.stamp_ns
    rig.ask("robot/stop", StopRobot(reason="enough"))
    rig.pass_time(3 * PERIOD_S)
    stopped = rig.observations.latest()
    assert isinstance(stopped, Observation)
    assert Reason.STOPPED in Reason(stopped.reason)
    assert stopped.requested is None
