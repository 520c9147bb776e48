"""The simulated robot: its clock, its latency, its sensors, its secrets."""

from __future__ import annotations

import json
import stat
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import (
    BadInputError,
    Command,
    CommandKind,
    ConfigError,
    ManualClock,
    Observation,
    RefusedError,
    UnknownNameError,
)
from gfm.service import read_config
from gfm.sim.sawyer import JOINT_NAMES, READY, sawyer_spec
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.simulated.__main__ import build
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import UNITS, GivenEffect, draw, given, names, unit
from gfm_robot_bridge.simulated.robot import (
    COMMAND_LATENCY_NS,
    COMMAND_TIMEOUT_NS,
    Sensors,
    SimulatedRobot,
)
from gfm_robot_bridge.simulated.sealed import seal
from gfm_robot_bridge.simulated_sawyer import COMMAND_LATENCY_NS as DOCUMENTED_LATENCY_NS
from gfm_wire import Message, RobotClock, RobotExchange, RobotStates

MS = 1_000_000
QUIET = Sensors(position_noise=0.0, velocity_noise=0.0, effort_noise=0.0, encoder_step=1e-12)


def command(values: np.ndarray, stamp_ns: int, kind: str = "position") -> Command:
    return Command(
        kind=CommandKind(kind), joint_names=JOINT_NAMES, values=values, stamp_ns=stamp_ns
    )


def wave(time_s: float) -> np.ndarray:
    return READY + 0.1 * np.sin(2 * np.pi * 0.5 * time_s) * np.ones(7)


def driven(robot: SimulatedRobot, seconds: float = 1.0) -> list[Observation]:
    reports: list[Observation] = []
    for step in range(round(seconds / 0.02)):
        sent = command(wave(step * 0.02), robot.time_ns)
        reports += robot.advance(sent, 20 * MS)
    return reports


def positions(reports: list[Observation]) -> np.ndarray:
    return np.array([report.position for report in reports])


def test_without_a_hidden_effect_there_is_no_gap_to_the_nominal_model() -> None:
    reports = driven(SimulatedRobot(READY, sensors=QUIET), seconds=2.0)
    model = sawyer_spec(command=CommandKind.POSITION).compile()
    data = mujoco.MjData(model)
    data.qpos[:] = data.ctrl[:] = READY
    for report in reports:
        while data.time < report.stamp_ns * 1e-9 - 1e-9:
            since = data.time - COMMAND_LATENCY_NS * 1e-9
            if since >= -1e-9:
                data.ctrl[:] = wave(np.floor(since / 0.02 + 1e-6) * 0.02)
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(report.position, data.qpos, atol=2e-5)
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(report.effort, data.qfrc_actuator, atol=0.05)


