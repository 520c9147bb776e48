"""A policy, the bridge and the simulated robot with an object, in one process."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gfm.core import BadInputError, ConfigError, ManualClock, RefusedError
from gfm.core.checks import Array32
from gfm.envs.matching import Matching
from gfm.envs.matching_task import POSE_MATCHING, POSITION_MATCHING
from gfm.envs.matching_view import MatchingView
from gfm.experiments.attempts import Attempt, Attempts, planned
from gfm.experiments.drive import Driver
from gfm.experiments.drive_policy import DriveRequest, Kept, drive_policy
from gfm.experiments.evaluate import EvaluationRequest, load_arm, policy_for
from gfm.policies import shipped_policy
from gfm.recording import read_recording
from gfm.recording.weights_file import read_weights
from gfm.sim.sawyer import JOINT_NAMES
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.__main__ import build as build_bridge
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.simulated.__main__ import build as build_robot
from gfm_robot_bridge.simulated.config import SimulatedConfig

POSITION = POSITION_MATCHING.name


def connected(folder: Path, task: str = "position") -> Driver:
    """A driver of a bridge and a robot that live in this process."""
    hub, time = MemoryHub(), ManualClock()
    bridge = build_bridge(
        BridgeConfig(name="bridge", recordings=str(folder), control_hz=20.0),
        MemoryTransport(hub, name="bridge", clock=time),
        time,
    )
    robot = build_robot(
        SimulatedConfig(name="robot", task=task, seed=4),
        MemoryTransport(hub, name="robot", clock=time),
        time,
    )

    def idle() -> None:
        time.advance_s(5e-4)
        bridge.step()
        robot.step()

    driver = Driver(MemoryTransport(hub, clock=time), time, idle)
    driver.begin(JOINT_NAMES, 1.0)
    return driver


def attempts(driver: Driver, policy: Callable[[Array32], Array32] | None = None) -> Attempts:
    arm = load_arm(EvaluationRequest(task=POSITION))
    if policy is None:
        path = shipped_policy(POSITION)
        spec = Matching(POSITION_MATCHING, arm, 1).spec
        policy = policy_for(path, read_weights(path), spec).mean_action
    return Attempts(POSITION_MATCHING, arm, policy, driver, seed=0)


def test_the_shipped_policy_pushes_the_object_to_its_goal_on_the_robot(tmp_path: Path) -> None:
    made = attempts(connected(tmp_path)).make(0, 0, "first")
    assert made.reached
    assert made.place_m < POSITION_MATCHING.tolerance_m
    recording = read_recording(Path(made.recording))
    assert recording.object_track is not None
    began, ended = recording.object_track.position[[0, -1], :2]
    goal = POSITION_MATCHING.radial_goals()[0, :2]
    assert np.linalg.norm(began - goal) > 0.06
    assert np.linalg.norm(ended - goal) < POSITION_MATCHING.tolerance_m + 0.005
    track = np.diff(recording.object_track.stamp_ns)
    assert np.median(track) == pytest.approx(33_333_333, abs=2)


def test_a_policy_that_stands_still_reaches_nothing(tmp_path: Path) -> None:
    standing = attempts(connected(tmp_path), lambda seen: np.zeros((len(seen), 7), np.float32))
    made = standing.make(3, 0, "still")
    assert made.outcome == "out_of_time"
    assert made.steps == POSITION_MATCHING.steps
    assert made.place_m == pytest.approx(POSITION_MATCHING.goal_radius_m, abs=0.012)


def test_a_damaged_policy_ends_an_attempt_and_its_recording_is_whole(tmp_path: Path) -> None:
    broken = attempts(connected(tmp_path), lambda seen: np.full((len(seen), 7), np.nan, np.float32))
    with pytest.raises(BadInputError, match="not finite"):
        broken.make(0, 0, "broken")
    assert [path.name for path in tmp_path.iterdir()] == ["broken.mcap"]


def test_a_robot_without_an_object_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match="no object"):
        attempts(connected(tmp_path, "none")).make(0, 0, "none")


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


def attempt(goal: int, trial: int) -> Attempt:
    return Attempt(
        goal=goal, trial=trial, outcome="reached", steps=9, place_m=0.01, turn_rad=0.0, recording=""
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


def test_attempts_under_other_settings_are_refused(tmp_path: Path) -> None:
    Kept(tmp_path, {"seed": 3, "task": POSITION}).add(attempt(0, 0))
    with pytest.raises(BadInputError, match=r"seed 3, asked for 4"):
        Kept(tmp_path, {"seed": 4, "task": POSITION})
    (tmp_path / "result.json").write_text(json.dumps([1]))
    with pytest.raises(BadInputError, match="no result of gfm drive"):
        Kept(tmp_path, {"seed": 4})


@pytest.mark.parametrize(
    ("changed", "words"), [({"goals": 11}, "goals"), ({"trials": 0}, "trials")]
)
def test_settings_out_of_range_are_refused(tmp_path: Path, changed: dict, words: str) -> None:
    with pytest.raises(ConfigError, match=f"--{words} is"):
        DriveRequest(task=POSITION, out=tmp_path, **changed)


def test_a_policy_of_another_task_is_refused_before_anything_starts(tmp_path: Path) -> None:
    request = DriveRequest(
        task=POSITION, out=tmp_path / "out", policy=shipped_policy(POSE_MATCHING.name)
    )
    with pytest.raises(BadInputError, match="position_matching"):
        drive_policy(request)
    assert not (tmp_path / "out").exists()


def test_robot_and_bridge_as_processes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    request = DriveRequest(task=POSITION, out=tmp_path, goals=1, trials=1)
    assert [one.goal for one in drive_policy(request)] == [0]
    assert "1 of 1: goal 0" in capsys.readouterr().out
    assert (tmp_path / "sealed.json").exists()
    assert drive_policy(request) == Kept(tmp_path, {}).attempts  # nothing is left to do
