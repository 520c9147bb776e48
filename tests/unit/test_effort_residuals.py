"""Residuals of measured efforts: which command was in force, and how noisy they are."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.residuals.problem import timed
from gfm.signals.smoothing import same_stamp_s
from gfm.sim.commands import AFTER, BEFORE, InForce, best_in_force
from pendulum import DAMPING, MODEL, STIFFNESS, swung

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
TIME_S = np.arange(0.0, 4.0, 0.01)


def recording(seed, noise, jitter_s=0.0, late=0):
    """A run, with the efforts `noise` N m and all stamps `jitter_s` off.

    Efforts are of `late` commands ago.
    """
    rng = np.random.default_rng(seed)
    run = swung(0.3 * np.sin(4.0 * TIME_S), seed=seed, noise=1e-5)
    true = swung(run.command[:, 0], seed=seed, noise=0.0).position
    speed = np.gradient(true, TIME_S, axis=0)
    told = run.command[np.maximum(np.arange(len(TIME_S)) - late, 0)]
    effort = STIFFNESS * (told - true) - DAMPING * speed

    def off(stamps):
        return stamps + np.round(1e9 * jitter_s * rng.standard_normal(len(stamps))).astype(int)

    return replace(
        run,
        stamp_ns=off(run.stamp_ns),
        command_stamp_ns=off(run.command_stamp_ns),
        effort=effort + noise * rng.standard_normal(effort.shape),
    )


def effort_costs(*runs):
    """The mean squared residual of each run's efforts, in units of the noise."""
    return _costs(timed(prepared(all_segments(SPECS, runs, windows_s=WHOLE)), ()))


def _costs(problem):
    residual = problem.residuals([()])[0]
    parts = [residual[rows][segment.position.size :] for segment, rows in _rows(problem)]
    return [float(np.mean(part**2)) for part in parts]


def _rows(problem):
    return zip(problem.segments, problem.slices(), strict=True)


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("jitter_s", [0.0, 5e-5])
def test_stamps_that_jitter_are_those_of_one_command(late, jitter_s):
    (cost,) = effort_costs(recording(0, 0.05, jitter_s, late))
    assert cost == pytest.approx(1.0, rel=0.35)


@pytest.mark.parametrize("late", [0, 1])
def test_recordings_without_efforts_say_nothing_of_when_they_were_measured(late):
    silent = [replace(recording(seed, 0.05), effort=None) for seed in (1, 2)]
    runs = [*silent, recording(0, 0.05, late=late)]
    assert timed(prepared(all_segments(SPECS, runs, windows_s=WHOLE)), ()).in_force == (
        AFTER if late == 0 else BEFORE
    )


def test_stamps_may_tell_from_one_effort_to_the_next_which_command_it_is_under():
    """As where both are stamped by a clock that ticks: a drive takes a command at the next tick."""
    rng = np.random.default_rng(3)
    run = recording(0, 0.05)
    tick_ns, clear_ns = 250_000, 20_000
    apart = rng.integers(-2, 3, len(TIME_S))
    own = np.maximum(np.arange(len(TIME_S)) - (apart < 1), 0)
    moved = STIFFNESS * (run.command[own] - run.command)
    off = tick_ns * apart + np.round(clear_ns * rng.uniform(-1.0, 1.0, len(TIME_S))).astype(int)
    run = replace(run, effort=run.effort + moved, command_stamp_ns=run.command_stamp_ns - off)
    problem = timed(prepared(all_segments(SPECS, [run], windows_s=WHOLE)), ())
    assert problem.in_force.ahead_s == pytest.approx(-0.5e-9 * tick_ns, abs=2e-9 * clear_ns)
    either = [replace(problem, in_force=one) for one in (BEFORE, AFTER)]
    own, before, after = (_costs(one)[0] for one in (problem, *either))
    assert own < 1.0  # commands that come and go look like noise
    assert min(before, after) > 3.0 * own


@pytest.mark.parametrize(
    ("since_s", "under_own", "expected"),
    [
        ([-1e-4, 0.0, 1e-4], [False, False, False], BEFORE),
        ([-1e-4, 0.0, 1e-4], [True, True, True], AFTER),
        ([1e-4, -1e-4, 0.0], [True, False, False], InForce(ahead_s=-5e-5, within_s=1e-4)),
        ([-2e-3, 2e-3], [False, True], InForce(ahead_s=0.0)),
        ([0.0, 1e-6, 2e-6], [False, False, True], BEFORE),  # no stamp is as exact
        ([], [], BEFORE),
    ],
)
def test_the_command_in_force_is_told_by_stamps_that_can_be_told_apart(
    since_s, under_own, expected
):
    own = np.array(under_own, dtype=float)
    found = best_in_force(np.array(since_s), before=own, after=1.0 - own)
    assert found == (pytest.approx(expected[0]), pytest.approx(expected[1]))


def test_stamps_are_the_same_as_far_as_they_jitter():
    off = np.random.default_rng(0).normal(0.0, 7e-4, (2, len(TIME_S)))
    spread_s = 7e-4 * np.sqrt(2.0)  # of both
    assert same_stamp_s(TIME_S + off[0], TIME_S + off[1]) == pytest.approx(1.96 * spread_s, rel=0.1)


@pytest.mark.parametrize(
    ("apart_s", "near_s"), [(0.0, 0.001), (0.0005, 0.001), (0.002, 0.002), (0.005, 0.0)]
)
def test_stamps_are_the_same_where_they_are_near(apart_s, near_s):
    assert same_stamp_s(TIME_S, TIME_S + apart_s) == pytest.approx(near_s)


def test_stamps_are_those_of_the_slower_of_both():
    for one, other in ((TIME_S[::4], TIME_S), (TIME_S, TIME_S[::4]), (TIME_S[:1], TIME_S)):
        assert same_stamp_s(one, other) == pytest.approx(0.001)


def test_clocks_that_run_free_have_no_stamp_in_common():
    assert same_stamp_s(TIME_S, 0.0073 * np.arange(500)) == 0.0


def test_efforts_of_each_recording_have_its_own_noise():
    costs = effort_costs(recording(0, 0.05), recording(1, 0.2))
    assert costs == [pytest.approx(1.0, rel=0.35), pytest.approx(1.0, rel=0.35)]


def test_efforts_that_never_change_have_the_noise_of_other_recordings():
    still = replace(recording(0, 0.05), effort=np.zeros((len(TIME_S), 1)))
    first, second = prepared(
        all_segments(SPECS, [still, recording(1, 0.05)], windows_s=WHOLE)
    ).segments
    assert first.effort_noise == pytest.approx(second.effort_noise)
