"""A Sawyer behind a rosbridge: what is said to it, what is read of it, when it is refused."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from gfm.core import (
    Command,
    CommandKind,
    ConfigError,
    LostError,
    ManualClock,
    RefusedError,
    UnreachableError,
)
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.intera.assembly import Assembly
from gfm_robot_bridge.intera.clock_offset import ClockOffset
from gfm_robot_bridge.intera.introduction import check_version, tighter, version_of
from gfm_robot_bridge.intera.messages import (
    assembly,
    joint_command,
    joint_limits,
    joint_report,
    urdf_configuration,
)
from gfm_robot_bridge.intera.power import Switching
from gfm_robot_bridge.intera.sawyer import InteraSawyer, SawyerSettings
from gfm_robot_bridge.intera.topics import ENABLE
from gfm_robot_bridge.rosbridge_sawyer.memory import MemoryDoor, MemoryLink
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_wire import PowerAction, SetPayload

COUNT = len(JOINT_NAMES)
UTC_NS = 1_600_000_000_000_000_000
SETTINGS = SawyerSettings(software=("5.3.0",), latency_s=0.004, speed_ratio=0.5, wait_s=1.0)
WELL: dict[str, Any] = {
    "homed": True,
    "ready": True,
    "enabled": True,
    "stopped": False,
    "error": False,
    "lowVoltage": False,
    "estop_button": 0,
    "estop_source": 0,
}


def limits_msg(**changes: Any) -> dict[str, Any]:
    limits = sawyer_limits()
    return {
        "joint_names": list(JOINT_NAMES),
        "position_lower": limits.lower.tolist(),
        "position_upper": limits.upper.tolist(),
        "velocity": limits.velocity.tolist(),
        "accel": limits.acceleration.tolist(),
        "effort": limits.effort.tolist(),
    } | changes


def states_msg(stamp_ns: int) -> dict[str, Any]:
    """Returns joint states as the robot writes them: the head first, the torso last."""
    return {
        "header": {
            "seq": 5,
            "stamp": {"secs": stamp_ns // 10**9, "nsecs": stamp_ns % 10**9},
            "frame_id": "",
        },
        "name": ["head_pan", *JOINT_NAMES, "torso_t0"],
        "position": [9.0, *(1.0 * np.arange(COUNT)).tolist(), 9.0],
        "velocity": [9.0, *(0.1 * np.arange(COUNT)).tolist(), 9.0],
        "effort": [9.0, *(0.2 * np.arange(COUNT)).tolist(), 9.0],
    }


def command(kind: CommandKind, value: float, stamp_ns: int = 1_500_000_000) -> Command:
    values = np.full(COUNT, value)
    return Command(kind=kind, joint_names=JOINT_NAMES, values=values, stamp_ns=stamp_ns)


class Script:
    """A robot that says what a test has it say, and remembers what it is told."""

    def __init__(self) -> None:
        self.clock = ManualClock(UTC_NS)
        self.door = MemoryDoor()
        self.told: list[dict[str, Any]] = []
        self.client = -1
        self.link = MemoryLink(self.door, self.clock)
        self.robot = InteraSawyer(self.link, self.clock, SETTINGS)

    def hear(self) -> None:
        while (said := self.door.receive()) is not None:
            if said.op is not None:
                self.client = said.client
                self.told.append(said.op)

    def say(self, topic: str, msg: Mapping[str, Any]) -> None:
        self.door.send(self.client, {"op": "publish", "topic": topic, "msg": msg})

    def say_all(self, *, version: str = "5.3.0.7", limits: Mapping[str, Any] | None = None) -> None:
        answer = {"op": "service_response", "service": "/rosapi/get_param", "result": True}
        self.door.send(self.client, {**answer, "values": {"value": f'"{version}"'}})
        self.say("/robot/joint_limits", limits or limits_msg())
        self.say("/robot/state", WELL)
        self.say("/robot/joint_states", states_msg(self.clock.now_ns()))

    def connect(self, **said: Any) -> None:
        self.robot.begin((), 0)
        self.hear()
        self.say_all(**said)
        self.robot.poll()

    def commands(self) -> list[dict[str, Any]]:
        return [
            op["msg"]
            for op in self.told
            if op["op"] == "publish" and op["topic"] == "/robot/limb/right/joint_command"
        ]

    def tell(self, kind: CommandKind, value: float) -> None:
        self.robot.begin((command(kind, value, self.robot.time_ns()),), 0)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            self.clock.advance_s(1e-3)
            self.link.pass_time()
        self.hear()


@pytest.fixture
def script() -> Script:
    made = Script()
    made.connect()
    return made


@pytest.mark.parametrize(
    ("kind", "mode", "field"),
    [
        (CommandKind.POSITION, 1, "position"),
        (CommandKind.VELOCITY, 2, "velocity"),
        (CommandKind.EFFORT, 3, "effort"),
    ],
)
def test_a_command_fills_the_field_of_its_mode_and_no_other(kind, mode, field) -> None:
    empty = {"position": [], "velocity": [], "acceleration": [], "effort": []}
    assert joint_command(command(kind, 0.5)) == {
        "header": {"stamp": {"secs": 1, "nsecs": 500_000_000}, "frame_id": ""},
        "mode": mode,
        "names": list(JOINT_NAMES),
        **empty,
        field: [0.5] * COUNT,
    }


def test_joints_are_found_by_name_and_others_left_out() -> None:
    report = joint_report(states_msg(3_000_000_007), JOINT_NAMES[::-1])
    assert report is not None
    assert report.stamp_ns == 3_000_000_007
    assert report.position.tolist() == [6.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0]
    np.testing.assert_allclose(report.velocity, 0.1 * np.arange(COUNT)[::-1])
    np.testing.assert_allclose(report.effort, 0.2 * np.arange(COUNT)[::-1])


def test_states_of_other_joints_are_no_report() -> None:
    gripper = {**states_msg(0), "name": ["finger"], "position": [0.0]}
    assert joint_report(gripper, JOINT_NAMES) is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": ["head_pan", "right_j0"]}, "names head_pan, right_j0, expected also right_j1"),
        ({"velocity": []}, r"joint_states.velocity has 0 numbers, expected one for each name"),
        ({"position": [None] * 9}, r"joint_states: Expected `float`, got `null`"),
        ({"header": {}}, r"joint_states: .* missing required field `stamp`"),
    ],
)
def test_a_report_that_is_not_as_declared_is_refused(changes, words) -> None:
    with pytest.raises(RefusedError, match=words):
        joint_report({**states_msg(0), **changes}, JOINT_NAMES)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, ""),
        ({"estop_button": 1, "stopped": True}, "e-stop button is pressed"),
        ({"estop_button": 3, "stopped": True, "estop_source": 1}, "stopped by its e-stop button"),
        ({"stopped": True, "estop_source": 3}, "stopped for a fault of a joint"),
        ({"error": True}, "has an error"),
        ({"lowVoltage": True}, "low voltage"),
        ({"homed": False}, "not homed"),
        ({"enabled": False, "ready": False}, "not enabled: `gfm robot enable`"),
        ({"ready": False}, "not ready"),
    ],
)
def test_a_fault_is_told_in_words(changes, words) -> None:
    fault = assembly({**WELL, **changes}).fault()
    assert words in fault
    assert bool(fault) == bool(words)


def test_a_state_with_an_unknown_value_is_refused() -> None:
    with pytest.raises(RefusedError, match="Invalid enum value 7"):
        assembly({**WELL, "estop_source": 7})


def test_of_two_limits_the_tighter_holds() -> None:
    said = joint_limits(
        limits_msg(velocity=[1.0, *[9.0] * 6], position_upper=[9.0] * 7), JOINT_NAMES
    )
    with pytest.raises(ConfigError, match=r"upper end of right_j1 is at 9 rad, expected 2\.2736"):
        tighter(said, sawyer_limits(), JOINT_NAMES)
    upper = (sawyer_limits().upper + np.linspace(-0.1, 0.1, COUNT)).tolist()
    said = joint_limits(limits_msg(velocity=[1.0, *[9.0] * 6], position_upper=upper), JOINT_NAMES)
    both = tighter(said, sawyer_limits(), JOINT_NAMES)
    assert both.velocity.tolist() == [1.0, *sawyer_limits().velocity[1:]]
    np.testing.assert_allclose(both.upper, np.minimum(upper, sawyer_limits().upper))


def test_limits_of_joints_beside_the_arms_do_not_count() -> None:
    msg = {name: [7.0, *values] for name, values in limits_msg(joint_names=[]).items()}
    msg["joint_names"] = ["head_pan", *JOINT_NAMES]
    np.testing.assert_array_equal(joint_limits(msg, JOINT_NAMES).lower, sawyer_limits().lower)


def test_a_limit_that_is_none_is_refused() -> None:
    with pytest.raises(RefusedError, match="acceleration of right_j0, expected more than 0"):
        joint_limits(limits_msg(accel=[0.0] * 7), JOINT_NAMES)


@pytest.mark.parametrize("text", ['"5.3.0"', '"5.3.0.0"', '"5.3.0-rc1"'])
def test_a_version_is_its_first_three_numbers(text) -> None:
    assert version_of({"values": {"value": text}}) == "5.3.0"


@pytest.mark.parametrize(
    "answer",
    [{"values": {"value": '""'}}, {"values": {"value": "null"}}, {"values": "no such service"}, {}],
)
def test_an_answer_without_a_version_is_refused(answer) -> None:
    with pytest.raises(ConfigError, match="is rosapi running beside rosbridge"):
        version_of(answer)


def test_an_unknown_version_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"version 5\.2\.2, expected one of 5\.3\.0, 5\.3\.1"):
        check_version("5.2.2", ("5.3.0", "5.3.1"))


def test_the_offset_of_a_clock_is_that_of_the_quickest_message() -> None:
    offset, rng = ClockOffset(), np.random.default_rng(0)
    delays = 2_000_000 + rng.integers(0, 5_000_000, 500)
    for k, delay in enumerate(delays):
        sent_ns = k * 10_000_000
        offset.add(sent_ns + 7_000_000_000, sent_ns + int(delay))
    assert offset.ns == 7_000_000_000 - delays.min()
    assert offset.newest_delay_ns == delays[-1] - delays.min()


def test_a_clock_that_drifts_is_followed_within_a_window() -> None:
    offset = ClockOffset(window_ns=1_000_000_000)
    for k in range(1000):
        now_ns = k * 10_000_000
        offset.add(now_ns - k * 1000, now_ns)
    # Slower by 1e-4: what counts is the oldest in the window.
    assert offset.ns == -899_000


def test_before_the_first_message_no_offset_is_known() -> None:
    assert (ClockOffset().known, ClockOffset().ns) == (False, 0)


def state(**changes: Any) -> Assembly:
    return assembly({**WELL, **changes})


def test_the_robot_is_told_until_its_state_follows_and_then_never_again() -> None:
    off, switching = state(enabled=False), Switching(PowerAction.ENABLE, state(enabled=False), 0)
    assert switching.due(off, 0) == (ENABLE, {"data": True})
    assert switching.due(off, 50_000_000) is None
    assert switching.due(off, 100_000_000) == (ENABLE, {"data": True})
    assert not switching.is_done(off, 150_000_000)
    assert switching.is_done(state(), 160_000_000)
    # Whatever happens afterwards: it is not enabled again.
    assert switching.due(off, 10_000_000_000) is None


def test_a_robot_that_does_not_follow_is_told_for_five_seconds() -> None:
    off = state(enabled=False)
    switching = Switching(PowerAction.ENABLE, off, 0)
    with pytest.raises(RefusedError, match="enable did nothing within 5 s: it is not enabled"):
        switching.is_done(off, 5_100_000_000)
    assert switching.due(off, 5_100_000_000) is None


@pytest.mark.parametrize(
    ("action", "changes", "words"),
    [
        (PowerAction.ENABLE, {"error": True}, "not enabled while a part of it has an error"),
        (PowerAction.RESET, {}, "nothing to reset"),
        (PowerAction.RESET, {"stopped": True, "estop_button": 1}, "release it first"),
    ],
)
def test_what_would_hide_a_fault_is_refused(action, changes, words) -> None:
    with pytest.raises(RefusedError, match=words):
        Switching(action, state(**changes), 0)


def test_it_greets_the_robot_before_the_first_motion(script) -> None:
    script.hear()
    said = [(op["op"], op.get("topic") or op.get("service")) for op in script.told]
    arm = "/robot/limb/right"
    assert said == [
        ("advertise", f"{arm}/joint_command"),
        ("advertise", f"{arm}/joint_command_timeout"),
        ("advertise", f"{arm}/set_speed_ratio"),
        ("advertise", "/robot/set_super_enable"),
        ("advertise", "/robot/set_super_stop"),
        ("advertise", "/robot/set_super_reset"),
        ("advertise", "/robot/urdf"),
        ("subscribe", "/robot/joint_states"),
        ("subscribe", "/robot/state"),
        ("subscribe", "/robot/joint_limits"),
        ("call_service", "/rosapi/get_param"),
        ("publish", f"{arm}/joint_command_timeout"),
        ("publish", f"{arm}/set_speed_ratio"),
    ]
    assert script.told[-2]["msg"] == {"data": 0.2}
    assert script.told[-1]["msg"] == {"data": 0.5}
    assert script.told[10]["args"]["name"] == "/manifest/robot_software/version/HLR_VERSION_STRING"


def test_what_the_robot_is_to_keep_is_told_again_every_second(script) -> None:
    script.hear()
    script.told.clear()
    script.clock.advance_s(0.9)
    script.robot.begin((), 0)
    script.hear()
    assert script.told == []
    script.clock.advance_s(0.2)
    script.robot.begin((), 0)
    script.hear()
    assert [op["msg"]["data"] for op in script.told] == [0.2, 0.5]


def test_setpoints_are_sent_at_their_times_and_newer_ones_replace_what_waits(script) -> None:
    now_ns = script.robot.time_ns()
    plan = [command(CommandKind.VELOCITY, 0.01 * k, now_ns + k * 4_000_000) for k in range(5)]
    script.robot.begin(plan, 0)
    script.run(0.009)
    assert [msg["velocity"][0] for msg in script.commands()] == [0.0, 0.01, 0.02]
    script.tell(CommandKind.VELOCITY, 0.5)
    script.run(0.02)
    assert [msg["velocity"][0] for msg in script.commands()] == [0.0, 0.01, 0.02, 0.5]


@pytest.mark.parametrize("kind", [CommandKind.VELOCITY, CommandKind.EFFORT])
def test_a_mode_is_left_by_a_position_told_ten_times(script, kind) -> None:
    script.tell(kind, 0.1)
    script.tell(CommandKind.POSITION, 1.0)
    script.run(0.1)
    assert [msg["mode"] for msg in script.commands()[1:]] == [1] * 10
    script.tell(CommandKind.POSITION, 1.0)
    script.run(0.1)
    assert len(script.commands()) == 12


def test_a_new_command_ends_the_repetition(script) -> None:
    script.tell(CommandKind.VELOCITY, 0.1)
    script.tell(CommandKind.POSITION, 1.0)
    script.run(0.005)
    script.tell(CommandKind.VELOCITY, 0.2)
    script.run(0.1)
    assert [msg["mode"] for msg in script.commands()] == [2, 1, 1, 2]


def test_closing_says_what_waits(script) -> None:
    script.tell(CommandKind.VELOCITY, 0.1)
    script.tell(CommandKind.POSITION, 1.0)
    script.robot.close()
    script.hear()
    assert [msg["mode"] for msg in script.commands()[1:]] == [1] * 10


def test_a_speed_that_could_not_be_sent_in_time_is_not_sent(script) -> None:
    later_ns = script.robot.time_ns() + 10_000_000
    script.robot.begin((command(CommandKind.VELOCITY, 0.1, later_ns),), 0)
    script.clock.advance_s(0.2)
    script.link.pass_time()
    script.hear()
    assert script.commands() == []


def test_reports_out_of_order_are_counted_and_left_out(script) -> None:
    now_ns = script.clock.now_ns()
    for after_ms in (10, 30, 20, 30, 40):
        script.say("/robot/joint_states", states_msg(now_ns + after_ms * 1_000_000))
    reports = script.robot.poll()
    assert reports is not None
    assert [(r.stamp_ns - now_ns) // 1_000_000 for r in reports] == [10, 30, 40]
    assert script.robot.counters()["late_reports"] == 2


def test_what_is_not_as_declared_is_counted(script) -> None:
    script.say("/robot/joint_states", {"name": 7})
    script.say("/robot/state", {})
    script.say("/something/else", {})
    script.robot.poll()
    assert script.robot.counters()["refused_reports"] == 3


def test_a_fault_that_came_and_went_is_told_once(script) -> None:
    script.robot.fault()
    script.say("/robot/state", {**WELL, "stopped": True, "estop_source": 2})
    script.say("/robot/state", WELL)
    script.robot.poll()
    assert "it is stopped by software" in script.robot.fault()
    assert script.robot.fault() == ""


def test_a_state_that_is_not_renewed_is_a_fault(script) -> None:
    script.clock.advance_s(1.5)
    script.say("/robot/joint_states", states_msg(script.clock.now_ns()))
    script.robot.poll()
    assert script.robot.fault() == "/robot/state is silent"


def test_a_robot_that_says_nothing_is_lost_and_connected_again(script) -> None:
    script.clock.advance_s(1.5)
    with pytest.raises(LostError, match=r"rosbridge in memory: nothing was heard for 1\.5 s"):
        script.robot.poll()
    script.robot.begin((), 0)
    with pytest.raises(LostError, match="waiting for its software's version, /robot/joint_limits"):
        script.robot.poll()
    script.hear()
    script.say_all()
    assert script.robot.poll() is not None
    assert script.robot.counters()["connections"] == 2


def test_what_was_planned_for_a_lost_connection_is_forgotten(script) -> None:
    later_ns = script.robot.time_ns() + 50_000_000
    script.robot.begin((command(CommandKind.VELOCITY, 0.1, later_ns),), 0)
    script.link.drop("the line is cut")
    with pytest.raises(LostError, match="the line is cut"):
        script.robot.poll()
    script.connect()
    script.run(0.1)
    assert script.commands() == []


def test_a_robot_that_became_another_is_refused(script) -> None:
    script.link.drop("the line is cut")
    with pytest.raises(LostError, match="the line is cut"):
        script.robot.poll()
    slower = limits_msg(velocity=[0.5] * 7)
    with pytest.raises(LostError, match="joint limits changed; start the bridge anew"):
        script.connect(limits=slower)
    with pytest.raises(LostError, match="joint limits changed"):
        script.robot.poll()


def test_a_clock_that_was_set_back_is_refused(script) -> None:
    script.say("/robot/joint_states", states_msg(script.clock.now_ns() - 60_000_000_000))
    with pytest.raises(LostError, match=r"clock went back by 60\.0 s; start the bridge anew"):
        script.robot.poll()


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"version": "5.1.2"}, r"version 5\.1\.2, expected one of 5\.3\.0"),
        ({"limits": limits_msg(position_lower=[-9.0] * 7)}, "is it a Sawyer"),
    ],
)
def test_a_robot_that_is_not_as_expected_is_not_met(said, words) -> None:
    script = Script()
    with pytest.raises(LostError, match=words):
        script.connect(**said)
    with pytest.raises(ConfigError, match=words):
        script.robot.meet()


def test_a_robot_that_stays_away_is_told() -> None:
    script = Script()
    script.door.is_shut = True
    with pytest.raises(UnreachableError, match=r"Sawyer \(no connection to .* it is shut\) within"):
        script.robot.meet()


def test_it_is_told_how_the_clocks_differ(script) -> None:
    assert script.robot.gauges() == {"robot_clock_ahead_s": 0.0, "report_delay_ms": 0.0}
    assert script.robot.about() == {
        "robot_software": "5.3.0",
        "robot_clock_ahead_s": "0.000000",
        "report_delay_ms": "0.000000",
    }


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"robot": "sawyer"}, "ros is '', expected HOST:PORT"),
        ({"robot": "sawyer", "ros": "sawyer.local"}, "ros is 'sawyer.local', expected HOST:PORT"),
        ({"robot": "sawyer", "ros": "sawyer:http"}, "expected HOST:PORT"),
        ({"robot": "sim", "ros": "sawyer:9090"}, "ros is sawyer:9090 and robot sim"),
        (
            {"robot": "sawyer", "ros": "sawyer:9090", "clock": "lockstep"},
            "clock is lockstep and robot sawyer, expected wall",
        ),
        (
            {"robot": "sawyer", "ros": "sawyer:9090", "insecure": True},
            "robot is sawyer and there are no certificates, expected --certs",
        ),
        ({"ros_latency_s": 1.0}, r"ros_latency_s is 1\.0, expected 0\.0 to 0\.1"),
    ],
)
def test_settings_that_contradict_each_other_are_refused(settings, words, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=words):
        BridgeConfig(recordings=str(tmp_path), **settings)


LOAD = SetPayload(mass_kg=0.6, com_m=np.array([0.01, 0.02, 0.1]))


def test_a_payload_is_a_fragment_that_hangs_on_the_hand() -> None:
    msg = urdf_configuration(LOAD, 1_500_000_000)
    assert (msg["time"], msg["link"]) == ({"secs": 1, "nsecs": 500_000_000}, "right_hand")
    robot, name = ElementTree.fromstring(msg["urdf"]), msg["joint"]
    ends = [robot.find(f"joint[@type='fixed']/{end}").get("link") for end in ("parent", "child")]
    assert ends == ["right_hand", name]
    inertial = robot.find(f"link[@name='{name}']/inertial")
    assert float(inertial.find("mass").get("value")) == 0.6
    # Of the hand, which is turned by a quarter about the link's axis and stands in front of it.
    place = [float(word) for word in inertial.find("origin").get("xyz").split()]
    np.testing.assert_allclose(place, [0.02, -0.01, 0.0755], atol=1e-7)


def payloads(script: Script) -> list[dict[str, Any]]:
    published = [op for op in script.told if op["op"] == "publish"]
    return [op["msg"] for op in published if op["topic"] == "/robot/urdf"]


def test_a_payload_is_told_again_and_again_as_the_same_configuration(script) -> None:
    script.robot.begin((), 0)
    script.run(0.1)
    assert payloads(script) == []
    assert script.robot.carry(LOAD)
    for _ in range(25):
        script.robot.begin((), 0)
        script.run(0.1)
    told = payloads(script)
    assert len(told) == 3
    assert told[0]["time"] == told[-1]["time"]
    assert script.robot.carry(LOAD)
    script.robot.begin((), 0)
    script.run(0.01)
    assert payloads(script)[-1]["time"] != told[0]["time"]
