"""Driver, bridge and a Sawyer behind a rosbridge in one thread: driven, and stopped."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gfm.core import Command, CommandKind, ManualClock, Observation, Reason, RefusedError
from gfm.recording import read_recording
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport, PendingReply
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.intera.sawyer import InteraSawyer, SawyerSettings
from gfm_robot_bridge.rosbridge_sawyer.config import RosbridgeConfig
from gfm_robot_bridge.rosbridge_sawyer.memory import MemoryDoor, MemoryLink
from gfm_robot_bridge.rosbridge_sawyer.service import RosbridgeService
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated.__main__ import build_robot
from gfm_wire import Message, PowerAction, PowerRobot, RecordDone, RecordStart, RecordStop

COUNT = len(JOINT_NAMES)
SETTINGS = SawyerSettings(software=("5.3.0",), latency_s=0.004, speed_ratio=0.5, wait_s=1.0)
#: rad/s, of a mean over ten reports: sensors are as noisy as a fifth of that.
STILL = 0.01


class Cell:
    """Driver, bridge and robot in one thread."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        self.clock, self.door = ManualClock(10**18), MemoryDoor()
        settled = RosbridgeConfig(name="robot", **settings)
        self.robot = RosbridgeService(settled, build_robot(settled), self.door, self.clock)
        self.link, self.witness = (MemoryLink(self.door, self.clock) for _ in range(2))
        self.witness.open()
        self.witness.say({"op": "subscribe", "topic": "/robot/joint_states"})
        robot = InteraSawyer(self.link, self.clock, SETTINGS)
        config = BridgeConfig(
            name="bridge",
            robot="sawyer",
            ros="memory:1",
            certs="none are asked for in memory",
            control_hz=20.0,
            recordings=str(folder),
        )
        hub = MemoryHub()
        transport = MemoryTransport(hub, name="bridge", clock=self.clock)
        self.bridge = BridgeService(config, robot, transport, self.clock)
        self.driver = MemoryTransport(hub, name="driver", clock=self.clock)
        self.run(1.2)
        self.ask("robot/power", PowerRobot(action=PowerAction.ENABLE))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            self.clock.advance_s(1e-3)
            self.link.pass_time()
            while self.robot.step():
                pass
            while self.bridge.step():
                pass

    def call(self, service: str, **args: Any) -> None:
        """Has somebody else call a service of the robot."""
        self.witness.say({"op": "call_service", "service": service, "args": args})

    def speed(self) -> float:
        """Returns the fastest joint's mean speed over the last ten reports, rad/s."""
        said = [arrived.op for arrived in self.witness.receive() if "msg" in arrived.op]
        return float(np.abs(np.mean([op["msg"]["velocity"] for op in said[-10:]], axis=0)).max())

    def power(self, action: PowerAction) -> None:
        self.ask("robot/power", PowerRobot(action=action))
        self.run(0.1)

    def refusal(self, number: int) -> str:
        with pytest.raises(RefusedError) as refused:
            self.command(0.1, number)
        return str(refused.value)

    def ask(self, key: str, message: Message) -> Message:
        return self.answer(self.driver.request(key, message, timeout_s=5.0))

    def answer(self, pending: PendingReply) -> Message:
        while (answer := pending.poll()) is None:
            self.run(1e-3)
        return answer

    def drive(self, speed: float, seconds: float) -> Observation:
        """Commands a speed at 20 Hz, as a driver that waits for its answer does."""
        number, until_ns = 0, self.clock.now_ns() + round(seconds * 1e9)
        while True:
            answer = self.command(speed, number)
            number += 1
            if self.clock.now_ns() >= until_ns:
                return answer

    def command(self, speed: float, number: int) -> Observation:
        sent = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINT_NAMES,
            values=np.full(COUNT, speed),
            stamp_ns=self.clock.utc_ns(),
            number=number,
        )
        answer = self.ask("robot/command", sent)
        assert isinstance(answer, Observation)
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


@pytest.fixture
def quiet(tmp_path: Path) -> Iterator[Cell]:
    made = Cell(tmp_path)
    yield made
    made.bridge.close()


def test_silence_stops_it_until_its_driver_begins_again(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    assert quiet.speed() > 0.05
    quiet.run(0.6)
    assert quiet.speed() < STILL
    assert "no command for 100 ms, the robot holds; a command with number 0" in quiet.refusal(20)
    assert quiet.command(0.1, 0).applied is not None


def test_the_button_stops_it_and_only_a_person_brings_it_back(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    quiet.call("/simulated/estop_button", data=True)
    quiet.run(0.4)
    assert quiet.speed() < STILL
    assert "e-stop button is pressed" in quiet.refusal(0)
    with pytest.raises(RefusedError, match="release it first"):
        quiet.power(PowerAction.RESET)
    quiet.call("/simulated/estop_button", data=False)
    quiet.run(0.2)
    assert "stopped by its e-stop button" in quiet.refusal(0)
    with pytest.raises(RefusedError, match="not enabled while it is stopped"):
        quiet.power(PowerAction.ENABLE)
    quiet.power(PowerAction.RESET)
    assert "not enabled" in quiet.refusal(0)
    quiet.power(PowerAction.ENABLE)
    assert "a command with number 0 begins again" in quiet.refusal(20)
    np.testing.assert_allclose(quiet.drive(-0.1, 0.5).velocity, -0.1, atol=0.03)


def test_a_fault_of_a_joint_stops_it(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    quiet.call("/simulated/joint_fault")
    quiet.run(0.4)
    assert quiet.speed() < STILL
    assert "stopped for a fault of a joint" in quiet.refusal(0)


def test_a_cut_line_is_told_and_comes_back_to_a_driver_that_begins_again(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    quiet.link.drop("the line is cut")
    assert "robot: no connection to rosbridge in memory: the line is cut" in quiet.refusal(20)
    quiet.run(0.6)
    assert quiet.speed() < STILL
    quiet.run(2.0)
    assert "the line is cut; a command with number 0 begins again" in quiet.refusal(21)
    np.testing.assert_allclose(quiet.drive(-0.1, 0.5).velocity, -0.1, atol=0.03)


def test_its_drives_can_be_cut_as_by_the_button(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    quiet.power(PowerAction.STOP)
    quiet.run(0.4)
    assert quiet.speed() < STILL
    assert "stopped by software" in quiet.refusal(0)


def test_closing_leaves_the_arm_at_rest(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    quiet.bridge.close()
    assert not quiet.link.is_open
    quiet.run(0.5)  # the robot's time stood still while the bridge was closed
    assert quiet.speed() < STILL


def test_a_command_is_answered_with_what_became_of_it(quiet: Cell) -> None:
    quiet.drive(0.1, 0.5)
    quiet.run(1.0)
    assert quiet.bridge.status().counters["watchdog_trips"] == 1
    answer = quiet.drive(0.0, 0.0)
    assert answer.reason == Reason.NONE
    assert answer.applied is not None
    assert answer.applied.kind is CommandKind.VELOCITY
    assert np.abs(answer.velocity).max() < 0.02
