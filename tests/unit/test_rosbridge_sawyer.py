"""The simulated Sawyer behind a rosbridge: its computer, its line, and the bridge before it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfm.core import (
    Command,
    CommandKind,
    ConfigError,
    ManualClock,
    Observation,
    RefusedError,
)
from gfm.recording import read_recording
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.transport import MemoryHub, MemoryTransport, PendingReply
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.intera.sawyer import InteraSawyer, SawyerSettings
from gfm_robot_bridge.limits import Reason
from gfm_robot_bridge.rosbridge_sawyer.config import RosbridgeConfig
from gfm_robot_bridge.rosbridge_sawyer.controller import Controller
from gfm_robot_bridge.rosbridge_sawyer.memory import MemoryDoor, MemoryLink
from gfm_robot_bridge.rosbridge_sawyer.service import RosbridgeService
from gfm_robot_bridge.rosbridge_sawyer.weather import Path as Way
from gfm_robot_bridge.rosbridge_sawyer.weather import Weather
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated.__main__ import build_robot
from gfm_robot_bridge.simulated.robot import SimulatedRobot
from gfm_wire import Message, PowerAction, PowerRobot, RecordDone, RecordStart, RecordStop

COUNT = len(JOINT_NAMES)
ARM = "/robot/limb/right"
SETTINGS = SawyerSettings(software=("5.3.0",), latency_s=0.004, speed_ratio=0.5, wait_s=1.0)


def command_msg(mode: int, **fields: list[float]) -> dict[str, Any]:
    return {"mode": mode, "names": list(JOINT_NAMES), **fields}


class Computer:
    """The robot's computer alone."""

    def __init__(self) -> None:
        self.arm = SimulatedRobot(READY)
        self.controller = Controller(self.arm)

    def hear(self, topic: str, msg: object) -> None:
        self.controller.hear(topic, msg, self.arm.time_ns)

    def enable(self) -> None:
        self.hear("/robot/set_super_enable", {"data": True})

    def run(self, seconds: float, speed: float | None = None) -> Observation:
        for _ in range(round(seconds / 0.02)):
            if speed is not None:
                msg = command_msg(2, velocity=[speed] * COUNT)
                self.hear(f"{ARM}/joint_command", msg)
            self.arm.advance(None, 20_000_000)
        return self.arm.latest

    def shown(self, *names: str) -> list[object]:
        state = self.controller.state()
        return [state[name] for name in names]


STOP = ("enabled", "stopped", "error", "estop_button", "estop_source")


@pytest.fixture
def computer() -> Computer:
    made = Computer()
    made.enable()
    return made


def test_it_is_off_at_first_and_does_not_move() -> None:
    computer = Computer()
    assert computer.shown(*STOP) == [False, False, False, 0, 0]
    moved = computer.run(0.5, 0.2).position - READY
    assert np.abs(moved).max() < 1e-3


def test_in_velocity_mode_a_stale_position_rides_along_unheeded(computer) -> None:
    for _ in range(20):
        msg = command_msg(2, velocity=[0.1] * COUNT, position=[3.0] * COUNT)
        computer.hear(f"{ARM}/joint_command", msg)
        computer.arm.advance(None, 20_000_000)
    np.testing.assert_allclose(computer.arm.latest.velocity, 0.1, atol=0.03)


@pytest.mark.parametrize(("timeout_s", "moves"), [(0.2, False), (0.6, True), (7.0, True)])
def test_the_watchdog_is_as_long_as_it_is_told(computer, timeout_s, moves) -> None:
    computer.hear(f"{ARM}/joint_command_timeout", {"data": timeout_s})
    computer.run(0.4, 0.1)
    report = computer.run(0.5)
    assert bool(np.abs(report.velocity).max() > 0.05) is moves
    # Longer than a second it never is.
    assert np.abs(computer.run(1.0).velocity).max() < 0.02


def test_the_button_stops_the_arm_until_reset_and_enabled(computer) -> None:
    computer.run(0.4, 0.1)
    computer.controller.press(pressed=True)
    assert computer.shown(*STOP) == [False, True, False, 1, 1]
    computer.run(0.2, 0.1)
    assert np.abs(computer.run(0.1, 0.1).velocity).max() < 0.02
    computer.hear("/robot/set_super_reset", {})
    assert computer.shown("estop_button") == [1]
    computer.controller.press(pressed=False)
    assert computer.shown(*STOP) == [False, True, False, 3, 1]
    computer.enable()
    assert computer.shown("enabled") == [False]
    computer.hear("/robot/set_super_reset", {})
    assert computer.shown(*STOP) == [False, False, False, 0, 0]
    computer.enable()
    before = computer.arm.latest.position
    after = computer.run(0.3).position
    np.testing.assert_allclose(after, before, atol=2e-3)
    np.testing.assert_allclose(computer.run(0.4, -0.1).velocity, -0.1, atol=0.03)


