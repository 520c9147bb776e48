"""A policy, the bridge and the simulated robot with an object, in one process."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partialmethod
from io import StringIO
from pathlib import Path
from typing import cast

import mujoco
import numpy as np
import pytest
from rich.console import Console

from gfm.cli import main
from gfm.core import (
    BadInputError,
    Command,
    CommandKind,
    ConfigError,
    ManualClock,
    Observation,
    Reason,
    RefusedError,
)
from gfm.core.checks import Array, Array32
from gfm.envs.matching import Matching
from gfm.envs.matching_task import POSE_MATCHING, POSITION_MATCHING, MatchingTask
from gfm.envs.matching_view import MatchingView
from gfm.experiments.attempt_files import Kept
from gfm.experiments.attempt_start import ABOVE_M, AsideError, AttemptStart
from gfm.experiments.attempt_view import RobotView
from gfm.experiments.attempts import Attempt, AttemptRunner, planned
from gfm.experiments.drive_policy import attempts_made, drive_policy
from gfm.experiments.drive_request import DriveRequest
from gfm.experiments.driver import Driver, KeptError
from gfm.experiments.evaluate import EvaluationRequest, load_arm, policy_for
from gfm.experiments.payload import carrying
from gfm.experiments.person import Person
from gfm.launch import RunAddress, free_endpoint
from gfm.policies import shipped_policy
from gfm.recording import read_recording
from gfm.recording.weights_file import read_weights
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.sim.sawyer_numbers import BASKET_XYZ, JOINTS
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.__main__ import build as build_bridge
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.guard import Guard, Loss
from gfm_robot_bridge.simulated.__main__ import build as build_robot
from gfm_robot_bridge.simulated.cell import Cell, cell_model
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_robot_bridge.simulated.tracker import Tracker
from gfm_robot_bridge.simulated_sawyer import SimulatedSawyer
from gfm_wire import RobotClock, ScaleSpeed, SetPayload, StopRobot, decode

POSITION = POSITION_MATCHING.name
#: Twice as long as the shipped policy needs.
SHORT = replace(POSITION_MATCHING, steps=90)
VIEW = RobotView(load_arm(EvaluationRequest(task=POSITION)))


def hidden_payload(mass_kg: float) -> HiddenEffect:
    amounts = {"mass": mass_kg, "com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    return HiddenEffect(effect="payload", joints=(), parameters=amounts)


class Rig:
    """A driver, a bridge and a robot that live in this process."""

    def __init__(
        self,
        folder: Path,
        task: str = "position",
        clock: str = "lockstep",
        control_hz: float = 20.0,
        engine: str = "mujoco",
        payload_kg: float = 0.0,
    ) -> None:
        self.time = ManualClock()
        self.robot_answers = True
        self.hub = MemoryHub()
        self.bridge = build_bridge(
            BridgeConfig(
                name="bridge",
                recordings=str(folder),
                control_hz=control_hz,
                clock=RobotClock(clock),
                task=task,
            ),
            MemoryTransport(self.hub, name="bridge", clock=self.time),
            self.time,
        )
        self._robot = build_robot(
            SimulatedConfig(
                name="robot",
                task=task,
                seed=4,
                clock=RobotClock(clock),
                engine=engine,
                hidden=(hidden_payload(payload_kg),) if payload_kg else (),
            ),
            MemoryTransport(self.hub, name="robot", clock=self.time),
            self.time,
        )
        self.driver = Driver(MemoryTransport(self.hub, clock=self.time), self.time, self._idle)
        self.driver.begin(JOINT_NAMES, 1.0)

    def _idle(self) -> None:
        self.time.advance_s(5e-4)
        self.bridge.step()
        if self.robot_answers:
            self._robot.step()


def told(rig: Rig) -> list[Command]:
    """Returns the list in which the commands are that the driver sends from now on."""
    commands: list[Command] = []

    def note(key: str, body: bytes) -> bytes:
        if key == "robot/command" and isinstance(message := decode(body), Command):
            commands.append(message)
        return body

    rig.hub.tamper = note
    return commands


class Typing:
    """Somebody at the keyboard, who types a key the n-th time that one is asked for."""

    def __init__(self, keys: Mapping[int, str], *, is_there: bool = True) -> None:
        self.heard: list[str] = []
        self.asked = 0
        self._keys = keys
        self.person = Person(key=self._key, say=self.heard.append, is_there=is_there)

    def _key(self) -> str:
        self.asked += 1
        return self._keys.get(self.asked, "")


def connected(folder: Path, task: str = "position") -> Driver:
    return Rig(folder, task).driver


def standing(seen: Array32) -> Array32:
    return np.zeros((len(seen), 7), np.float32)


def attempts(
    driver: Driver,
    policy: Callable[[Array32], Array32] | None = None,
    person: Person | None = None,
    task: MatchingTask = POSITION_MATCHING,
) -> AttemptRunner:
    arm = load_arm(EvaluationRequest(task=POSITION))
    if policy is None:
        path = shipped_policy(POSITION)
        spec = Matching(POSITION_MATCHING, arm, 1).spec
        policy = policy_for(path, read_weights(path), spec).mean_action
    return AttemptRunner(task, arm, policy, driver, seed=0, person=person)


def start(driver: Driver, person: Person | None = None) -> AttemptStart:
    return AttemptStart(POSITION_MATCHING, VIEW, driver, person or Person())


def test_the_shipped_policy_pushes_the_object_to_its_goal_on_the_robot(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    commands = told(rig)
    made = attempts(rig.driver).make(0, 0, "first")
    assert made is not None
    assert made.outcome == "reached"
    assert {one.speed_share for one in commands if one.needs_object} == {0.05}
    assert {one.speed_share for one in commands if not one.needs_object} == {0.05, 0.35}
    assert made.place_m < POSITION_MATCHING.tolerance_m
    recording = read_recording(Path(made.recording))
    assert recording.object_track is not None
    began, ended = recording.object_track.position[[0, -1], :2]
    goal = POSITION_MATCHING.radial_goals()[0, :2]
    assert np.linalg.norm(began - goal) > 0.06
    assert np.linalg.norm(ended - goal) < POSITION_MATCHING.tolerance_m + 0.005
    track = np.diff(recording.object_track.stamp_ns)
    assert np.median(track) == pytest.approx(33_333_333, abs=2)
    limits = np.array([joint.velocity for joint in JOINTS])
    assert np.abs(recording.command / limits).max() == pytest.approx(0.05)


def test_the_policy_does_so_where_another_engine_moves_the_robot(tmp_path: Path) -> None:
    pytest.importorskip("pydrake", reason="needs the extra `drake`")
    made = attempts(Rig(tmp_path, engine="drake").driver).make(0, 0, "first")
    assert made is not None
    assert made.outcome == "reached"


def test_the_bridge_keeps_the_tool_out_of_the_basket(tmp_path: Path) -> None:
    rig, model = Rig(tmp_path), cell_model(Cell.POSITION)
    data, plate = mujoco.MjData(model), model.geom("plate").id
    basket = [model.geom(f"basket_{name}").id for name in ("floor", "wall_1", "wall_3")]
    aside, down = 0.2 * np.eye(7)[0], 0.1 * np.eye(7)[1]  # past the object, then on
    lowest, reasons = 1.0, Reason.NONE
    for speed in [aside] * 30 + [down] * 60:
        rig.driver.command(CommandKind.VELOCITY, JOINT_NAMES, speed, speed_share=1.0)
        reasons |= Reason(rig.driver.newest.reason)
        data.qpos[:7] = rig.driver.newest.position
        mujoco.mj_kinematics(model, data)
        lowest = min(
            lowest,
            *(mujoco.mj_geomDistance(model, data, plate, part, 1.0, None) for part in basket),
        )
    assert 0.008 < lowest < 0.015
    assert reasons == Reason.COLLISION
    assert rig.bridge.status().counters["collision_limits"] > 0
    assert rig.bridge.status().gauges["geometry_guarded"] == 1.0


def test_a_policy_that_stands_still_reaches_nothing(tmp_path: Path) -> None:
    made = attempts(connected(tmp_path), standing, task=SHORT).make(3, 0, "still")
    assert made is not None
    assert made.outcome == "out_of_time"
    assert made.steps == SHORT.steps
    assert made.place_m == pytest.approx(POSITION_MATCHING.goal_radius_m, abs=0.012)


def test_a_damaged_policy_ends_an_attempt_and_its_recording_is_whole(tmp_path: Path) -> None:
    broken = attempts(connected(tmp_path), lambda seen: np.full((len(seen), 7), np.nan, np.float32))
    with pytest.raises(BadInputError, match="not finite"):
        broken.make(0, 0, "broken")
    assert [path.name for path in tmp_path.iterdir()] == ["broken.mcap"]


def test_a_robot_without_an_object_is_refused_before_it_moves(tmp_path: Path) -> None:
    driver = connected(tmp_path, "none")
    before = driver.newest.position
    with pytest.raises(BadInputError, match="reports no object, expected one that is tracked"):
        attempts(driver).begin()
    np.testing.assert_allclose(driver.newest.position, before, atol=1e-3)


def test_a_bridge_of_another_rate_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="control rate is not 20 Hz"):
        attempts(Rig(tmp_path, control_hz=50.0).driver).begin()


@pytest.mark.parametrize("clock", ["lockstep", "wall"])
def test_the_robot_can_be_driven_on_either_clock(tmp_path: Path, clock: str) -> None:
    made = attempts(Rig(tmp_path, clock=RobotClock(clock)).driver)
    made.begin()
    assert (attempt := made.make(2, 0, "either")) is not None
    assert attempt.outcome == "reached"


def test_an_attempt_that_is_paused_begins_anew(tmp_path: Path) -> None:
    rig, typing = Rig(tmp_path), Typing({100: " ", 120: " "})
    made = attempts(rig.driver, person=typing.person)
    assert made.make(0, 0, "paused") is None
    assert abs(rig.driver.newest.velocity).max() < 0.02
    assert typing.asked == 100
    before_ns = rig.driver.newest.stamp_ns, rig.time.now_ns()
    assert made.resumes()
    assert typing.asked == 120
    assert rig.driver.newest.stamp_ns - before_ns[0] == 20 * 50_000_000
    assert rig.time.now_ns() - before_ns[1] >= 20 * 50_000_000  # not faster than a person
    assert (attempt := made.make(0, 0, "anew")) is not None
    assert attempt.outcome == "reached"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["anew.mcap", "paused.mcap"]


@pytest.mark.parametrize("when", [1, 40, 100])
def test_q_ends_an_attempt_wherever_it_is(tmp_path: Path, when: int) -> None:
    rig, typing = Rig(tmp_path), Typing({when: "q"})
    made = attempts(rig.driver, person=typing.person)
    assert made.make(0, 0, "ended") is None
    assert not made.resumes()
    assert typing.asked == when
    assert abs(rig.driver.newest.velocity).max() < 0.02


def by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the bridge's robot leave it to a person to put the object back."""
    monkeypatch.setattr(SimulatedSawyer, "place_object", lambda _robot, _pose: False)


