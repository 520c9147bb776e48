"""What cameras and encoders tell: late, now and then, with noise."""

import numpy as np
import pytest

from gfm.envs.control_settings import ControlSettings
from gfm.envs.matching import Matching
from gfm.envs.matching_task import POSITION_MATCHING
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, arm_problem
from gfm.envs.sensing import Sensing, Sensors

COUNT, PERIOD_S = 400, 0.05
EXACT = {"joint_noise_rad": 0.0, "speed_noise_rad_s": 0.0, "place_noise_m": 0.0}
EXACT |= {"turn_noise_rad": 0.0, "lost": 0.0}
EVERY = np.arange(COUNT)
SPEED = np.array([0.02, -0.01, 0.03])


def sensors(**changed):
    sensing = Sensing(**{**EXACT, **changed})
    return Sensors(sensing, COUNT, PERIOD_S, np.random.default_rng(0))


def pose(time_s):
    """Objects that move evenly and turn about z at 0.2 rad/s."""
    half = 0.1 * time_s
    one = [*(SPEED * time_s), np.cos(half), 0.0, 0.0, np.sin(half)]
    return np.tile(one, (COUNT, 1))


def followed(made, periods=40):
    made.begin(EVERY, pose(0.0))
    for period in range(1, periods + 1):
        made.see(pose(period * PERIOD_S))
    return made.object_pose, periods * PERIOD_S


def test_a_pose_is_known_late_and_until_the_next_look():
    known, now_s = followed(sensors(late_s=0.05, look_s=0.04))
    ago_s = now_s - known[:, 0] / SPEED[0]
    assert ago_s.min() == pytest.approx(0.05, abs=0.002)
    assert ago_s.max() == pytest.approx(0.09, abs=0.002)
    for one, seconds in zip(known, ago_s, strict=True):
        np.testing.assert_allclose(one, pose(now_s - seconds)[0], atol=1e-5)


def test_what_is_looked_at_all_the_time_and_told_at_once_is_what_there_is():
    known, now_s = followed(sensors(late_s=0.0, look_s=1e-6))
    np.testing.assert_allclose(known, pose(now_s), atol=1e-6)


def test_noise_is_as_large_as_it_is_said_to_be():
    made = sensors(place_noise_m=2e-3, turn_noise_rad=0.02, joint_noise_rad=0.1, late_s=0.0)
    still = np.zeros((COUNT, 7))
    still[:, 3] = 1.0
    made.begin(EVERY, still)
    known = made.object_pose
    assert known[:, :3].std() == pytest.approx(2e-3, rel=0.1)
    assert (2.0 * known[:, 4:]).std() == pytest.approx(0.02, rel=0.1)
    np.testing.assert_allclose(np.linalg.norm(known[:, 3:], axis=1), 1.0)
    position, speed = made.joints(np.ones((COUNT, 7)), np.ones((COUNT, 7)))
    assert (position - 1.0).std() == pytest.approx(0.1, rel=0.1)
    np.testing.assert_array_equal(speed, 1.0)


def test_what_is_not_found_leaves_the_pose_before():
    made = sensors(lost=0.5, late_s=0.0, look_s=PERIOD_S)
    made.begin(EVERY, pose(0.0))
    made.see(pose(PERIOD_S))
    stayed = made.object_pose[:, 0] == 0.0
    assert stayed.mean() == pytest.approx(0.5, abs=0.1)


def test_a_task_shows_what_is_sensed_and_judges_what_there_is():
    exact, sensed = (
        Matching(POSITION_MATCHING, problem(sensing), 8, seed=3) for sensing in (None, Sensing())
    )
    seen = [made.reset() for made in (exact, sensed)]
    assert 0.0 < np.abs(seen[0] - seen[1]).max() < 0.5
    for made in (exact, sensed):
        told = made.step(np.zeros((8, 7), np.float32))
        assert np.abs(told.reward).max() < 0.5
    assert np.isfinite(told.observation).all()


def problem(sensing):
    settings = EnvironmentSettings(control=ControlSettings(sensing=sensing))
    return arm_problem("position_matching", settings, EnvironmentAssets())