def test_the_arm_stops_on_its_way_to_a_position(computer) -> None:
    msg = command_msg(1, position=(READY + 0.3).tolist())
    computer.hear(f"{ARM}/joint_command", msg)
    assert np.abs(computer.run(0.1).velocity).max() > 0.2
    computer.hear("/robot/set_super_stop", {})
    assert computer.shown(*STOP) == [False, True, False, 0, 2]
    computer.run(0.3)
    assert np.abs(computer.run(0.1).velocity).max() < 0.02


def test_a_fault_of_a_joint_is_an_error(computer) -> None:
    computer.controller.break_joint()
    assert computer.shown(*STOP) == [False, True, True, 2, 3]


@pytest.mark.parametrize(
    ("msg", "words"),
    [
        (command_msg(4, position=[0.0] * 7), "mode 4, expected 1, 2 or 3"),
        (command_msg(2, velocity=[0.0]), "velocity has 1 numbers, expected 7"),
        (command_msg(2, position=[0.0] * 7), "velocity has 0 numbers, expected 7"),
        ({**command_msg(2), "names": ["right_j0"]}, "names right_j0, expected right_j0, right_j1"),
        ({}, "missing required field `mode`"),
    ],
)
def test_what_is_no_command_is_refused(computer, msg, words) -> None:
    with pytest.raises(RefusedError, match=words):
        computer.hear(f"{ARM}/joint_command", msg)


def test_messages_are_late_and_never_overtake() -> None:
    way = Way[int](Weather(latency_s=0.01, jitter_s=0.05), np.random.default_rng(1))
    for k in range(200):
        way.put(k, k * 1_000_000, may_be_lost=True)
    assert way.arrived(9_000_000) == []
    seen = [(ms, k) for ms in range(300) for k in way.arrived(ms * 1_000_000)]
    assert [k for _, k in seen] == list(range(200))
    late = np.array([ms - k for ms, k in seen])
    assert late.min() >= 10
    assert 50 < late.max() <= 61


def test_so_many_messages_are_lost_and_none_that_must_not_be() -> None:
    way = Way[int](Weather(loss=0.3), np.random.default_rng(2))
    for k in range(2000):
        way.put(k, 0, may_be_lost=k % 2 == 0)
    arrived = np.array(way.arrived(0))
    assert (arrived % 2 == 1).sum() == 1000
    assert (arrived % 2 == 0).sum() == pytest.approx(700, abs=60)


class Line:
    """A client of the robot's rosbridge, in memory."""

    def __init__(self, **settings: Any) -> None:
        self.clock = ManualClock(10**18)
        self.door = MemoryDoor()
        config = RosbridgeConfig(name="robot", **settings)
        self.service = RosbridgeService(config, build_robot(config), self.door, self.clock)
        self.link = MemoryLink(self.door, self.clock)
        self.link.open()

    def ask(self, *ops: dict[str, Any], seconds: float = 0.1) -> list[dict[str, Any]]:
        for op in ops:
            self.link.say(op)
        for _ in range(round(seconds / 1e-3)):
            self.clock.advance_s(1e-3)
            while self.service.step():
                pass
        return [arrived.op for arrived in self.link.receive()]


def test_the_limits_are_told_to_whoever_comes_late() -> None:
    line = Line()
    line.ask()
    topic = "/robot/joint_limits"
    (op,) = line.ask({"op": "subscribe", "topic": topic})
    assert op["topic"] == topic
    assert list(op["msg"]) == [
        *("joint_names", "position_lower", "position_upper", "velocity", "accel", "effort")
    ]


def test_states_come_at_100_hz_with_other_joints_and_the_robots_stamp() -> None:
    line = Line(clock_ahead_s=3.0)
    ops = line.ask({"op": "subscribe", "topic": "/robot/joint_states"}, seconds=1.0)
    assert len(ops) == pytest.approx(100, abs=1)
    assert ops[0]["msg"]["name"] == ["head_pan", *JOINT_NAMES, "torso_t0"]
    assert ops[0]["msg"]["header"]["stamp"]["secs"] == 10**9 + 3
    positions = np.array([op["msg"]["position"][1:8] for op in ops])
    steps = positions / 2e-5
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert positions.std(axis=0) == pytest.approx(np.full(COUNT, 1e-4), rel=0.4)


def test_it_answers_as_rosapi_does() -> None:
    name = "/manifest/robot_software/version/HLR_VERSION_STRING"
    call = {"op": "call_service", "service": "/rosapi/get_param", "id": "7"}
    known, unknown = Line().ask(
        {**call, "args": {"name": name}}, {**call, "args": {"name": "/x", "default": "none"}}
    )
    assert known == {
        "op": "service_response",
        "service": "/rosapi/get_param",
        "values": {"value": '"5.3.0.0"'},
        "result": True,
        "id": "7",
    }
    assert json.loads(unknown["values"]["value"]) == "none"


