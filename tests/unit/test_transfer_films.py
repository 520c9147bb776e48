"""Which attempts a film shows, and where arm and object are in it."""

import numpy as np
import pytest

from gfm.api.films.renderer import NoFilmError
from gfm.core import CommandKind, ObjectTrack, Trajectory
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, arm_problem
from gfm.experiments.attempts import Attempt
from gfm.experiments.transfer_films import pair_to_show, positions
from gfm.sim.sawyer import JOINT_NAMES, READY

SECOND_NS = 1_000_000_000


def attempt(goal: int, outcome: str, trial: int = 0) -> Attempt:
    return Attempt(
        goal=goal, trial=trial, outcome=outcome, steps=20, place_m=0.0, turn_rad=0.0, path=[]
    )


def test_the_first_target_that_only_the_later_policy_reached_is_shown() -> None:
    before = [attempt(0, "reached"), attempt(1, "out_of_time"), attempt(2, "out_of_time")]
    after = [attempt(2, "reached"), attempt(1, "reached"), attempt(0, "reached")]
    assert [one.goal for one in pair_to_show(before, after)] == [1, 1]


def test_where_nothing_was_gained_the_first_start_of_both_is_shown() -> None:
    before = [attempt(0, "reached"), attempt(1, "reached")]
    shown = pair_to_show(before, [attempt(1, "out_of_time")])
    assert [one.outcome for one in shown] == ["reached", "out_of_time"]


def recorded(track: ObjectTrack | None) -> Trajectory:
    """An arm whose joints all move at 1 rad/s for a second."""
    stamp_ns = np.arange(0, SECOND_NS + 1, SECOND_NS // 100)
    moved = READY + 1e-9 * stamp_ns[:, None]
    return Trajectory(
        name="attempt",
        joint_names=JOINT_NAMES,
        stamp_ns=stamp_ns + 5 * SECOND_NS,
        position=moved,
        velocity=None,
        effort=None,
        command_kind=CommandKind.VELOCITY,
        command_stamp_ns=stamp_ns + 5 * SECOND_NS,
        command=np.zeros_like(moved),
        object_track=track,
    )


def test_the_object_is_where_it_was_last_seen() -> None:
    arm = arm_problem("position_matching", EnvironmentSettings(), EnvironmentAssets())
    places = np.array([[0.6, 0.0, 0.1], [0.7, 0.0, 0.1]])
    track = ObjectTrack(
        stamp_ns=np.array([5 * SECOND_NS, 5 * SECOND_NS + 480_000_000]),
        position=places,
        quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)),
    )
    shown = positions(recorded(track), arm, steps=400)
    assert len(shown) == 21  # no longer than it was recorded
    layout = arm.model.layout
    np.testing.assert_allclose(shown[10][layout.qpos], READY + 0.5)
    assert shown[9][layout.object_qpos][0] == pytest.approx(0.6)
    assert shown[10][layout.object_qpos][0] == pytest.approx(0.7)
    with pytest.raises(NoFilmError, match="no poses"):
        positions(recorded(None), arm, steps=400)
