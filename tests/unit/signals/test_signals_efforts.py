"""Efforts of the wrong sign, and without one, are refused: only where two views agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gfm.api.objections.efforts import wrong_effort
from gfm.signals.limits import doubtful_efforts, views_of

FRICTION = 0.5


@pytest.fixture
def driven(make, swing):
    """Returns what makes a recording of a pendulum with dry friction, and its parts."""

    def recording(kind: str = "position", gain: float = 40.0, **other):
        t, s = swing()
        torque = s["torque"] + FRICTION * np.sign(s["velocity"])
        command = {
            "position": s["position"] + (torque + 4.0 * s["velocity"]) / gain,
            "velocity": s["velocity"] + torque / 10.0,
            "effort": torque,
        }[kind]
        noise = 0.02 * np.random.default_rng(0).standard_normal(len(t))
        return make(t, s["position"], kind, command=command, effort=torque + noise, **other)

    return recording


KINDS = ("position", "velocity", "effort")


@pytest.mark.parametrize("kind", KINDS)
def test_a_right_effort_passes(driven, pendulum, kind):
    recording = driven(kind)
    assert wrong_effort(recording, views_of(recording, pendulum(kind))) is None


@pytest.mark.parametrize("kind", KINDS)
def test_a_turned_sign_is_refused(driven, pendulum, kind):
    recording = driven(kind)
    recording = replace(recording, effort=-recording.effort)
    objection = wrong_effort(recording, views_of(recording, pendulum(kind)))
    assert objection is not None
    assert objection.where == "effort of a"
    assert "turn its sign" in objection.expected


@pytest.mark.parametrize("kind", KINDS)
def test_an_effort_without_sign_is_refused(driven, pendulum, kind):
    recording = driven(kind)
    recording = replace(recording, effort=np.abs(recording.effort))
    objection = wrong_effort(recording, views_of(recording, pendulum(kind)))
    assert objection is not None
    assert "is never negative" in objection.problem
    assert "current without sign" in objection.expected


def test_a_drive_that_only_ever_pulls_up_passes(driven, pendulum):
    recording = driven()
    recording = replace(recording, effort=recording.effort - recording.effort.min() + 1.0)
    assert wrong_effort(recording, views_of(recording, pendulum())) is None


def test_an_effort_without_its_gravity_compensation_is_told_but_not_refused(make, swing, pendulum):
    t, s = swing(amplitude=0.3, hz=0.2)
    weight = 9.81 * 0.3 * np.sin(s["position"])
    effort = s["torque"] - weight
    recording = make(t, s["position"], command=s["position"] + effort / 40.0, effort=effort)
    drive = effort[:, None]
    views = [
        replace(view, drive=drive, missing=view.needed - drive)
        for view in views_of(recording, pendulum())
    ]
    assert wrong_effort(recording, views) is None
    (told,) = doubtful_efforts(recording, views[0])
    assert told.value < -0.6
    assert "gravity compensation" in told.consequence


def test_gains_far_from_the_robots_are_no_wrong_sign(driven, pendulum):
    recording = driven(gain=400.0)
    assert wrong_effort(recording, views_of(recording, pendulum())) is None


def braking(period_s: float = 0.04, step_s: float = 1e-4):
    """Returns stamps, positions, commands and efforts of a servo that gets few commands.

    Efforts are measured just before the command of the same stamp.
    """
    inertia, weight = 0.3**2 + 0.02, 9.81 * 0.3
    stamps = np.arange(0.0, 8.0, period_s)
    command = 0.8 * np.sin(5.0 * stamps) * np.sin(0.7 * stamps)
    q, v, drive, rows = command[0], 0.0, 0.0, []
    for told in command:
        rows.append((q, drive))
        for _ in range(round(period_s / step_s)):
            drive = 40.0 * (told - q) - 4.0 * v
            v += step_s * (drive - weight * np.sin(q)) / inertia
            q += step_s * v
    return stamps, np.array(rows)[:, 0], command, np.array(rows)[:, 1]


def test_an_effort_measured_before_the_next_command_is_no_wrong_sign(make, pendulum):
    """The servo brakes by then: the next command asks for the opposite."""
    stamps, position, command, effort = braking()
    recording = make(stamps, position, command=command, effort=effort)
    same, before = views_of(recording, pendulum())
    assert np.corrcoef(effort, same.drive[:, 0])[0, 1] < 0.0
    assert np.corrcoef(effort, before.drive[:, 0])[0, 1] > 0.9
    opposite = replace(same, missing=-effort[:, None] - same.drive)
    assert wrong_effort(recording, (opposite, before)) is None


def test_a_command_that_asks_for_many_times_the_effort_is_no_wrong_sign(driven, pendulum):
    """Commands arrive late, and a stiff servo was measured while it braked."""
    recording = driven()
    views = views_of(recording, pendulum())
    recording = replace(recording, effort=-0.2 * recording.effort)
    assert np.corrcoef(recording.effort[:, 0], views[0].drive[:, 0])[0, 1] < -0.9
    assert wrong_effort(recording, views) is None


def test_the_effort_of_a_drive_that_is_off_is_not_judged(driven, pendulum):
    recording = driven(servo_gain={"a": 0.0})
    recording = replace(recording, effort=-recording.effort)
    views = views_of(recording, pendulum())
    assert wrong_effort(recording, views) is None
    assert doubtful_efforts(recording, views[0]) == []


def test_nothing_is_said_without_efforts(driven, pendulum):
    recording = replace(driven(), effort=None)
    assert wrong_effort(recording, views_of(recording, pendulum())) is None