def test_a_person_puts_the_object_back_and_confirms(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_hand(monkeypatch)
    rig = Rig(tmp_path)
    began = Typing({})
    assert start(rig.driver, began.person).lead_above_basket(READY)
    typing = Typing({began.asked + 10: "\n"})
    assert attempts(rig.driver, person=typing.person).make(0, 0, "by_hand") is not None
    assert typing.heard == [
        "put the object at the basket's centre, unturned, then press Enter (q ends)"
    ]


def test_an_object_that_is_elsewhere_is_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(tmp_path)
    rig.driver.place_object(np.array([0.65, 0.05, 0.08, 1.0, 0.0, 0.0, 0.0]))
    by_hand(monkeypatch)
    typing = Typing({90: "\n", 100: "q"})
    assert attempts(rig.driver, standing, typing.person).make(0, 0, "elsewhere") is None
    assert len(typing.heard) == 2
    assert re.match(r"the object is seen 7\.\d cm and \d degrees from its place", typing.heard[1])
    assert not list(tmp_path.iterdir())


def test_without_a_person_nobody_puts_the_object_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_hand(monkeypatch)
    with pytest.raises(BadInputError, match="a person has to do that, expected a terminal"):
        attempts(connected(tmp_path), standing).make(0, 0, "nobody")


def puts_aside(monkeypatch: pytest.MonkeyPatch, times: int) -> list[Array]:
    """Lets the robot put the object 5 cm aside so often; returns the list of where it was to be."""
    asked: list[Array] = []
    puts = SimulatedSawyer.place_object

    def place(robot: SimulatedSawyer, pose: Array) -> bool:
        asked.append(pose)
        return puts(robot, pose + 0.05 * np.eye(7)[1] if len(asked) <= times else pose)

    monkeypatch.setattr(SimulatedSawyer, "place_object", place)
    return asked


def test_an_object_that_lies_aside_is_put_back_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = puts_aside(monkeypatch, 2)
    assert attempts(connected(tmp_path)).make(0, 0, "third") is not None
    assert len(asked) == 3


def test_an_object_that_never_lies_in_its_place_is_said_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    puts_aside(monkeypatch, 99)
    with pytest.raises(AsideError, match=r"put back 3 times and is seen 4\.\d cm and \d degrees"):
        attempts(connected(tmp_path)).make(0, 0, "aside")
    assert not list(tmp_path.iterdir())


class Aside:
    """Makes attempts; the object lies aside before those whose numbers are given."""

    def __init__(self, *numbers: int) -> None:
        self._numbers, self._asked = numbers, 0

    def make(self, goal: int, trial: int, recording: str) -> Attempt:
        self._asked += 1
        if self._asked in self._numbers:
            raise AsideError("the object lies aside")
        return replace(attempt(goal, trial), recording=recording)


def made(runner: Aside, count: int) -> tuple[list[int], str]:
    """Returns the goals of what is made, in order, and what is said."""
    console = Console(file=StringIO(), width=200)
    left = deque((goal, 0) for goal in range(count))
    names = attempts_made(cast("AttemptRunner", runner), left, lambda goal, _: str(goal), console)
    goals = [one.goal for one in names]
    assert not left
    return goals, cast("StringIO", console.file).getvalue()


def test_an_attempt_that_cannot_begin_is_put_off_to_the_end() -> None:
    goals, said = made(Aside(2, 3, 6), 4)
    assert goals == [0, 3, 1, 2]
    assert said.splitlines() == [
        f"goal {goal}: put off: the object lies aside" for goal in (2, 3, 3)
    ]


def test_three_that_cannot_begin_one_after_the_other_end_it() -> None:
    with pytest.raises(AsideError, match="lies aside"):
        made(Aside(2, 3, 4), 4)


def test_a_robot_that_stops_answering_ends_an_attempt(tmp_path: Path) -> None:
    rig = Rig(tmp_path)

    def falls_silent(seen: Array32) -> Array32:
        rig.robot_answers = False
        return standing(seen)

    with pytest.raises(RefusedError, match="robot: no answer from sawyer/exchange within 10"):
        attempts(rig.driver, falls_silent).make(0, 0, "silent")
    assert [path.name for path in tmp_path.iterdir()] == ["silent.mcap"]


def test_an_arm_that_the_bridge_stops_has_failed_and_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def loss(_guard: Guard, _seen: object) -> Loss | None:
        return Loss(words=said.pop(), again=False) if said else None

    monkeypatch.setattr(Guard, "loss", loss)

    def comes_too_near(seen: Array32) -> Array32:
        said.append("plate and basket_floor are 4 mm apart")
        return standing(seen)

    runner = attempts(connected(tmp_path), comes_too_near)
    for trial in (0, 1):
        made = runner.make(0, trial, f"stopped_{trial}")
        assert made is not None
        assert (made.outcome, made.steps) == ("protective_stop", 2)  # the next is refused
        assert Path(made.recording).is_file()


@pytest.mark.parametrize("stops", [2, 3])
def test_a_stop_on_the_way_to_an_attempt_is_gone_on_after_but_not_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stops: int
) -> None:
    runner = attempts(connected(tmp_path))
    left = ["link and plate are 4 mm apart"] * stops

    def loss(_guard: Guard, seen: Observation) -> Loss | None:
        is_under_way = abs(seen.velocity).max() > 0.05
        return Loss(words=left.pop(), again=False) if left and is_under_way else None

    monkeypatch.setattr(Guard, "loss", loss)
    if stops == 3:
        with pytest.raises(RefusedError, match="protective stop: link and plate are 4 mm apart"):
            runner.make(0, 0, "never")
        assert not list(tmp_path.glob("*.mcap"))
    else:
        made = runner.make(0, 0, "at_last")
        assert made is not None
        assert made.outcome == "reached"
    assert not left


