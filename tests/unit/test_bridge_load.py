"""The load observer: what it knows of a load, and what the bridge does because of it."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typing_extensions import override

from gfm.core import Command, CommandKind, ManualClock, Observation, Reason, RefusedError
from gfm.core.checks import Array
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.limiter import Limiter
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.load import Balance, Loaded, LoadObserver
from gfm_robot_bridge.mirror import UnitMasses
from gfm_robot_bridge.plan import Plan
from gfm_robot_bridge.sawyer_guard import sawyer_guard
from gfm_robot_bridge.sawyer_limits import sawyer_limits
from gfm_robot_bridge.sawyer_load import SawyerBalance, sawyer_load
from gfm_robot_bridge.service import BridgeService
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import GivenEffect, given
from gfm_robot_bridge.simulated.robot import Sensors, SimulatedRobot
from gfm_robot_bridge.simulated.service import SimulatedService
from gfm_robot_bridge.simulated_sawyer import SimulatedSawyer
from gfm_wire import Message, RobotClock, SetPayload

PERIOD_S = 0.02
EXACT = Sensors(position_noise=0.0, velocity_noise=0.0, effort_noise=0.0, encoder_step=1e-9)
CONFIG = BridgeConfig(name="bridge")


def payload(mass: float) -> GivenEffect:
    where = {"com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    return GivenEffect(effect="payload", parameters={"mass": mass} | where)


def friction(joint: str, torque: float) -> GivenEffect:
    return GivenEffect(effect="coulomb_friction", joints=(joint,), parameters={"torque": torque})


# The observer alone, on joints of 1 kg m^2


class OneKilogram(Balance):
    """Joints of 1 kg m^2 that weigh nothing."""

    @override
    def needed(self, position: Array, velocity: Array, acceleration: Array) -> Array:
        return acceleration

    @override
    def carry(self, payload: SetPayload) -> None:
        del payload


def report(time_s: float, velocity: float, effort: float) -> Observation:
    return Observation(
        joint_names=("a",),
        position=np.zeros(1),
        velocity=np.array([velocity]),
        effort=np.array([effort]),
        stamp_ns=round(time_s * 1e9),
    )


def test_at_rest_a_load_is_known_by_the_first_report() -> None:
    observer = LoadObserver(OneKilogram(), servo_gain=50.0, unnoticed_nm=0.5)
    assert observer.load is None
    observer.take([report(0.0, 0.0, 2.0)])
    assert observer.load is not None
    assert observer.load.torque.tolist() == [-2.0]
    assert observer.load.sinking.tolist() == [-0.04]


def test_a_motion_that_its_drive_explains_is_no_load() -> None:
    observer = LoadObserver(OneKilogram(), servo_gain=50.0, unnoticed_nm=0.5)
    observer.take([report(0.0, 0.0, 3.0)])
    assert observer.load is not None  # at first it cannot know that the joint is being driven
    observer.take([report(0.01 * k, 0.03 * k, 3.0) for k in range(1, 200)])
    assert observer.load is None
    assert observer.torque == pytest.approx(0.0, abs=1e-6)


def test_a_load_that_is_put_down_is_known_by_its_low_pass() -> None:
    observer = LoadObserver(OneKilogram(), servo_gain=50.0, unnoticed_nm=0.5)
    observer.take([report(0.0, 0.0, 0.0)])
    observer.take([report(0.01 * k, -0.04 * k, 0.0) for k in range(1, 11)])
    assert observer.torque == pytest.approx(-4.0 * (1.0 - np.exp(-1.0)))


def test_the_spacing_of_reports_does_not_matter() -> None:
    ends = []
    for count in (10, 50):
        observer, spacing_s = LoadObserver(OneKilogram(), 50.0, 0.5), 0.5 / count
        observer.take([report(spacing_s * k, -4.0 * spacing_s * k, 0.0) for k in range(count + 1)])
        ends.append(observer.torque[0])
    assert ends[0] == pytest.approx(ends[1])


def test_reports_that_come_twice_or_late_are_left_out() -> None:
    observer = LoadObserver(OneKilogram(), 50.0, 0.5)
    observer.take([report(0.02, 0.0, 0.0), report(0.02, 9.0, 9.0), report(0.01, 9.0, 9.0)])
    assert observer.load is None


def test_after_a_gap_it_begins_anew() -> None:
    observer = LoadObserver(OneKilogram(), 50.0, 0.5)
    observer.take([report(0.0, 0.0, 0.0), report(10.0, 0.0, 3.0)])
    assert observer.torque.tolist() == [-3.0]


def test_a_loaded_arm_needs_less_torque_where_its_load_drives() -> None:
    loaded, zero = Loaded(UnitMasses(), np.array([2.0])), np.zeros(1)
    assert loaded.accelerations(zero, zero, np.array([1.0])).tolist() == [3.0]
    assert loaded.torques(zero, zero, np.array([3.0])).tolist() == [1.0]


@pytest.mark.parametrize(("torque", "velocity", "heavy"), [
    (30.0, 0.0, True),  # more than a servo of 50 N m s/rad holds at half of 1 rad/s
    (20.0, 0.0, False),
    (30.0, 0.5, True),
    (30.0, -0.5, False),  # it may be friction
])  # fmt: skip
def test_a_load_is_too_heavy_where_a_servo_gives_way_too_fast(
    torque: float, velocity: float, heavy: bool
) -> None:
    limits = sawyer_limits()
    bounds = replace(
        CONFIG.bounds(limits, 0.2), velocity=np.array([0.5]), still=np.array([0.01]),
        effort=np.array([80.0]),
    )  # fmt: skip
    observer = LoadObserver(OneKilogram(), 50.0, 0.5)
    observer.take([report(0.0, velocity, -torque)])
    assert observer.too_heavy(bounds) is heavy
    assert f"a bears {torque:.1f} N m" in observer.words(bounds)
    assert f"sinks at {torque / 50:.2f} rad/s" in observer.words(bounds)
    assert "up to 25.0 N m" in observer.words(bounds)


# What is told to a loaded joint

ONE = CONFIG.bounds(
    Limits(
        lower=np.array([-3.0]),
        upper=np.array([3.0]),
        velocity=np.array([2.0]),
        acceleration=np.array([10.0]),
        effort=np.array([80.0]),
    ),
    0.2,
)


class Joint:
    """A limiter, and a joint at which a load of -10 N m pulls: by -0.2 rad/s in velocity mode."""

    def __init__(self, pull: float = 10.0, guard: Guard | None = None) -> None:
        observer = LoadObserver(OneKilogram(), servo_gain=50.0, unnoticed_nm=0.5)
        observer.take([report(0.0, 0.0, pull)])
        self.limiter = Limiter(ONE, UnitMasses(), PERIOD_S, guard, observer)
        self.position, self.velocity = np.zeros(1), np.zeros(1)

    @property
    def seen(self) -> Observation:
        return replace(report(0.0, 0.0, 10.0), position=self.position, velocity=self.velocity)

    def send(self, kind: CommandKind, value: float) -> Plan:
        """Commands, and lets the joint do what it is told."""
        command = Command(kind=kind, joint_names=("a",), values=np.array([value]), stamp_ns=0)
        plan = self.limiter.limited(command, self.seen)
        self.follow(plan)
        return plan

    def follow(self, plan: Plan) -> None:
        if plan.kind is CommandKind.POSITION:
            self.velocity = (plan.values[-1] - self.position) / PERIOD_S
            self.position = plan.values[-1]
        else:
            self.velocity = plan.values[-1] - 0.2
            self.position = self.position + PERIOD_S * self.velocity


def test_speeds_leave_room_for_what_a_load_adds_and_more_where_it_grows() -> None:
    down, up = Joint(), Joint()
    for _ in range(50):
        reason = down.send(CommandKind.VELOCITY, -2.0).reason
        up.send(CommandKind.VELOCITY, 2.0)
    assert Reason.LOAD | Reason.VELOCITY in reason
    assert down.velocity == pytest.approx(-ONE.velocity + 0.1)
    assert up.velocity == pytest.approx(ONE.velocity - 0.2)


def test_speeds_begin_where_the_servo_bears_the_load() -> None:
    joint = Joint()
    first = joint.send(CommandKind.VELOCITY, 1.0).values
    assert first[0] == pytest.approx(0.2 + ONE.acceleration * 0.004)
    assert joint.velocity >= 0.0


def test_positions_of_a_loaded_arm_come_to_rest_as_positions() -> None:
    joint = Joint()
    for _ in range(20):
        joint.send(CommandKind.POSITION, 2.0)
    before, periods = joint.velocity, 0
    assert before > 0.3
    while (plan := joint.limiter.stopped(joint.seen)) is not None:
        joint.follow(plan)
        assert plan.kind is CommandKind.POSITION
        assert (before - joint.velocity <= ONE.acceleration * PERIOD_S + 1e-9).all()
        before, periods = joint.velocity, periods + 1
    assert joint.velocity == pytest.approx(0.0)
    assert periods > 3


@pytest.mark.parametrize("sinks", [True, False])
def test_the_stop_that_is_made_is_the_one_that_was_looked_at(
    monkeypatch: pytest.MonkeyPatch, sinks: bool
) -> None:
    def reason(_guard: Guard, _plan: Plan, _load: object, slowing: Array | None) -> Reason:
        return Reason.LOAD | Reason.COLLISION if sinks and slowing is None else Reason.NONE

    monkeypatch.setattr(Guard, "__init__", lambda _guard: None)
    monkeypatch.setattr(Guard, "look", lambda _guard, _seen: None)
    monkeypatch.setattr(Guard, "reason", reason)
    joint = Joint(2.0, Guard())  # type: ignore[call-arg]
    for _ in range(20):
        assert not joint.send(CommandKind.POSITION, 2.0).reason & Reason.COLLISION
    plan = joint.limiter.stopped(joint.seen)
    assert plan is not None
    assert plan.kind is (CommandKind.POSITION if sinks else CommandKind.VELOCITY)


def test_a_loaded_arm_that_is_held_up_is_let_go_of() -> None:
    joint = Joint()
    for _ in range(20):
        joint.send(CommandKind.POSITION, 2.0)
    joint.position = joint.position - 0.5
    plan = joint.limiter.stopped(joint.seen)
    assert plan is not None
    assert plan.kind is CommandKind.VELOCITY


# The arm's model


def test_the_arm_s_model_explains_a_nominal_arm_in_motion() -> None:
    robot, observer = SimulatedRobot(READY, sensors=EXACT), sawyer_load(CONFIG)
    worst = 0.0
    for k in range(60):
        speed = 0.4 * sawyer_limits().velocity * np.sin(0.1 * k + np.arange(7))
        sent = Command(
            kind=CommandKind.VELOCITY, joint_names=JOINT_NAMES, values=speed,
            stamp_ns=robot.time_ns,
        )  # fmt: skip
        observer.take(robot.advance(sent, 20_000_000))
        worst = max(worst, float(np.abs(observer.torque).max()))
    assert worst < 0.5


@pytest.mark.parametrize("mass", [0.5, 2.0])
def test_a_payload_is_what_it_weighs(mass: float) -> None:
    robot = SimulatedRobot(READY, effects=given((payload(mass),)), sensors=EXACT)
    observer = sawyer_load(CONFIG)
    observer.take(robot.advance(None, 1_500_000_000))
    told = SawyerBalance("none")
    zero = np.zeros(7)
    bare = told.needed(robot.latest.position, zero, zero)
    told.carry(SetPayload(mass_kg=mass, com_m=np.array([0.0, 0.0, 0.1])))
    weight = told.needed(robot.latest.position, zero, zero) - bare
    np.testing.assert_allclose(observer.torque, -weight, atol=0.02)
    assert np.abs(weight).max() > 4.0 * mass


def test_what_the_robot_was_told_that_it_carries_is_no_load() -> None:
    told = SetPayload(mass_kg=1.0, com_m=np.array([0.0, 0.0, 0.1]))
    robot, observer = SimulatedRobot(READY, effects=given((payload(1.0),))), sawyer_load(CONFIG)
    observer.take(robot.advance(None, 100_000_000))
    assert observer.load is not None
    robot.carry(told)
    observer.carry(told)
    observer.take(robot.advance(None, 2_000_000_000))
    assert observer.load is None


# The bridge


class Served:
    """A bridge, a simulated Sawyer in lockstep, and a driver."""

    def __init__(
        self, folder: Path, *effects: GivenEffect, observed: bool = True, at: Array = READY
    ) -> None:
        hub, self.clock = MemoryHub(), ManualClock()
        config = BridgeConfig(
            name="bridge", recordings=str(folder), clock=RobotClock.LOCKSTEP, task="position"
        )
        transport = MemoryTransport(hub, name="bridge", clock=self.clock)
        self.observer = sawyer_load(BridgeConfig(name="bridge"))
        sawyer = SimulatedSawyer(transport, self.clock, robot_clock=RobotClock.LOCKSTEP)
        self.bridge = BridgeService(
            config, sawyer, transport, self.clock, guard=sawyer_guard(config, sawyer),
            observer=self.observer if observed else None,
        )  # fmt: skip
        self.robot = SimulatedService(
            SimulatedConfig(name="robot", clock=RobotClock.LOCKSTEP),
            SimulatedRobot(at, effects=given(effects)),
            MemoryTransport(hub, name="robot", clock=self.clock),
            self.clock,
        )
        self._asker, self._number = MemoryTransport(hub, name="asker", clock=self.clock), 0

    def ask(self, key: str, message: Message) -> Message:
        pending = self._asker.request(key, message, timeout_s=5.0)
        while (answer := pending.poll()) is None:
            self.clock.advance_s(1e-3)
            while self.robot.step() or self.bridge.step():
                pass
        return answer

    def command(self, kind: CommandKind, values: Array) -> Observation:
        command = Command(
            kind=kind, joint_names=JOINT_NAMES, values=values,
            stamp_ns=self.clock.utc_ns(), number=self._number,
        )  # fmt: skip
        self._number += 1
        answer = self.ask("robot/command", command)
        assert isinstance(answer, Observation)
        return answer


def stood(served: Served, periods: int) -> Reason:
    """Commands speeds of 0 until the bridge stops the arm; returns why it changed any."""
    reasons = Reason.NONE
    with suppress(RefusedError):
        for _ in range(periods):
            reasons |= Reason(served.command(CommandKind.VELOCITY, np.zeros(7)).reason)
    return reasons


def test_a_loaded_arm_does_not_sink_into_the_basket(tmp_path: Path) -> None:
    served = Served(tmp_path, payload(2.0))
    assert Reason.LOAD | Reason.COLLISION in stood(served, 150)
    status = served.bridge.status()
    assert status.counters["lost_clearances"] == 0
    assert "limited by a load: right_j1 bears" in status.note
    assert status.gauges["unknown_load_nm"] > 5.0


def test_a_loaded_arm_that_is_held_above_the_basket_is_led_up(tmp_path: Path) -> None:
    served = Served(tmp_path, payload(3.0))
    stood(served, 60)
    held = served.command(CommandKind.POSITION, READY)
    up = held.position - 0.3 * np.eye(7)[1]
    for _ in range(100):
        seen = served.command(CommandKind.POSITION, up)
    assert seen.position[1] < held.position[1] - 0.2


def test_a_light_load_does_not_keep_an_arm_that_stands_low_from_being_led_up(
    tmp_path: Path,
) -> None:
    """While it is stopped by speeds it would sink by 8 mm: it is stopped as positions."""
    low = READY + 0.115 * np.eye(7)[1]
    served = Served(tmp_path, payload(0.5), at=low)
    for _ in range(10):
        held = served.command(CommandKind.POSITION, low)
    assert 0.5 < np.abs(served.observer.torque).max() < 3.0
    up = held.position - 0.2 * np.eye(7)[1]
    for _ in range(60):
        seen = served.command(CommandKind.POSITION, up)
    assert seen.position[1] < held.position[1] - 0.15


def test_a_bridge_that_observes_no_load_stops_it_when_a_clearance_is_lost(tmp_path: Path) -> None:
    served = Served(tmp_path, payload(2.0), observed=False)
    stood(served, 150)
    assert served.bridge.status().counters["lost_clearances"] == 1


@pytest.mark.parametrize("kind", [CommandKind.VELOCITY, CommandKind.EFFORT])
def test_with_too_heavy_a_load_only_positions_are_taken(tmp_path: Path, kind: CommandKind) -> None:
    served = Served(tmp_path, payload(8.0))
    for _ in range(50):
        held = served.command(CommandKind.POSITION, READY)
    with pytest.raises(RefusedError, match=r"right_j\d bears .* N m of a load that nobody told"):
        served.command(kind, np.zeros(7))
    served.command(CommandKind.POSITION, held.position)


def test_a_load_that_is_told_is_no_longer_refused(tmp_path: Path) -> None:
    served = Served(tmp_path, payload(4.0))
    held = served.command(CommandKind.POSITION, READY)
    served.ask("robot/payload", SetPayload(mass_kg=4.0, com_m=np.array([0.0, 0.0, 0.1])))
    for _ in range(100):
        served.command(CommandKind.POSITION, held.position)
    seen = served.command(CommandKind.VELOCITY, np.zeros(7))
    assert not Reason(seen.reason) & Reason.LOAD