@pytest.mark.parametrize(
    ("op", "words"),
    [
        ({"op": "fly"}, "op 'fly', expected one of rosbridge's version 2"),
        ({"op": "publish", "topic": "/x", "msg": {}}, "nobody listens on /x"),
        ({"op": "publish", "topic": "/robot/set_super_enable", "msg": {}}, "missing required"),
        ({"op": "call_service", "service": "/x"}, "there is no service /x"),
    ],
)
def test_what_cannot_be_done_is_answered_by_a_status(op, words) -> None:
    line = Line()
    (answer,) = line.ask({**op, "id": "a"})
    assert (answer["op"], answer["level"], answer["id"]) == ("status", "error", "a")
    assert words in answer["msg"]
    assert line.service.status().counters["rejected_messages"] == 1


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"clock": "lockstep"}, "clock is lockstep, expected wall"),
        ({"task": "pose"}, "task is pose, expected none"),
        ({"loss": 1.5}, "loss is 1.5, expected 0 to 1"),
        ({"ros": "here"}, "ros is 'here', expected HOST:PORT"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, words) -> None:
    with pytest.raises(ConfigError, match=words):
        RosbridgeConfig(**settings)


class Cell:
    """Driver, bridge and robot in one thread."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.line = Line(**settings)
        self.clock = self.line.clock
        robot = InteraSawyer(self.line.link, self.clock, SETTINGS)
        config = BridgeConfig(
            name="bridge", robot="sawyer", ros="memory:1", control_hz=20.0, recordings=str(folder)
        )
        hub = MemoryHub()
        transport = MemoryTransport(hub, name="bridge", clock=self.clock)
        self.bridge = BridgeService(config, robot, transport, self.clock)
        self.driver = MemoryTransport(hub, name="driver", clock=self.clock)
        self.number = 0
        self.run(1.2)
        self.ask("robot/power", PowerRobot(action=PowerAction.ENABLE))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            self.clock.advance_s(1e-3)
            self.line.link.pass_time()
            while self.line.service.step():
                pass
            while self.bridge.step():
                pass

    def ask(self, key: str, message: Message) -> Message:
        return self.answer(self.driver.request(key, message, timeout_s=5.0))

    def answer(self, pending: PendingReply) -> Message:
        while (answer := pending.poll()) is None:
            self.run(1e-3)
        return answer

    def drive(self, speed: float, seconds: float) -> Observation:
        """Commands a speed at 20 Hz, as a driver that waits for its answer does."""
        self.number, until_ns = 0, self.clock.now_ns() + round(seconds * 1e9)
        while True:
            sent = Command(
                kind=CommandKind.VELOCITY,
                joint_names=JOINT_NAMES,
                values=np.full(COUNT, speed),
                stamp_ns=self.clock.utc_ns(),
                number=self.number,
            )
            self.number += 1
            answer = self.ask("robot/command", sent)
            assert isinstance(answer, Observation)
            if self.clock.now_ns() >= until_ns:
                return answer


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[Cell]:
    made = Cell(tmp_path, latency_s=0.003, jitter_s=0.01, loss=0.05, clock_ahead_s=-30.0)
    yield made
    made.bridge.close()


def test_it_is_driven_through_a_line_that_is_late_and_loses(cell: Cell) -> None:
    answer = cell.drive(0.1, 2.0)
    np.testing.assert_allclose(answer.velocity, 0.1, atol=0.03)
    counters = cell.bridge.status().counters
    assert [counters[name] for name in ("watchdog_trips", "stalls", "stale_reports")] == [0, 0, 0]
    assert counters["robot_failures"] == 1  # until it had introduced itself


def test_a_recording_tells_of_the_robot_it_is_of(cell: Cell, tmp_path: Path) -> None:
    cell.ask("robot/record", RecordStart(name="driven", metadata={}))
    cell.drive(0.05, 1.0)
    done = cell.ask("robot/record", RecordStop())
    assert isinstance(done, RecordDone)
    recording = read_recording(tmp_path / "driven.mcap")
    assert recording.metadata["robot"] == "sawyer"
    assert recording.metadata["robot_software"] == "5.3.0"
    # Behind by 30 s, and by the least delay of the line.
    assert -30.02 < float(recording.metadata["robot_clock_ahead_s"]) < -30.0
    assert recording.joint_names == JOINT_NAMES


def test_closing_leaves_the_arm_at_rest(tmp_path: Path) -> None:
    cell = Cell(tmp_path)
    cell.drive(0.1, 0.5)
    cell.bridge.close()
    assert not cell.line.link.is_open
    cell.line.link.open()
    ops = cell.line.ask({"op": "subscribe", "topic": "/robot/joint_states"}, seconds=1.0)
    # The robot's time stood still while the bridge was closed.
    assert np.abs(np.mean([op["msg"]["velocity"] for op in ops[-10:]], axis=0)).max() < 0.01


def test_a_command_is_answered_with_what_became_of_it(tmp_path: Path) -> None:
    cell = Cell(tmp_path)
    cell.drive(0.1, 0.5)
    cell.run(1.0)
    assert cell.bridge.status().counters["watchdog_trips"] == 1
    answer = cell.drive(0.0, 0.0)
    assert answer.reason == Reason.NONE
    assert answer.applied is not None
    assert answer.applied.kind is CommandKind.VELOCITY
    assert np.abs(answer.velocity).max() < 0.02