def test_a_way_that_the_bridge_slows_down_is_gone_to_its_end(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    person = MemoryTransport(rig.hub, name="person", clock=rig.time)
    person.request("robot/speed", ScaleSpeed(scale=0.2), timeout_s=1.0)
    raised = VIEW.raised(READY, ABOVE_M)
    assert rig.driver.go_to(JOINT_NAMES, raised, 0.05)
    np.testing.assert_allclose(rig.driver.newest.position, raised, atol=2e-3)


def test_a_way_on_which_somebody_stops_the_arm_lasts_until_it_may_go_on(tmp_path: Path) -> None:
    rig, typing = Rig(tmp_path), Typing({300: "q"})
    person = MemoryTransport(rig.hub, name="person", clock=rig.time)
    person.request("robot/speed", ScaleSpeed(scale=0.0), timeout_s=1.0)
    raised = VIEW.raised(READY, ABOVE_M)
    assert not rig.driver.go_to(JOINT_NAMES, raised, 0.05, typing.person.interrupts)
    assert typing.asked == 300


def test_a_way_that_the_bridge_does_not_let_the_arm_go_is_an_error(tmp_path: Path) -> None:
    driver = connected(tmp_path)
    driver.place_object(np.array([0.6, 0.12, 0.08, 1.0, 0.0, 0.0, 0.0]))  # aside
    beneath = READY + 0.3 * np.eye(7)[1]
    words = r"keeps the arm 0\.1\d rad from where it is led \(.*collision\)"
    with pytest.raises(KeptError, match=words):
        driver.go_to(JOINT_NAMES, beneath, 0.05)


def test_an_attempt_does_not_begin_where_the_arm_is_kept_elsewhere(tmp_path: Path) -> None:
    driver = connected(tmp_path)
    driver.place_object(np.array([0.6, 0.12, 0.08, 1.0, 0.0, 0.0, 0.0]))  # aside
    with pytest.raises(KeptError):
        start(driver).reach(READY + 0.3 * np.eye(7)[1], np.zeros(7))


def tool_height(driver: Driver) -> float:
    return float(VIEW.tool(driver.newest.position)[2] - BASKET_XYZ[2])


def test_a_low_tool_is_lifted_before_the_way_back_and_a_high_one_stays(tmp_path: Path) -> None:
    driver = connected(tmp_path)
    driver.place_object(np.array([0.6, 0.12, 0.08, 1.0, 0.0, 0.0, 0.0]))  # aside
    low = READY + np.array([0.0, 0.08, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert driver.go_to(JOINT_NAMES, low, 0.05)
    heights = []
    for _ in range(2):
        assert start(driver).lift()
        heights.append(tool_height(driver))
    assert heights[0] >= 0.1
    assert abs(heights[1] - heights[0]) < 0.01  # what its servo lags behind


def test_the_way_to_an_attempt_comes_from_above(tmp_path: Path) -> None:
    driver = connected(tmp_path)
    assert driver.go_to(JOINT_NAMES, VIEW.raised(READY, ABOVE_M), 0.05)
    raised = tool_height(driver)
    assert driver.go_to(JOINT_NAMES, READY, 0.05)
    assert raised - tool_height(driver) == pytest.approx(0.1, abs=2e-3)


def test_an_arm_with_a_load_that_nobody_knows_gives_way_once_and_is_held(tmp_path: Path) -> None:
    driver = Rig(tmp_path, payload_kg=2.0).driver
    raised = VIEW.raised(READY, ABOVE_M)
    assert driver.go_to(JOINT_NAMES, raised, 0.05)
    held = tool_height(driver)
    for _ in range(3):  # one session after the other, and a way that leads nowhere
        driver.begin(JOINT_NAMES, 1.0)
        driver.rest(JOINT_NAMES, 0.05)
        assert driver.held is not None
        assert driver.go_to(JOINT_NAMES, driver.held, 0.05)
    assert tool_height(driver) == pytest.approx(held, abs=1e-3)
    sags = raised[1] - driver.newest.position[1]
    assert -0.02 < sags < -0.005  # rad: a joint of 800 N m/rad, and 10 N m


@pytest.mark.parametrize("clock", ["lockstep", "wall"])
def test_under_a_load_that_nobody_knows_attempts_fail_and_the_next_begin(
    tmp_path: Path, clock: str
) -> None:
    rig = Rig(tmp_path, clock=clock, payload_kg=1.5)
    runner = attempts(rig.driver, task=SHORT)
    made = [runner.make(goal, 0, f"loaded_{goal}") for goal in range(2)]
    assert all(one is not None and one.outcome != "reached" for one in made)
    status = rig.bridge.status()
    assert status.counters["load_limits"] > 0
    assert status.counters["lost_clearances"] == 0
    assert status.gauges["waits_for_reset"] == 0.0


def test_an_arm_that_somebody_stops_has_not_failed(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    person = MemoryTransport(rig.hub, name="person", clock=rig.time)

    def is_stopped(seen: Array32) -> Array32:
        person.request("robot/stop", StopRobot(reason="enough"), timeout_s=1.0)
        return standing(seen)

    with pytest.raises(RefusedError, match="enough"):
        attempts(rig.driver, is_stopped).make(0, 0, "stopped")


def test_an_object_that_is_lost_ends_an_attempt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = Rig(tmp_path)

    def goes_blind(seen: Array32) -> Array32:
        monkeypatch.setattr(Tracker, "look", lambda tracker, _pose: skipped(tracker))
        return standing(seen)

    def skipped(tracker: Tracker) -> None:
        tracker.next_ns += 33_333_333

    with pytest.raises(
        RefusedError, match=r"object: its pose is 5\d\d ms old, expected at most 500 ms"
    ):
        attempts(rig.driver, goes_blind).make(0, 0, "blind")


def test_what_is_seen_of_a_robot_is_what_is_seen_of_the_simulation() -> None:
    """The same states give the same observation, whoever reports them."""
    arm = load_arm(EvaluationRequest(task=POSE_MATCHING.name))
    env = Matching(POSE_MATCHING, arm, 3, seed=1)
    seen = env.reset()
    view = MatchingView(POSE_MATCHING, arm.velocity_limit, 3)
    layout = arm.model.layout
    view.begin(np.arange(3), env.qpos[:, layout.qpos], np.zeros((3, 7)), env.scene())
    np.testing.assert_array_equal(view.observation(env.scene(), env.goal), seen)
    for _ in range(12):
        seen = env.step(np.full((3, 7), 0.3, np.float32)).observation
        view.see(env.qpos[:, layout.qpos], env._arm.qvel[:, layout.dof], env.scene())
    np.testing.assert_array_equal(view.observation(env.scene(), env.goal), seen)


def attempt(goal: int, trial: int, outcome: str = "reached") -> Attempt:
    path = [[0.6, 0.0], [0.61 + 0.01 * goal, 0.0]][: 1 + goal]
    return Attempt(
        goal=goal,
        trial=trial,
        outcome=outcome,
        steps=len(path) - 1,
        place_m=0.01,
        turn_rad=0.0,
        path=path,
    )


def test_what_was_done_is_not_done_again(tmp_path: Path) -> None:
    about: dict[str, object] = {"seed": 3}
    kept = Kept(tmp_path, about)
    kept.add(attempt(0, 0))
    kept.add(attempt(1, 0))
    again = Kept(tmp_path, about)
    assert again.attempts == kept.attempts
    left = [one for one in planned(2, 2) if one not in again.done]
    assert left == [(0, 1), (1, 1)]
    assert [path.name for path in tmp_path.iterdir()] == ["result.json"]


def test_attempts_are_told_as_those_of_the_simulation(tmp_path: Path) -> None:
    kept = Kept(tmp_path, {})
    for one in (attempt(4, 0), attempt(2, 1, "out_of_time"), attempt(2, 0)):
        kept.add(one)
    told = kept.together(POSITION)
    np.testing.assert_array_equal(told.goals, POSITION_MATCHING.radial_goals()[[2, 4]])
    assert told.goal.tolist() == [0, 0, 1]
    assert told.reached.tolist() == [True, False, True]
    np.testing.assert_allclose(told.path[2], [[0.6, 0.0], [0.65, 0.0]])


def test_attempts_under_other_settings_are_refused(tmp_path: Path) -> None:
    Kept(tmp_path, {"seed": 3, "task": POSITION}).add(attempt(0, 0))
    with pytest.raises(BadInputError, match=r"seed 3, asked for 4"):
        Kept(tmp_path, {"seed": 4, "task": POSITION})
    (tmp_path / "result.json").write_text(json.dumps([1]))
    with pytest.raises(BadInputError, match="no result of gfm drive"):
        Kept(tmp_path, {"seed": 4})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"goals": 11}, "--goals is"),
        ({"trials": 0}, "--trials is"),
        ({"connect": "tcp/127.0.0.1:1", "robot": "drake"}, "--robot and --connect"),
        ({"connect": "tcp/127.0.0.1:1", "real_time": True}, "--real-time and --connect"),
        (
            {"connect": "tcp/127.0.0.1:1", "hidden_effect": "random"},
            "--hidden-effect and --connect",
        ),
        (
            {"connect": "tcp/127.0.0.1:1", "robot_config": Path("r.toml")},
            "--robot-config and --con",
        ),
    ],
)
def test_settings_out_of_range_are_refused(tmp_path: Path, changed: dict, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        DriveRequest(task=POSITION, out=tmp_path, **changed)


def test_a_policy_of_another_task_is_refused_before_anything_starts(tmp_path: Path) -> None:
    request = DriveRequest(
        task=POSITION, out=tmp_path / "out", policy=shipped_policy(POSE_MATCHING.name)
    )
    with pytest.raises(BadInputError, match="position_matching"):
        drive_policy(request)
    assert not (tmp_path / "out").exists()


def test_what_the_robot_cannot_hide_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = tmp_path / "robot.toml"
    config.write_text('[[hidden]]\neffect = "gremlins"\nparameters = {}\n')
    words = ["drive", "--task", "position", "--robot-config", str(config)]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.strip()
    assert re.match("error: robot: .*unknown hidden effect 'gremlins'", line)
    assert "\n" not in line
    assert [path.name for path in tmp_path.iterdir()] == ["robot.toml"]


def recorded(rig: Rig, name: str) -> Mapping[str, str]:
    """Returns the metadata of a recording in which nothing is done."""
    with rig.driver.recording(name, {}) as told:
        for _ in range(4):
            rig.driver.rest(JOINT_NAMES, 0.05)
    return read_recording(told[0].path).metadata


def test_what_the_robot_carries_is_told_while_it_is_driven_and_stands_in_recordings(
    tmp_path: Path,
) -> None:
    rig = Rig(tmp_path)
    with carrying(rig.driver, SetPayload(mass_kg=0.6, com_m=np.array([0.0, 0.0, 0.1]))):
        assert recorded(rig, "told")["payload_told"] == "0.6 kg at 0, 0, 0.1 m"
    rig.driver.begin(JOINT_NAMES, 1.0)
    assert "payload_told" not in recorded(rig, "after")


def test_a_payload_that_no_arm_carries_is_one_line_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["drive", "--task", "position", "--payload", "9", "0", "0", "0.1"]
    assert main([*words, "--out", str(tmp_path / "out")]) == 2
    line = capsys.readouterr().err.strip()
    assert line == "error: --payload: payload has a mass of 9 kg, expected 0 to 4 kg"
    assert list(tmp_path.iterdir()) == []


def test_a_robot_that_is_not_there_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    impatient = partialmethod(RunAddress.open, timeout_s=0.5)
    monkeypatch.setattr(RunAddress, "open", impatient)
    endpoint = free_endpoint()
    words = ["drive", "--task", "position", "--connect", endpoint, "--out", str(tmp_path / "out")]
    assert main(words) == 1
    assert capsys.readouterr().err.startswith(f"error: no answer from a router at {endpoint}")
    assert not (tmp_path / "out").exists()


def test_robot_and_bridge_as_processes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    request = DriveRequest(task=POSITION, out=tmp_path, goals=1, trials=1)
    assert [one.goal for one in drive_policy(request).attempts] == [0]
    said = " ".join(capsys.readouterr().out.split())
    assert re.search(r"1 of 1: goal 1: goal reached and held .* cm away \(left: 0:00\)", said)
    assert (
        "1 of 1 attempts succeeded, 100% (95 % interval 21% to 100%), on a simulated robot" in said
    )
    document = json.loads((tmp_path / "report.json").read_text())
    assert document["success"]["reached"] == 1
    assert document["provenance"]["clock"] == "lockstep"
    assert "on a simulated robot" in (tmp_path / "report.html").read_text()
    assert (tmp_path / "sealed.json").exists()
    assert drive_policy(request).attempts == Kept(tmp_path, {}).attempts  # nothing is left to do


def test_an_interrupted_drive_keeps_what_there_is_and_goes_on(tmp_path: Path) -> None:
    words = ["drive", "--task", "position", "--goals", "2", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "gfm.cli", *words]
    with subprocess.Popen(
        [*command, "--trials", "50"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        deadline_s = time.monotonic() + 60.0
        while not (tmp_path / "result.json").exists():
            assert time.monotonic() < deadline_s
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        said, error = process.communicate(timeout=60.0)
    assert process.returncode == 130
    assert error.endswith("interrupted\n")
    kept = Kept(tmp_path, {}).attempts
    assert f"of {len(kept)} attempts succeeded" in said
    assert all("stopped" in log.read_text() for log in (tmp_path / "logs").glob("*.log"))
    again = subprocess.run(
        [*command, "--trials", str(kept[-1].trial + 1)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env=os.environ | {"COLUMNS": "100"},
    )
    assert again.returncode == 0
    whole = Kept(tmp_path, {}).attempts
    assert whole[: len(kept)] == kept
    assert len(whole) == 2 * (kept[-1].trial + 1)
    assert len({one.recording for one in whole}) == len(whole)
    assert all(Path(one.recording).exists() for one in whole)
