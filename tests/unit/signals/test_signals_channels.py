"""What single signals say: dead channels, echoes, rounding."""

from __future__ import annotations

import numpy as np
import pytest

from gfm.api.objections import dead_positions
from gfm.api.objections.channels import stuck_effort, stuck_position
from gfm.signals import channels, echoes

T = 0.01 * np.arange(1000)
WAVE = 0.5 * np.sin(3.0 * T)
NOISE = 1e-4 * np.random.default_rng(0).standard_normal((1000, 2))


def test_a_position_that_never_follows_is_refused(make):
    objection = stuck_position(make(T, np.zeros(1000), command=WAVE))
    assert objection is not None
    assert objection.where == "position of a"
    assert objection.problem == "never changes while the command demands 1 rad of motion"


@pytest.mark.parametrize(
    "case",
    [
        {"command": 0.1 * WAVE},  # dry friction may hold against so little
        {"command": WAVE, "servo_gain": {"a": 0.0}},  # switched off
        {"command": WAVE, "kind": "effort"},  # torques below the friction move nothing
        {"command": 0.1 * WAVE, "kind": "velocity"},
    ],
)
def test_a_joint_that_may_rest_is_not_refused(make, case):
    assert stuck_position(make(T, np.zeros(1000), **case)) is None


def test_a_commanded_speed_is_summed_up_to_a_motion(make):
    objection = stuck_position(make(T, np.zeros(1000), "velocity", command=WAVE))
    assert objection is not None
    assert "0.333 rad" in objection.problem


def test_a_channel_without_its_noise_is_dead(make):
    moving = np.stack([WAVE, WAVE], axis=1) + NOISE
    dead = moving.copy()
    dead[:, 1] = 0.3
    command = np.stack([WAVE, 0.01 * WAVE], axis=1)
    recordings = [make(T, moving, command=command), make(T, dead, command=command)]
    index, objection = dead_positions(recordings)
    assert (index, objection.where) == (1, "position of b")
    assert dead_positions([recordings[1]]) is not None
    assert dead_positions([recordings[0]]) is None


def test_a_joint_that_rests_on_purpose_is_not_dead(make):
    resting = np.stack([WAVE + NOISE[:, 0], np.full(1000, 0.3)], axis=1)
    command = np.stack([WAVE, np.full(1000, 0.3)], axis=1)
    assert dead_positions([make(T, resting, command=command)]) is None


def test_a_coarse_encoder_may_rest_without_noise(make):
    coarse = 1e-3 * np.round(np.stack([WAVE, 0.0 * WAVE], axis=1) / 1e-3)
    command = np.stack([WAVE, 0.01 * WAVE], axis=1)
    assert dead_positions([make(T, coarse, command=command)]) is None


def test_efforts_filled_with_zeros_are_refused(make):
    objection = stuck_effort(make(T, WAVE, effort=np.zeros(1000)))
    assert objection is not None
    assert "is 0 throughout" in objection.problem
    assert "empty field" in objection.expected


@pytest.mark.parametrize(
    "case",
    [
        {"effort": None},
        {"effort": WAVE},
        {"effort": 0 * WAVE, "servo_gain": {"a": 0.0}},
        {"effort": 0 * WAVE, "kind": "effort", "command": 0 * WAVE},
    ],
)
def test_efforts_that_may_be_zero_are_not_refused(make, case):
    assert stuck_effort(make(T, WAVE, **case)) is None


def test_what_never_changes_is_told(make):
    told = channels.still(make(T, np.stack([WAVE, 0 * WAVE], 1), command=np.zeros((1000, 2))))
    assert [(one.joint, one.what, one.doubtful) for one in told] == [
        ("b", "position never changes", True),
        ("a", "command never changes", False),
        ("b", "command never changes", False),
    ]


@pytest.mark.parametrize("shift", [-2, -1, 0, 1, 2])
def test_a_command_that_is_the_measurement_is_an_echo(make, shift):
    measured = WAVE + NOISE[:, 0]
    (told,) = echoes.echoed(make(T, measured, command=np.roll(measured, shift)))
    assert told.what == "command equals measurement"
    assert told.value == pytest.approx(100.0)


def test_a_servo_that_follows_well_is_no_echo(make):
    assert echoes.echoed(make(T, WAVE + NOISE[:, 0], command=WAVE)) == []
    assert echoes.echoed(make(T, WAVE, command=WAVE + 1e-5)) == []


def test_rounding_is_told_where_noise_does_not_hide_it(make):
    (told,) = channels.rounded(make(T, 1e-3 * np.round(WAVE / 1e-3)))
    assert (told.value, told.unit) == (pytest.approx(1.0), "mrad")
    assert not told.doubtful
    noisy = WAVE + 1e-2 * np.random.default_rng(1).standard_normal(1000)
    assert channels.rounded(make(T, 1e-3 * np.round(noisy / 1e-3))) == []
