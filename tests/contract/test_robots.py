"""One suite for the port of the robots, run over every adapter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import pytest

from gfm.core import Command, CommandKind, GfmError, ManualClock, Observation, RefusedError
from gfm.service import Service
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.intera.sawyer import InteraSawyer, SawyerSettings
from gfm_robot_bridge.mirror import MirrorRobot
from gfm_robot_bridge.object_port import TRACKED, ObjectPort
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.rosbridge_sawyer.config import RosbridgeConfig
from gfm_robot_bridge.rosbridge_sawyer.memory import MemoryDoor, MemoryLink
from gfm_robot_bridge.rosbridge_sawyer.service import RosbridgeService
from gfm_robot_bridge.simulated.__main__ import build as build_simulated
from gfm_robot_bridge.simulated.__main__ import build_robot
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import GivenEffect
from gfm_robot_bridge.simulated_sawyer import SimulatedSawyer
from gfm_wire import ObjectPose, PowerAction, RobotClock, SetPayload, TrackedObject

PERIOD_S = 0.02
COUNT = len(JOINT_NAMES)
SETTINGS = SawyerSettings(software=("5.3.0",), latency_s=0.004, speed_ratio=1.0, wait_s=1.0)


#: On the hand and beside its axis: it pulls at joints that turn about the hand, too.
LOAD = SetPayload(mass_kg=1.0, com_m=np.array([0.06, -0.03, 0.1]))
Hidden = tuple[GivenEffect, ...]


class Running:
    """A robot whose time passes in steps of a millisecond, asked every period.

    Attributes:
        robot: The adapter.
        reports: All that it reported.
        lose: Breaks the connection, or what stands for it.
    """

    def __init__(
        self,
        robot: Robot,
        pass_time: Callable[[float], None],
        lose: Callable[[], None],
    ) -> None:
        self.robot = robot
        self.reports: list[Observation] = []
        self.lose = lose
        self._pass_time = pass_time

    def exchange(self, *commands: Command, advance_s: float = 0.0) -> tuple[Observation, ...]:
        """Returns the reports of one exchange; fails where it takes longer than a second."""
        self.robot.begin(commands, round(advance_s * 1e9))
        for _ in range(1000):
            reports = self.robot.poll()
            if reports is not None:
                self.reports += reports
                return reports
            self._pass_time(1e-3)
        raise AssertionError("it does not answer")

    def run(self, seconds: float, kind: CommandKind | None = None, values: object = 0.0) -> None:
        """Lets time pass; tells it the same every period, or nothing."""
        for _ in range(round(seconds / PERIOD_S)):
            self.exchange(*(() if kind is None else (self.command(kind, values),)))
            self._pass_time(PERIOD_S)
            self.exchange(advance_s=PERIOD_S)

    def command(self, kind: CommandKind, values: object) -> Command:
        return Command(
            kind=kind,
            joint_names=self.robot.joint_names,
            values=np.broadcast_to(np.asarray(values, dtype=float), (COUNT,)).copy(),
            stamp_ns=self.robot.time_ns(),
        )

    @property
    def newest(self) -> Observation:
        return self.reports[-1]

    def speed(self, seconds: float = 0.1) -> np.ndarray:
        """Returns the mean speed over the last reports, rad/s, shape (J,)."""
        return np.mean([r.velocity for r in self.reports[-round(seconds / 0.01) :]], axis=0)


def mirror(_hidden: Hidden = ()) -> Running:
    robot = MirrorRobot(JOINT_NAMES)
    return Running(robot, lambda _seconds: None, lambda: setattr(robot, "lost", True))


def stepped(clock: ManualClock, *services: Service) -> Callable[[float], None]:
    def pass_time(seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            clock.advance_s(1e-3)
            for service in services:
                while service.step():
                    pass

    return pass_time


def simulated(hidden: Hidden = ()) -> Running:
    hub, clock = MemoryHub(), ManualClock(10**18)
    config = SimulatedConfig(name="robot", hidden=hidden)
    service = build_simulated(config, MemoryTransport(hub, clock=clock), clock)
    robot = SimulatedSawyer(
        MemoryTransport(hub, name="bridge", clock=clock),
        clock,
        robot_clock=RobotClock.WALL,
        timeout_s=0.1,
    )
    return Running(robot, stepped(clock, service), lambda: setattr(hub, "tamper", lost))


def lost(_key: str, _body: bytes) -> None:
    return None


def rosbridge(hidden: Hidden = ()) -> Running:
    clock, door = ManualClock(10**18), MemoryDoor()
    config = RosbridgeConfig(name="robot", clock_ahead_s=-5.0, hidden=hidden)
    service = RosbridgeService(config, build_robot(config), door, clock)
    link = MemoryLink(door, clock)
    robot = InteraSawyer(link, clock, SETTINGS)

    def pass_time(seconds: float) -> None:
        for _ in range(round(seconds / 1e-3)):
            clock.advance_s(1e-3)
            link.pass_time()
            while service.step():
                pass

    running = Running(robot, pass_time, lambda: door.close())
    introduced(running, pass_time)
    is_on = robot.power(PowerAction.ENABLE)
    running.run(0.2)
    assert is_on()
    return running


def introduced(running: Running, pass_time: Callable[[float], None]) -> None:
    """Lets a robot introduce itself; until then an exchange fails."""
    for _ in range(100):
        try:
            running.exchange()
        except GfmError:
            pass_time(1e-3)
        else:
            return
    raise AssertionError("it does not introduce itself")


ADAPTERS = {"mirror": mirror, "simulated": simulated, "rosbridge": rosbridge}


@pytest.fixture(params=ADAPTERS)
def running(request) -> Running:
    made = ADAPTERS[request.param]()
    made.run(PERIOD_S)
    return made


@pytest.fixture(params=["simulated", "rosbridge"])
def physical(request) -> Running:
    """Returns one of those whose time passes by itself."""
    made = ADAPTERS[request.param]()
    made.run(PERIOD_S)
    return made


def test_it_says_what_it_is(running) -> None:
    robot = running.robot
    assert robot.joint_names == JOINT_NAMES
    assert robot.patience_s == 0.2
    for limit in vars(robot.limits).values():
        assert limit.shape == (COUNT,)
        assert np.isfinite(limit).all()
    assert (robot.limits.lower < robot.limits.upper).all()


def test_reports_are_whole_and_each_is_later_than_the_last(running) -> None:
    running.run(0.5)
    stamps = [report.stamp_ns for report in running.reports]
    news = [b - a for a, b in pairwise(stamps) if b != a]
    assert len(news) >= 45
    assert set(news) == {10_000_000}
    for report in running.reports:
        assert report.joint_names == JOINT_NAMES
        assert np.isfinite([report.position, report.velocity, report.effort]).all()


def test_it_takes_an_object_s_pose_from_outside_until_that_is_old(running) -> None:
    hub, clock = MemoryHub(), ManualClock(10**9)
    port = ObjectPort(MemoryTransport(hub, clock=clock), clock, RobotClock.WALL, 500_000_000)
    told = ObjectPose(
        position=np.array([0.5, 0.1, 0.2]),
        quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        covariance=np.eye(6),
    )
    message = TrackedObject(stamp_ns=clock.utc_ns() - 30_000_000, pose=told)
    MemoryTransport(hub, name="tracker", clock=clock).request(TRACKED, message, timeout_s=1.0)
    robot_ns = running.robot.time_ns()
    assert port.problem(running.newest) == "object: nobody says where it is"
    assert [seen.stamp_ns for seen in port.hear(robot_ns)] == [robot_ns - 30_000_000]
    report = port.added_to(running.newest)
    assert report.object_position.tolist() == [0.5, 0.1, 0.2]
    assert report.object_stamp_ns == robot_ns - 30_000_000
    assert port.problem(report) == ""
    running.run(0.6)
    assert port.added_to(running.newest).object_position is None
    assert "ms old, expected at most 500 ms" in port.problem(running.newest)


def test_its_clock_goes_with_its_reports(running) -> None:
    before_ns, reported_ns = running.robot.time_ns(), running.newest.stamp_ns
    running.run(0.5)
    passed_ns = running.robot.time_ns() - before_ns
    assert passed_ns >= 500_000_000
    assert passed_ns == pytest.approx(running.newest.stamp_ns - reported_ns, abs=1.2e7)
    assert 0 <= running.robot.time_ns() - running.newest.stamp_ns < 1.2e7


def test_each_joint_goes_at_the_speed_that_it_is_told_by_its_name(running) -> None:
    told = np.linspace(-0.15, 0.15, COUNT)
    running.run(1.0, CommandKind.VELOCITY, told)
    np.testing.assert_allclose(running.speed(), told, atol=0.02)


def test_it_goes_to_a_position(running) -> None:
    target = running.newest.position + 0.02
    running.run(1.5, CommandKind.POSITION, target)
    np.testing.assert_allclose(running.newest.position, target, atol=2e-3)


def test_setpoints_of_the_future_act_when_their_time_comes(physical) -> None:
    now_ns = physical.robot.time_ns()
    ahead = physical.command(CommandKind.VELOCITY, 0.1)
    ahead = Command(
        kind=ahead.kind,
        joint_names=ahead.joint_names,
        values=ahead.values,
        stamp_ns=now_ns + 100_000_000,
    )
    physical.exchange(ahead)
    physical.run(0.1)
    assert np.abs(physical.speed(0.05)).max() < 0.01
    physical.run(0.15)
    np.testing.assert_allclose(physical.speed(0.02), 0.1, atol=0.03)


def test_torques_move_it(physical) -> None:
    torque = np.zeros(COUNT)
    torque[6] = 1.0
    physical.run(0.2, CommandKind.EFFORT, torque)
    speed = physical.speed(0.05)
    assert speed[6] > 0.05
    assert np.abs(speed[:6]).max() < 0.3 * speed[6]


@pytest.mark.parametrize("kind", [CommandKind.VELOCITY, CommandKind.EFFORT])
def test_left_alone_it_comes_to_rest(physical, kind) -> None:
    told = np.zeros(COUNT)
    told[6] = 0.3
    physical.run(0.3, kind, told)
    assert physical.speed(0.05)[6] > 0.05
    physical.run(0.8)
    assert np.abs(physical.speed()).max() < 5e-3


def test_a_healthy_one_has_no_fault(running) -> None:
    running.run(0.1)
    running.robot.fault()
    assert running.robot.fault() == ""


def test_a_lost_one_says_so(running) -> None:
    running.lose()
    with pytest.raises(GfmError, match=r"mirror robot|sawyer/exchange|rosbridge in memory"):
        running.exchange()


def test_what_makes_no_sense_is_not_switched(running) -> None:
    with pytest.raises(RefusedError, match=r"nothing to (switch|reset)"):
        running.robot.power(PowerAction.RESET)


def test_what_it_says_of_itself_are_numbers_and_words(running) -> None:
    robot = running.robot
    numbers: Sequence[float] = [*robot.gauges().values(), *robot.counters().values()]
    assert np.isfinite(numbers).all()
    assert all(isinstance(word, str) for word in robot.about().values())


def loaded(name: str) -> Running:
    """Returns a robot that hides the load, standing still as well as it can."""
    where = dict(zip(("com_x", "com_y", "com_z"), LOAD.com_m.tolist(), strict=True))
    hidden = GivenEffect(effect="payload", parameters={"mass": LOAD.mass_kg, **where})
    made = ADAPTERS[name]((hidden,))
    made.run(0.4, CommandKind.VELOCITY)
    return made


@pytest.mark.parametrize("name", ["simulated", "rosbridge"])
def test_a_robot_that_is_told_of_its_payload_bears_it_until_that_is_taken_back(name) -> None:
    made = loaded(name)
    sinking = made.speed()
    assert np.abs(sinking).max() > 0.02
    pulled = made.newest.effort
    assert "payload_told" not in made.robot.about()
    assert made.robot.carry(LOAD)
    made.run(0.4, CommandKind.VELOCITY)
    assert np.abs(made.speed()).max() < 3e-3
    # The drives give what the servos gave with an error: nothing else was added.
    np.testing.assert_allclose(made.newest.effort, pulled, atol=0.4)
    assert made.robot.about()["payload_told"] == "1 kg at 0.06, -0.03, 0.1 m"
    assert made.robot.carry(SetPayload(mass_kg=0.0, com_m=np.zeros(3)))
    made.run(0.4, CommandKind.VELOCITY)
    np.testing.assert_allclose(made.speed(), sinking, atol=0.01)
    assert "payload_told" not in made.robot.about()


def test_one_that_feels_no_weight_leaves_a_payload_to_a_person() -> None:
    assert not mirror().robot.carry(LOAD)
