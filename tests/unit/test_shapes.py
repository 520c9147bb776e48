"""Shapes keep to their limits and do what they are there for."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.excitation.motion import JointRanges
from gfm.excitation.multisine import BAND_HZ, crest_factor, crest_multisine, few_peaks
from gfm.excitation.programme import FAMILIES
from gfm.excitation.shapes import RUNGS, friction_ladder, holds, move_s, rounded, sweep, within

RANGES = JointRanges(
    joint_names=("a", "b", "c"),
    center=np.array([0.3, -1.0, 2.0]),
    half_width=np.array([0.5, 1.3, 0.8]),
    speed=np.array([0.8, 0.6, 1.5]),
    acceleration=np.array([8.0, 3.0, 10.0]),
)
PERIOD_S = 0.02
TIME_S = np.arange(0.0, 20.0, PERIOD_S)
SHAPES = [pytest.param(one.shape, id=one.label) for one in FAMILIES]
TRAINING = [pytest.param(one.shape, id=one.label) for one in FAMILIES if one.shows]


def made(shape, seed=0, ranges=RANGES):
    return shape(ranges, TIME_S, np.random.default_rng(seed))


@pytest.mark.parametrize("shape", TRAINING)
@pytest.mark.parametrize("seed", range(3))
def test_range_speed_and_acceleration_are_kept(shape, seed):
    offset = made(shape, seed)
    speed = np.diff(offset, axis=0) / PERIOD_S
    acceleration = np.diff(speed, axis=0) / PERIOD_S
    for values, allowed in (
        (offset, RANGES.half_width),
        (speed, RANGES.speed),
        (acceleration, RANGES.acceleration),
    ):
        assert (np.abs(values).max(axis=0) <= allowed * (1 + 1e-9)).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_begins_and_ends_at_rest_in_the_centre_and_moves_every_joint(shape):
    offset = made(shape)
    np.testing.assert_allclose(offset[[0, 1, 2, -3, -2, -1]], 0.0, atol=1e-3)
    assert (np.ptp(offset, axis=0) > 0.05 * RANGES.half_width).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_the_seed_decides(shape):
    np.testing.assert_array_equal(made(shape, 1), made(shape, 1))
    assert np.abs(made(shape, 1) - made(shape, 2)).max() > 0.01


def test_holds_rest_in_many_postures_all_over_the_ranges():
    offset = made(holds)
    still = (np.abs(np.diff(offset, axis=0)).max(axis=1) < 1e-9).nonzero()[0]
    postures = np.unique(np.round(offset[still], 6), axis=0)
    assert len(postures) >= 5
    assert (np.ptp(postures, axis=0) > 1.2 * RANGES.half_width).all()


def test_the_ladder_spends_its_time_at_the_speeds_of_its_rungs():
    offset = made(friction_ladder)
    share = np.abs(np.diff(offset, axis=0)) / PERIOD_S / RANGES.speed
    for joint in range(3):
        top = share[:, joint].max()
        for rung in RUNGS:
            near = np.abs(share[:, joint] / top - rung) < 0.03 * rung
            assert near.mean() > 0.12, (joint, rung)
    signs = np.sign(np.diff(offset, axis=0))
    assert ((signs == 1).mean(axis=0) > 0.3).all()
    assert ((signs == -1).mean(axis=0) > 0.3).all()


def test_velocities_of_two_joints_on_the_ladder_are_not_proportional():
    speed = np.diff(made(friction_ladder), axis=0)
    together = np.abs(np.corrcoef(speed.T)[np.triu_indices(3, 1)])
    assert together.max() < 0.9


def test_a_sweep_reaches_both_ends_slowly_where_there_is_time():
    offset = made(sweep)
    reach = np.minimum(RANGES.half_width, 0.5 * RANGES.speed * (TIME_S[-1] - 0.8) / 4.0)
    np.testing.assert_allclose(offset.max(axis=0), reach, rtol=0.03)
    np.testing.assert_allclose(offset.min(axis=0), -reach, rtol=0.03)
    assert (np.abs(np.diff(offset, axis=0)).max(axis=0) / PERIOD_S <= 0.51 * RANGES.speed).all()


def test_the_multisine_has_its_power_in_its_band():
    speed = np.diff(made(crest_multisine), axis=0)
    power = np.abs(np.fft.rfft(speed, axis=0)) ** 2
    hertz = np.fft.rfftfreq(len(speed), PERIOD_S)
    inside = (hertz >= BAND_HZ[0] - 0.06) & (hertz <= BAND_HZ[1] + 0.06)
    assert (power[inside].sum(axis=0) > 0.97 * power.sum(axis=0)).all()
    thirds = np.array_split(power[inside], 3)
    assert all((part.sum(axis=0) > 0.15 * power.sum(axis=0)).all() for part in thirds)


def test_joints_have_frequencies_of_their_own_in_the_multisine():
    speed = np.diff(made(crest_multisine), axis=0)
    assert np.abs(np.corrcoef(speed.T)[np.triu_indices(3, 1)]).max() < 0.1


def test_the_multisine_stays_far_below_the_control_rate():
    time_s = np.arange(0.0, 20.0, 0.1)
    offset = crest_multisine(RANGES, time_s, np.random.default_rng(0))
    power = np.abs(np.fft.rfft(offset, axis=0)) ** 2
    hertz = np.fft.rfftfreq(len(offset), 0.1)
    assert (power[hertz <= 1.1].sum(axis=0) > 0.99 * power.sum(axis=0)).all()


def crest_of(harmonics, phase):
    time = 2 * np.pi * np.arange(1000) / 1000
    return crest_factor(np.cos(np.outer(time, harmonics) + phase).sum(axis=1))


def test_phases_are_improved_and_one_sine_is_left_alone():
    harmonics = np.arange(3, 50, 3)
    phase = np.random.default_rng(0).uniform(0, 2 * np.pi, len(harmonics))
    better = few_peaks(harmonics, phase, 1000)
    assert crest_of(harmonics, better) < min(0.85 * crest_of(harmonics, phase), 2.0)
    assert crest_of(np.array([5]), few_peaks(np.array([5]), phase[:1], 1000)) == pytest.approx(
        np.sqrt(2.0), rel=1e-4
    )


def test_rounding_keeps_what_is_constant_and_limits_the_acceleration():
    step = np.where(TIME_S > 10.0, 1.0, 0.0)[:, np.newaxis]
    ramp = rounded(step, np.array([1.0]), TIME_S)
    assert ramp[[0, -1], 0].tolist() == [0.0, pytest.approx(1.0)]
    assert np.diff(ramp[:, 0]).max() / PERIOD_S == pytest.approx(1.0, rel=0.05)
    smooth = rounded(ramp, np.array([0.2]), TIME_S)
    acceleration = np.abs(np.diff(smooth[:, 0], 2)).max() / PERIOD_S**2
    assert acceleration == pytest.approx(1.0 / 0.2, rel=0.15)


def test_what_is_within_limits_is_not_changed():
    small = 0.01 * np.sin(2 * np.pi * 0.1 * TIME_S)[:, np.newaxis] * np.ones(3)
    np.testing.assert_array_equal(within(RANGES, TIME_S, small), small)


def test_a_move_takes_the_time_that_its_slowest_joint_needs():
    assert move_s(RANGES, np.zeros(3)) == 0.0
    far = np.array([4.0, 0.0, 0.0])
    assert move_s(RANGES, far) == pytest.approx(1.875 * 4.0 / 0.8)
    near = np.array([0.0, 0.001, 0.0])
    assert move_s(RANGES, near) == pytest.approx(np.sqrt(5.7735 * 0.001 / 3.0), rel=1e-4)
