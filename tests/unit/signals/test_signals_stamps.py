"""What stamps say: jitter, gaps, clocks that jump, measurements told twice, absurd rates."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.api.objections.units import absurd_rate
from gfm.signals import channels

PERIOD_S = 0.01


def times(count: int = 1000) -> np.ndarray:
    return PERIOD_S * np.arange(count)


def wave(time_s: np.ndarray) -> np.ndarray:
    return np.sin(3.0 * time_s)


@pytest.mark.parametrize("check", [channels.jitter, channels.gaps, channels.repeated])
def test_nothing_is_found_in_even_stamps(make, check):
    assert check(make(times(), wave(times()))) == []


@pytest.mark.parametrize(("share", "found"), [(0.02, False), (0.05, False), (0.3, True)])
def test_jitter_is_told_as_a_share_of_the_period(make, share, found):
    scatter = np.random.default_rng(0).uniform(-0.5, 0.5, 1000) * PERIOD_S
    # Differences of independent errors have twice their variance; a uniform one has 1/12.
    time_s = times() + share * np.sqrt(6.0) * scatter
    told = channels.jitter(make(time_s, wave(time_s)))
    assert bool(told) is found
    if found:
        assert told[0].value == pytest.approx(100 * share, rel=0.1)
        assert told[0].unit == "% of the period"
        assert told[0].doubtful


@pytest.mark.parametrize(
    ("rate_hz", "refused"), [(0.1, True), (2.0, False), (5000.0, False), (1e5, True), (1e8, True)]
)
def test_rates_that_no_robot_has_are_refused(make, rate_hz, refused):
    time_s = np.arange(100) / rate_hz
    objection = absurd_rate(make(time_s, wave(time_s)))
    assert (objection is not None) is refused
    if objection is not None:
        assert objection.problem == f"{rate_hz:.3g} measurements per second"
        assert "milliseconds" in objection.expected


def test_messages_lost_in_a_motion_are_a_gap(make):
    kept = np.delete(np.arange(1000), slice(500, 530))
    told = channels.gaps(make(times()[kept], wave(times()[kept])))
    assert [one.what for one in told] == ["longest gap"]
    assert told[0].value == pytest.approx(0.31)


def test_a_motion_that_takes_no_time_tells_of_a_clock_that_jumped(make):
    time_s = times() + np.where(np.arange(1000) >= 520, 0.4, 0.0)
    told = channels.gaps(make(time_s, wave(times())))
    assert [one.what for one in told] == ["clock jumps by"]
    assert told[0].value == pytest.approx(0.41)


def test_a_gap_in_a_rest_is_not_called_a_clock_that_jumped(make):
    noise = 1e-4 * np.random.default_rng(0).standard_normal(1000)
    time_s = times() + np.where(np.arange(1000) >= 500, 0.4, 0.0)
    rest = np.where(np.abs(np.arange(1000) - 500) < 100, 0.3, wave(times()))
    assert [one.what for one in channels.gaps(make(time_s, rest + noise))] == ["longest gap"]


@pytest.mark.parametrize("factor", [2, 3])
def test_a_sensor_slower_than_the_log_is_found(make, factor):
    held = wave(times())[factor * (np.arange(1000) // factor)]
    (told,) = channels.repeated(make(times(), held))
    assert told.value == pytest.approx(100.0 * (1.0 - 1.0 / factor), abs=1.0)


def test_a_coarse_encoder_in_slow_motion_is_no_slow_sensor(make):
    rounded = 1e-3 * np.round(0.02 * wave(times()) / 1e-3)
    assert channels.repeated(make(times(), rounded)) == []


def test_sticking_and_slipping_is_no_slow_sensor(make):
    rng = np.random.default_rng(0)
    moves = rng.random(1000) < 0.8
    position = 1e-3 * np.cumsum(np.where(moves, rng.integers(4, 9, 1000), 0))
    for start in range(0, 1000, 50):
        position[start : start + 9] = position[start]
    assert channels.repeated(make(times(), position)) == []


def test_one_stamp_for_all_is_told_where_reading_takes_time(make):
    slow = 0.02 * np.arange(200)
    many = np.stack([wave(slow)] * 3, axis=1)
    (told,) = channels.one_stamp_a_cycle(make(slow, many))
    assert told.value == pytest.approx(20.0)
    assert not told.doubtful
    assert channels.one_stamp_a_cycle(make(slow, wave(slow))) == []
    fast = 0.001 * np.arange(200)
    assert channels.one_stamp_a_cycle(make(fast, np.stack([wave(fast)] * 3, axis=1))) == []
    own = make(slow, many, command_stamp_ns=np.arange(200) * 20_000_000 + 7)
    assert channels.one_stamp_a_cycle(own) == []
