"""Flat tops are limits only where more was asked for; ends of a range are told."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.signals import limits

T = 0.01 * np.arange(1000)
WAVE = 0.5 * np.sin(3.0 * T)
NOISE = 1e-4 * np.random.default_rng(0).standard_normal((1000, 2))


def test_an_effort_cut_off_while_more_is_demanded_has_a_flat_top(make):
    demand = 8.0 * np.sin(3.0 * T)
    recording = make(T, WAVE, effort=np.clip(demand, -5.0, 5.0) + 1e-3 * NOISE[:, 0])
    (told,) = limits.cut_off_efforts(recording, recording.effort, demand[:, None])
    assert told.what == "effort has a flat top at"
    assert abs(told.value) == pytest.approx(5.0, abs=0.02)


@pytest.mark.parametrize(
    "effort",
    [
        8.0 * np.sin(3.0 * T),
        np.sign(np.sin(3.0 * T)),  # dry friction: a plateau, and demanded as one
        np.abs(((T + 0.5) % 2.0) - 1.0),
    ],
)
def test_an_effort_that_follows_its_demand_has_none(make, effort):
    recording = make(T, WAVE, effort=effort)
    assert limits.cut_off_efforts(recording, recording.effort, effort[:, None]) == []


def test_a_speed_limit_is_a_flat_top(make):
    command = 0.5 * np.sign(np.sin(1.5 * T))
    limited = [0.0]
    for told in command[1:]:
        limited.append(limited[-1] + np.clip(8.0 * (told - limited[-1]), -0.6, 0.6) * 0.01)
    (told,) = limits.cut_off_speeds(make(T, np.array(limited), command=command))
    assert told.what == "speed has a flat top at"
    assert abs(told.value) == pytest.approx(0.6, rel=0.03)


def test_time_at_a_limit_of_the_range_is_told(make, pendulum):
    stopped = make(T, np.minimum(WAVE, 0.3))
    (told,) = limits.at_range_limit(stopped, pendulum(joint_range="-1 0.3"))
    assert told.value == pytest.approx(100.0 * np.mean(WAVE > 0.2987), abs=1.0)
    assert limits.at_range_limit(stopped, pendulum(joint_range="-1 1")) == []
    assert limits.at_range_limit(stopped, pendulum()) == []
