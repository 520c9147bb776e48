"""Motions keep to their limits and show what a diagnosis needs to see."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.excitation.motion import JointRanges, Motion, Purpose, minimum_jerk
from gfm.excitation.waypoints import motions, multisine, slow_reversals, waypoint_moves

RANGES = JointRanges(
    joint_names=("a", "b", "c"),
    center=np.array([0.3, -1.0, 2.0]),
    half_width=np.array([0.5, 0.3, 0.8]),
    speed=np.array([0.8, 0.6, 1.0]),
    acceleration=np.array([8.0, 6.0, 10.0]),
)


@pytest.fixture(scope="module", params=range(5))
def made(request: pytest.FixtureRequest) -> tuple[Motion, ...]:
    return motions(RANGES, seed=request.param)


def test_stay_within_range_and_speed(made: tuple[Motion, ...]) -> None:
    for motion in made:
        away = np.abs(motion.position - RANGES.center)
        assert (away.max(axis=0) <= RANGES.half_width * (1 + 1e-9)).all(), motion.name
        # The envelope of a motion adds a little to the speed of what it wraps.
        assert (np.abs(motion.velocity).max(axis=0) <= 1.15 * RANGES.speed).all(), motion.name


def test_begin_and_end_at_rest_in_the_centre(made: tuple[Motion, ...]) -> None:
    for motion in made:
        ends = np.concatenate([motion.position[:15], motion.position[-15:]])
        np.testing.assert_allclose(ends - RANGES.center, 0.0, atol=2e-3, err_msg=motion.name)


def test_every_joint_rests_creeps_runs_and_reverses(made: tuple[Motion, ...]) -> None:
    for kind in (CommandKind.POSITION, CommandKind.VELOCITY):
        training = [m for m in made if m.purpose is Purpose.TRAINING and m.kind is kind]
        speed = np.concatenate([motion.velocity for motion in training])
        share = np.abs(speed) / RANGES.speed
        assert ((share < 1e-3).mean(axis=0) > 0.03).all()
        assert (((share > 0.01) & (share < 0.15)).mean(axis=0) > 0.03).all()
        assert ((share > 0.6).mean(axis=0) > 0.02).all()
        signs = np.sign(np.where(share > 0.02, speed, 0.0))
        for joint in range(3):
            moving = signs[signs[:, joint] != 0, joint]
            assert (np.diff(moving) != 0).sum() >= 8


def test_held_out_motions_are_of_another_kind(made: tuple[Motion, ...]) -> None:
    def shapes(purpose: Purpose) -> set[str]:
        return {motion.name.split("_")[-1] for motion in made if motion.purpose is purpose}

    assert not shapes(Purpose.TRAINING) & shapes(Purpose.HELDOUT)
    assert {m.kind for m in made if m.purpose is Purpose.HELDOUT} == {"position", "velocity"}
    assert len({motion.name for motion in made}) == len(made) == 10


def test_the_seed_decides() -> None:
    first, again, other = (motions(RANGES, seed=seed) for seed in (1, 1, 2))
    for a, b, c in zip(first, again, other, strict=True):
        np.testing.assert_array_equal(a.position, b.position)
        assert abs(a.position - c.position).max() > 0.05


@pytest.mark.parametrize("shape", [waypoint_moves, slow_reversals, multisine])
@pytest.mark.parametrize("period_s", [0.01, 0.05])
def test_the_period_only_samples_the_motion(shape: object, period_s: float) -> None:
    assert callable(shape)
    fine = shape(RANGES, np.arange(0.0, 12.0, 0.002), np.random.default_rng(3))
    coarse = shape(RANGES, np.arange(0.0, 12.0, period_s), np.random.default_rng(3))
    step = round(period_s / 0.002)
    assert abs(fine[::step][: len(coarse)] - coarse).max() < 0.06


def test_minimum_jerk_begins_and_ends_at_rest() -> None:
    share = np.linspace(0.0, 1.0, 1001)
    way = minimum_jerk(share)
    assert way[0] == 0.0
    assert way[-1] == 1.0
    assert way[500] == pytest.approx(0.5)
    speed = np.gradient(way, share)
    assert speed[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert speed.max() == pytest.approx(1.875, abs=1e-4)


def test_velocity_commands_add_up_to_the_motion() -> None:
    motion = motions(RANGES, seed=4)[3]
    travelled = motion.position[0] + np.cumsum(motion.velocity, axis=0) * motion.period_s
    np.testing.assert_allclose(travelled[:-1], motion.position[1:], atol=1e-12)