def test_the_same_seed_gives_the_same_reports_and_another_seed_another_noise() -> None:
    first, again, other = (positions(driven(SimulatedRobot(READY, seed=s), 0.2)) for s in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert 1e-5 < np.abs(first - other).std() < 1e-3


def test_how_an_exchange_is_cut_does_not_matter() -> None:
    whole, cut = SimulatedRobot(READY, sensors=QUIET), SimulatedRobot(READY, sensors=QUIET)
    step = READY + 0.05
    one = whole.advance(command(step, 0), 60 * MS)
    parts = list(cut.advance(command(step, 0), 20 * MS))
    parts += [*cut.advance(None, 20 * MS), *cut.advance(None, 20 * MS)]
    np.testing.assert_array_equal(positions(list(one)), positions(parts))


def first_motion_ns(robot: SimulatedRobot, stamp_ns: int) -> int:
    for report in robot.advance(command(READY + 0.1, stamp_ns), 100 * MS):
        if np.abs(report.position - READY).max() > 1e-9:
            return report.stamp_ns
    raise AssertionError("it never moved")


@pytest.mark.parametrize("stamp_ms", [0, 3, 10])
def test_commands_act_exactly_their_latency_after_their_stamp(stamp_ms: int) -> None:
    assert COMMAND_LATENCY_NS == DOCUMENTED_LATENCY_NS
    sensors = replace(QUIET, period_ns=MS)
    acts_ns = stamp_ms * MS + COMMAND_LATENCY_NS
    seen_ns = first_motion_ns(SimulatedRobot(READY, sensors=sensors), stamp_ms * MS)
    assert seen_ns == acts_ns + MS


def test_a_hidden_delay_comes_on_top() -> None:
    (delay,) = draw("command_delay", 3, READY)
    sensors = replace(QUIET, period_ns=MS)
    robot = SimulatedRobot(READY, effects=(delay,), sensors=sensors)
    late_ns = first_motion_ns(robot, 0) - COMMAND_LATENCY_NS
    assert late_ns == pytest.approx(delay.parameters["delay"] * 1e9, abs=1.01 * MS)


def test_sensors_are_as_noisy_as_they_say() -> None:
    robot = SimulatedRobot(READY)
    reports = robot.advance(None, 5000 * MS)
    assert len(reports) == 501
    position = positions(list(reports)) - READY
    assert position.std() == pytest.approx(1e-4, rel=0.1)
    assert np.array([r.velocity for r in reports]).std() == pytest.approx(2e-3, rel=0.1)
    assert np.array([r.effort for r in reports]).std(axis=0) == pytest.approx(0.05, rel=0.2)
    ticks = positions(list(reports)) / 2e-5
    np.testing.assert_allclose(ticks, np.rint(ticks), atol=1e-6)


def test_without_commands_the_robot_leaves_velocity_mode_and_holds() -> None:
    robot = SimulatedRobot(READY, sensors=QUIET)
    robot.advance(command(np.full(7, 0.2), 0, "velocity"), COMMAND_TIMEOUT_NS)
    assert abs(robot.latest.velocity).min() > 0.1
    rest = robot.advance(None, 1500 * MS)[-1]
    assert abs(rest.velocity).max() < 2e-3


@pytest.mark.parametrize("kind", ["velocity", "effort"])
def test_left_alone_it_slows_down_within_its_limits(kind: str) -> None:
    robot = SimulatedRobot(READY, sensors=replace(QUIET, period_ns=MS))
    values = np.array([0.8, -0.6, 0.9, -0.9, 1.5, 1.5, 2.0])
    values = values if kind == "velocity" else np.array([5.0, -4.0, 3.0, -3.0, 4.0, 4.0, 6.0])
    robot.advance(command(values, 0, kind), COMMAND_TIMEOUT_NS + 5 * MS)
    speeds = np.array([report.velocity for report in robot.advance(None, 600 * MS)])
    slowing = np.diff(np.abs(speeds), axis=0) / 1e-3
    limits = np.array([10.0, 8.0, 10.0, 10.0, 12.0, 12.0, 12.0])
    assert np.abs(speeds[0]).max() > 0.8
    assert (slowing >= -limits).all()
    assert np.abs(speeds[-1]).max() < 2e-3


def test_left_alone_with_a_load_it_does_not_sink() -> None:
    (load,) = given((hidden("payload", mass=2.0, com_x=0.0, com_y=0.0, com_z=0.1),))
    robot = SimulatedRobot(READY, effects=(load,), sensors=QUIET)
    robot.advance(command(np.zeros(7), 0, "velocity"), COMMAND_TIMEOUT_NS)
    assert np.abs(robot.latest.velocity).max() > 0.1
    robot.advance(None, 1000 * MS)
    assert np.abs(robot.latest.velocity).max() < 2e-3


# What is hidden


@pytest.mark.parametrize("name", names())
def test_draws_are_decided_by_the_seed(name: str) -> None:
    one, again, other = (draw(name, seed, READY) for seed in (5, 5, 6))
    assert one == again != other
    assert one[0].effect == name
    for effect in one:
        assert set(effect.parameters) <= set(UNITS)
        assert all(unit(effect.effect, parameter) for parameter in effect.parameters)
        assert all(0 <= joint < 7 for joint in effect.joints)


def test_random_draws_every_effect_and_joint() -> None:
    drawn = [draw("random", seed, READY)[0] for seed in range(400)]
    assert {effect.effect for effect in drawn} == set(names())
    assert {joint for effect in drawn for joint in effect.joints} == set(range(7))
    chosen = draw("random", 7, READY)
    assert chosen == draw(chosen[0].effect, 7, READY)


def test_none_hides_nothing_and_unknown_names_are_refused() -> None:
    assert draw("none", 1, READY) == ()
    with pytest.raises(UnknownNameError, match=r"unknown hidden effect 'magic'; available: .*coul"):
        draw("magic", 1, READY)
    with pytest.raises(UnknownNameError, match="unknown hidden effect 'magic'"):
        SimulatedConfig(hidden_effect="magic")


def test_the_sealed_file_tells_all_to_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "run" / "sealed.json"
    effects = draw("stribeck_friction", 3, READY)
    seal(path, effects, choice="random", seed=3)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    document = json.loads(path.read_text())
    assert (document["choice"], document["seed"]) == ("random", 3)
    assert [e["effect"] for e in document["effects"]] == ["stribeck_friction", "coulomb_friction"]
    first = document["effects"][0]
    assert first["joints"] == [JOINT_NAMES[effects[0].joints[0]]]
    assert first["parameters"]["stribeck_velocity"]["unit"] == "rad/s"
    assert [p.name for p in path.parent.iterdir()] == ["sealed.json"]


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match="sealed file cannot be written"):
        seal(tmp_path / "file" / "sealed.json", (), choice="none", seed=0)


