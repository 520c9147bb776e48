"""The simulated Sawyer behind a rosbridge: its computer and its line."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from gfm.core import (
    ConfigError,
    ManualClock,
    Observation,
    RefusedError,
)
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm_robot_bridge.intera.sawyer import SawyerSettings
from gfm_robot_bridge.rosbridge_sawyer.config import RosbridgeConfig
from gfm_robot_bridge.rosbridge_sawyer.controller import Controller
from gfm_robot_bridge.rosbridge_sawyer.memory import MemoryDoor, MemoryLink
from gfm_robot_bridge.rosbridge_sawyer.service import RosbridgeService
from gfm_robot_bridge.rosbridge_sawyer.weather import Path as Way
from gfm_robot_bridge.rosbridge_sawyer.weather import Weather
from gfm_robot_bridge.simulated.__main__ import build_robot
from gfm_robot_bridge.simulated.robot import SimulatedRobot

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


def test_a_robot_that_was_held_up_has_a_clock_that_stood_still() -> None:
    line = Line()
    subscribe = {"op": "subscribe", "topic": "/robot/joint_states"}
    before = line.ask(subscribe, seconds=0.1)[-1]["msg"]["header"]["stamp"]["nsecs"]
    line.clock.advance_s(0.5)
    after = line.ask(seconds=0.1)[-1]["msg"]["header"]["stamp"]["nsecs"]
    assert 0 < after - before <= 110_000_000


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
        ({"ros": "0.0.0.0:9090"}, "ros is 0.0.0.0:9090, where anybody on the network may drive"),
    ],
)
def test_settings_that_cannot_be_are_refused(settings, words) -> None:
    with pytest.raises(ConfigError, match=words):
        RosbridgeConfig(**settings)


def test_it_listens_for_everybody_where_that_is_meant() -> None:
    assert RosbridgeConfig(ros="0.0.0.0:9090", insecure=True).ros == "0.0.0.0:9090"


FRAGMENT = """
<robot name="tool"><link name="tool"><inertial>
  <origin xyz="0 0 0.0755" rpy="0 0 0"/><mass value="1.0"/>
</inertial></link></robot>
"""


def urdf_msg(**changes: Any) -> dict[str, Any]:
    time = {"secs": 5, "nsecs": 0}
    return {"time": time, "link": "right_hand", "joint": "tool", "urdf": FRAGMENT} | changes


def test_a_load_of_its_description_is_borne_and_the_same_time_is_no_news(computer) -> None:
    computer.hear("/robot/urdf", urdf_msg())
    lifted = computer.run(0.3, 0.0).velocity[1]
    assert abs(lifted) > 0.02  # nothing hangs there: what is borne too much lifts the arm
    none = FRAGMENT.replace('"1.0"', '"0.0"')
    computer.hear("/robot/urdf", urdf_msg(urdf=none))
    assert computer.run(0.3, 0.0).velocity[1] == pytest.approx(lifted, abs=0.01)
    computer.hear("/robot/urdf", urdf_msg(urdf=none, time={"secs": 6, "nsecs": 0}))
    assert abs(computer.run(0.3, 0.0).velocity[1]) < 0.01


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"link": "right_l6"}, "urdf hangs on 'right_l6', expected 'right_hand'"),
        ({"joint": "other"}, r"urdf has no link\[@name='other'\]/inertial"),
        ({"urdf": "<robot"}, "urdf: unclosed token"),
        ({"urdf": FRAGMENT.replace('value="1.0"', "")}, "urdf has no mass with value"),
        ({"urdf": FRAGMENT.replace("0 0 0.0755", "0 0")}, "urdf: not enough values"),
        ({"urdf": FRAGMENT.replace('"1.0"', '"nan"')}, "urdf has a mass of nan"),
        ({"time": None}, "Expected `object`, got `null`"),
    ],
)
def test_what_is_no_load_is_refused(computer, changes, words) -> None:
    with pytest.raises(RefusedError, match=words):
        computer.hear("/robot/urdf", urdf_msg(**changes))
