"""Lateness: what is put in comes out, and what cannot be told apart is not claimed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from gfm.signals.examine import timing_of
from gfm.signals.lateness import delays

FINE_S, PERIOD_S = 0.001, 0.01
FINE = FINE_S * np.arange(25_000)
T = PERIOD_S * np.arange(2_500)


def commanded(joints: int) -> np.ndarray:
    """Returns what is commanded every control period: sums of sines, shape (2500, joints)."""
    rng = np.random.default_rng(3)
    hz, phase = rng.uniform(0.3, 2.5, (joints, 4)), rng.uniform(0.0, 6.0, (joints, 4))
    return 0.2 * np.sin(2.0 * np.pi * hz * T[:, None, None] + phase).sum(axis=2)


def answer(
    command: np.ndarray, delay_s: float | np.ndarray = 0.0, lag_s: float = 0.06
) -> np.ndarray:
    """Returns positions at T of servos with a dead time and a first-order lag, shape (2500, J)."""
    joints = command.shape[1]
    columns = []
    for j, late_s in enumerate(np.broadcast_to(delay_s, joints)):
        # The measurement `late_s` before the stamp: on a grid that is fine enough to shift by.
        row = np.clip(np.floor(FINE / PERIOD_S + 1e-9).astype(int), 0, len(T) - 1)
        keep = np.exp(-FINE_S / lag_s)
        held = command[row, j]
        fine = lfilter([0.0, 1.0 - keep], [1.0, -keep], held, zi=[held[0] * keep])[0]
        columns.append(np.interp(T - late_s, FINE, fine))
    noise = 1e-4 * np.random.default_rng(5).standard_normal((len(T), joints))
    return np.stack(columns, axis=1) + noise


def unknown(*recordings):
    """Predictions that broke off."""
    return [np.full_like(one.position, np.nan) for one in recordings]


@pytest.mark.parametrize("delay_s", [0.0, 0.0237, 0.05])
def test_against_a_prediction_the_delay_comes_out(make, delay_s):
    command = commanded(3)
    measured = make(T, answer(command, delay_s), command=command)
    late = delays([measured], [answer(command)])
    assert late.reference == "prediction"
    np.testing.assert_allclose(late.seconds, delay_s, atol=5e-4)
    assert late.common_s == pytest.approx(delay_s, abs=5e-4)
    assert (late.spread_s < 1e-3).all()
    assert late.per_joint_s is None


def test_a_segment_without_a_prediction_says_nothing_against_one(make):
    command = commanded(1)
    measured = make(T, answer(command, 0.02), command=command)
    alone = delays([measured], [answer(command)])
    both = delays([measured, measured], [answer(command), *unknown(measured)])
    assert both.blocks == alone.blocks
    assert both.seconds == alone.seconds


def test_against_the_command_the_lag_of_the_servo_is_part_of_it(make):
    command = commanded(1)
    quick, slow = (
        delays([make(T, answer(command, 0.02, lag_s), command=command)]).seconds[0]
        for lag_s in (0.01, 0.06)
    )
    assert quick == pytest.approx(0.03, abs=4e-3)
    assert quick + 0.02 < slow < 0.02 + 0.06


def test_a_slower_servo_than_the_model_s_looks_like_a_delay(make):
    command = commanded(1)
    late = delays([make(T, answer(command, lag_s=0.08), command=command)], [answer(command)])
    assert 0.005 < late.seconds[0] < 0.02


def test_reading_joints_in_turn_shows_as_an_even_fall(make):
    command = commanded(6)
    read_s = 0.003 * np.arange(6)
    measured = make(T, answer(command, 0.04 - read_s), command=command)
    late = delays([measured], [answer(command)])
    assert late.per_joint_s == pytest.approx(-0.003, rel=0.1)
    assert delays([measured]).per_joint_s is None
    told = [
        one for one in timing_of([measured], delays([measured], [answer(command)])) if one.doubtful
    ]
    assert [one.what for one in told] == ["lateness changes from joint to joint by"]
    assert told[0].value == pytest.approx(-3.0, rel=0.1)
    assert "read_offset_s" in told[0].consequence


def test_delays_that_differ_without_order_are_the_joints_own(make):
    command = commanded(5)
    own_s = np.array([0.0, 0.012, 0.0, 0.0, 0.003])
    measured = make(T, answer(command, 0.03 + own_s), command=command)
    late = delays([measured], [answer(command)])
    assert late.per_joint_s is None
    assert late.common_s == pytest.approx(0.03, abs=5e-4)
    np.testing.assert_allclose(late.own_s, own_s, atol=6e-4)
    told = timing_of([measured], delays([measured], [answer(command)]))
    own = [one.joint for one in told if one.what == "moves later than predicted by"]
    assert own == ["b", "e"]
    assert not any(one.doubtful for one in told)


def test_commanded_and_measured_torques_have_nothing_in_between(make):
    rng = np.random.default_rng(0)
    steps = np.repeat(rng.uniform(-1.0, 1.0, 500), 5)
    measured = np.roll(steps, 2) + 0.05 * rng.standard_normal(2500)
    recording = make(T, 0.1 * np.sin(T), "effort", command=steps, effort=measured)
    late = delays([recording])
    # A sample shows what held in the period around it: the change itself lies half a period back.
    assert late.seconds[0] == pytest.approx(1.5 * PERIOD_S, abs=1e-3)
    (told,) = timing_of([recording], delays([recording], unknown(recording)))
    assert "nothing else lies between" in told.consequence


def test_torques_sampled_just_after_their_commands_are_not_early(make):
    steps = np.random.default_rng(0).uniform(-1.0, 1.0, 2500)
    recording = make(T, 0.1 * np.sin(T), "effort", command=steps, effort=steps)
    assert delays([recording]).seconds[0] == pytest.approx(-0.5 * PERIOD_S, abs=1e-3)
    (told,) = timing_of([recording], delays([recording], unknown(recording)))
    assert "as good as at once" in told.consequence
    assert not told.doubtful


def test_an_effect_before_its_cause_is_doubtful(make):
    command = commanded(1)
    recording = make(T, answer(command, lag_s=0.01), command=command)
    latched = replace(recording, command_stamp_ns=recording.command_stamp_ns + 40_000_000)
    assert delays([latched]).seconds[0] == pytest.approx(-0.03, abs=4e-3)
    told = timing_of([latched], delays([latched], unknown(latched)))
    assert [one.doubtful for one in told] == [True]
    assert "an effect before its cause" in told[0].consequence


def test_kinds_of_command_are_not_mixed(make):
    command = commanded(1)
    position = make(T, answer(command, lag_s=0.06), command=command)
    told = np.gradient(command[:, 0], T)
    velocity = make(T, answer(command, lag_s=0.01), "velocity", command=told)
    what = [
        one.what
        for one in timing_of(
            [position, velocity], delays([position, velocity], unknown(position, velocity))
        )
    ]
    assert what == ["answers position commands after", "answers velocity commands after"]


@pytest.mark.parametrize("other", [{"servo_gain": {"a": 0.0}}, {"command": 0.0 * T}])
def test_a_drive_that_is_off_or_told_nothing_says_nothing(make, other):
    command = commanded(1)
    late = delays([make(T, answer(command), **({"command": command} | other))])
    assert np.isnan(late.seconds).all()
    assert np.isnan(late.common_s)
    assert late.blocks.tolist() == [0]


def test_one_stretch_is_too_little(make):
    command = commanded(1)
    short = make(T[:400], answer(command)[:400], command=command[:400])
    assert np.isnan(delays([short]).seconds).all()


def test_what_a_correction_explains_is_no_longer_late(make):
    command = commanded(1)
    recording = make(T, answer(command, 0.02), command=command)
    found = timing_of(
        [recording],
        delays([recording], [answer(command)]),
        delays([recording], [answer(command, 0.02)]),
    )
    late_ms = {one.what: one.value for one in found}
    assert late_ms["the joints move later than the model by"] == pytest.approx(20.0, abs=0.5)
    assert late_ms["the joints move later than the corrected model by"] == pytest.approx(0, abs=0.5)