def hidden(effect: str, *joints: str, **parameters: float) -> GivenEffect:
    return GivenEffect(effect=effect, joints=joints, parameters=parameters)


def test_effects_can_be_hidden_in_given_amounts(tmp_path: Path) -> None:
    config = tmp_path / "robot.toml"
    config.write_text(
        """
        task = "position"
        [[hidden]]
        effect = "payload"
        parameters = { mass = 1, com_x = 0.0, com_y = 0.01, com_z = 0.1 }
        [[hidden]]
        effect = "coupled_friction"
        joints = ["right_j2", "right_j3"]
        parameters = { viscous = 4.0 }
        [[hidden]]
        effect = "object_friction"
        parameters = { coefficient = 0.2 }
        """
    )
    sealed = str(tmp_path / "sealed.json")
    settings = read_config(SimulatedConfig, config, {"name": "robot", "sealed": sealed})
    clock = ManualClock()
    build(settings, MemoryTransport(MemoryHub(), clock=clock), clock)
    document = json.loads(Path(sealed).read_text())
    assert document["choice"] == "payload+coupled_friction+object_friction"
    told = [(one["effect"], one["joints"]) for one in document["effects"]]
    assert told == [
        ("payload", ["right_j6"]),
        ("coupled_friction", ["right_j2", "right_j3"]),
        ("object_friction", []),
    ]
    assert document["effects"][0]["parameters"]["mass"] == {"value": 1.0, "unit": "kg"}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"hidden": (hidden("magic", torque=1.0),)}, "unknown hidden effect 'magic'"),
        ({"hidden": (hidden("torque_offset", "elbow", torque=1.0),)}, "unknown joint 'elbow'"),
        ({"hidden": (hidden("torque_offset", torque=1.0),)}, "on joints none, expected 1 of right"),
        (
            {"hidden": (hidden("coupled_friction", "right_j1", viscous=1.0),)},
            "on joints right_j1, expected 2 of",
        ),
        (
            {"hidden": (hidden("torque_offset", "right_j1", force=1.0),)},
            "torque_offset has force, expected torque",
        ),
        (
            {"hidden": (hidden("torque_offset", "right_j1", torque=np.nan),)},
            "torque nan, expected a finite number",
        ),
        ({"hidden": (hidden("object_mass", mass=0.1),)}, "task none, expected task position or"),
        (
            {"hidden_effect": "payload", "hidden": (hidden("gravity_direction"),)},
            "hidden_effect is payload and hidden has 1 effects, expected one of them",
        ),
    ],
)
def test_what_cannot_be_hidden_is_refused(settings: dict[str, object], words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        SimulatedConfig(**settings)


# As a service


def answer(config: SimulatedConfig, clock: ManualClock, *messages: Message) -> list[Message]:
    hub = MemoryHub()
    service = build(config, MemoryTransport(hub, clock=clock), clock)
    asker = MemoryTransport(hub, clock=clock)
    answers = []
    for message in messages:
        pending = asker.request("sawyer/exchange", message, timeout_s=1.0)
        service.step()
        reply = pending.poll()
        assert reply is not None
        answers.append(reply)
        clock.advance_s(0.02)
    return answers


def exchange(
    advance_ms: int, sent: Command | None = None, clock: RobotClock = RobotClock.LOCKSTEP
) -> RobotExchange:
    commands = () if sent is None else (sent,)
    return RobotExchange(commands=commands, advance_ns=advance_ms * MS, clock=clock)


def test_in_lockstep_time_passes_only_in_exchanges() -> None:
    config = SimulatedConfig(name="robot", clock=RobotClock.LOCKSTEP)
    first, second, third = answer(config, ManualClock(), exchange(0), exchange(20), exchange(10))
    assert isinstance(first, RobotStates)
    assert isinstance(second, RobotStates)
    assert isinstance(third, RobotStates)
    assert [r.stamp_ns for r in first.states] == [0]
    assert [r.stamp_ns for r in second.states] == [10 * MS, 20 * MS]
    assert [r.stamp_ns for r in third.states] == [30 * MS]


def test_an_exchange_of_no_time_repeats_the_latest_report() -> None:
    config = SimulatedConfig(name="robot", clock=RobotClock.LOCKSTEP)
    first, again = answer(config, ManualClock(), exchange(0), exchange(0))
    assert isinstance(first, RobotStates)
    assert isinstance(again, RobotStates)
    assert [r.stamp_ns for r in first.states] == [r.stamp_ns for r in again.states] == [0]


def test_on_the_wall_clock_time_passes_by_itself() -> None:
    config = SimulatedConfig(name="robot")
    asked = [exchange(ms, clock=RobotClock.WALL) for ms in (0, 500, 0)]
    first, second, third = answer(config, ManualClock(), *asked)
    assert isinstance(first, RobotStates)
    assert isinstance(second, RobotStates)
    assert isinstance(third, RobotStates)
    assert [r.stamp_ns for r in second.states] == [10 * MS, 20 * MS]
    assert [r.stamp_ns for r in third.states] == [30 * MS, 40 * MS]


def test_a_robot_that_was_held_up_catches_up_a_little_at_a_time() -> None:
    clock = ManualClock()
    config = SimulatedConfig(name="robot")
    robot = build(config, MemoryTransport(MemoryHub(), clock=clock), clock)
    clock.advance_s(0.05)
    times = []
    for _ in range(4):
        worked = robot.step()
        times.append((worked, robot.status().gauges["robot_time_s"]))
    assert times == [(True, 0.02), (True, 0.04), (False, 0.05), (False, 0.05)]


def test_a_robot_that_cannot_keep_up_with_the_wall_clock_says_so() -> None:
    clock = ManualClock()
    config = SimulatedConfig(name="robot")
    robot = build(config, MemoryTransport(MemoryHub(), clock=clock), clock)
    clock.advance_s(2.5)
    with pytest.raises(ConfigError, match=r"robot is 2\.5 s behind it: .* expected lockstep"):
        robot.step()


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (
            exchange(20, clock=RobotClock.WALL),
            "the bridge is on the wall clock and this robot on the lockstep clock, expected both",
        ),
        (exchange(20_000), "advance_ns is 20000000000"),
        (
            exchange(
                20,
                Command(
                    kind=CommandKind.EFFORT, joint_names=("j",), values=np.zeros(1), stamp_ns=0
                ),
            ),
            "command names j, expected right_j0",
        ),
    ],
)
def test_what_cannot_be_done_is_refused(message: RobotExchange, words: str) -> None:
    with pytest.raises(RefusedError, match=words):
        answer(SimulatedConfig(name="robot", clock=RobotClock.LOCKSTEP), ManualClock(), message)


def test_the_robot_answers_one_bridge() -> None:
    hub, clock = MemoryHub(), ManualClock()
    robot = build(
        SimulatedConfig(name="robot", clock=RobotClock.LOCKSTEP),
        MemoryTransport(hub, clock=clock),
        clock,
    )
    bridge, past_it = (MemoryTransport(hub, name=name, clock=clock) for name in ("bridge", "me"))

    def asked(transport: MemoryTransport) -> Message | None:
        pending = transport.request("sawyer/exchange", exchange(20), timeout_s=1.0)
        robot.step()
        return pending.poll()

    assert isinstance(asked(bridge), RobotStates)
    with pytest.raises(RefusedError, match=r"this robot is held by bridge, heard 0\.0 s ago"):
        asked(past_it)
    clock.advance_s(5.1)
    assert isinstance(asked(past_it), RobotStates)


def test_the_process_seals_before_it_answers(tmp_path: Path) -> None:
    path = tmp_path / "sealed.json"
    config = SimulatedConfig(
        name="robot", hidden_effect="coulomb_friction", seed=2, sealed=str(path)
    )
    build(config, MemoryTransport(MemoryHub()), ManualClock())
    assert json.loads(path.read_text())["effects"][0]["effect"] == "coulomb_friction"
