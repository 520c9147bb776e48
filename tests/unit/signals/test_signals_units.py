"""Signals in other units than they claim are refused; good ones never are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gfm.api.objections import objection_to, units
from gfm.signals.channels import odd_velocities

DEGREES = 180.0 / np.pi
KINDS = ("position", "velocity", "effort")


@pytest.fixture
def good(make, swing):
    """Returns what makes a good recording of the pendulum under commands of a kind."""

    def recording(kind: str, **changes):
        t, s = swing(**changes)
        command = {
            "position": s["position"] + s["torque"] / 40.0 + s["velocity"] / 10.0,
            "velocity": s["velocity"] + s["torque"] / 10.0,
            "effort": s["torque"],
        }[kind]
        noise = 1e-4 * np.random.default_rng(0).standard_normal(len(t))
        effort, velocity = s["torque"], s["velocity"]
        return make(
            t, s["position"] + noise, kind, command=command, velocity=velocity, effort=effort
        )

    return recording


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("amplitude", "seconds"), [(0.02, 3.0), (2.0, 3.0), (0.8, 1.5)])
def test_good_recordings_pass(good, pendulum, kind, amplitude, seconds):
    recording = good(kind, amplitude=amplitude, seconds=seconds)
    assert objection_to(recording, pendulum(kind)) is None
    assert objection_to(recording, pendulum(kind, "-2.9 2.9")) is None


@pytest.mark.parametrize("kind", KINDS)
def test_positions_in_degrees_contradict_velocities(good, pendulum, kind):
    recording = good(kind)
    objection = objection_to(
        replace(recording, position=DEGREES * recording.position), pendulum(kind)
    )
    assert objection is not None
    assert objection.where == "velocity of a"
    assert "are the positions in degrees?" in objection.expected


@pytest.mark.parametrize("kind", KINDS)
def test_velocities_in_degrees_contradict_positions(good, pendulum, kind):
    recording = good(kind)
    objection = objection_to(
        replace(recording, velocity=DEGREES * recording.velocity), pendulum(kind)
    )
    assert objection is not None
    assert "57.3 times the position's slope" in objection.problem
    assert "are the velocities in degrees?" in objection.expected


@pytest.mark.parametrize(
    ("kind", "where"),
    [
        ("position", "position of a"),
        ("velocity", "velocity of a"),
        ("effort", "positions, stamps and torques"),
    ],
)
def test_measurements_in_degrees_contradict_commands(good, pendulum, kind, where):
    recording = replace(good(kind), velocity=None, effort=None)
    objection = objection_to(
        replace(recording, position=DEGREES * recording.position), pendulum(kind)
    )
    assert objection is not None
    assert objection.where == where
    assert "degrees" in objection.expected


@pytest.mark.parametrize("kind", ["position", "velocity"])
def test_all_in_degrees_is_more_than_a_link_can_do(good, pendulum, kind):
    recording = replace(good(kind), velocity=None, effort=None)
    spoilt = replace(
        recording, position=DEGREES * recording.position, command=DEGREES * recording.command
    )
    objection = objection_to(spoilt, pendulum(kind))
    assert objection is not None
    assert "degrees" in objection.expected
    ranged = objection_to(spoilt, pendulum(kind, "-2 2"))
    assert ranged is not None
    assert "the model's joint -2 to 2 rad" in ranged.problem


def test_a_balanced_joint_may_turn_far(make, pendulum):
    balanced = """
    <mujoco>
      <worldbody><body>
        <joint name="a" axis="0 0 1" {range}/>
        <inertial pos="0 0 0.1" mass="1" diaginertia="0.1 0.1 0.1"/>
      </body></worldbody>
      <actuator>{actuator}</actuator>
    </mujoco>
    """
    t = np.arange(0.0, 10.0, 0.01)
    turning = make(t, 20.0 * np.sin(0.5 * t), command=20.0 * np.sin(0.5 * t + 0.01))
    assert units.wound_up(turning, pendulum(text=balanced)) is None
    assert units.wound_up(turning, pendulum()) is not None


def test_a_velocity_of_the_wrong_sign_is_refused(good, pendulum):
    recording = good("position")
    objection = objection_to(replace(recording, velocity=-recording.velocity), pendulum())
    assert objection is not None
    assert objection.problem == "has the opposite sign of the position's slope"


@pytest.mark.parametrize("factor", [1e-3, 1e3, 1e-6])
def test_stamps_in_other_units_are_refused(good, pendulum, factor):
    recording = good("position")

    def rescaled(stamps):
        return np.round((stamps - stamps[0]) * factor).astype(np.int64)

    spoilt = replace(
        recording,
        stamp_ns=rescaled(recording.stamp_ns),
        command_stamp_ns=rescaled(recording.command_stamp_ns),
    )
    objection = objection_to(spoilt, pendulum())
    assert objection is not None
    assert objection.where == "stamps of the measurements"


def test_an_odd_unit_of_an_unused_velocity_is_only_told(good, pendulum):
    recording = good("position")
    rpm = replace(recording, velocity=9.55 * recording.velocity)
    assert objection_to(rpm, pendulum()) is None
    (told,) = odd_velocities(rpm)
    assert told.value == pytest.approx(9.55, rel=0.02)
    assert odd_velocities(recording) == []


def test_a_weak_servo_is_no_other_unit(make):
    t = np.arange(0.0, 10.0, 0.01)
    told = np.sin(t)
    assert units.command_ratio(make(t, 0.1 * told, command=told)) is None
    assert units.command_ratio(make(t, 2.0 * told, command=told)) is None


def test_a_released_pendulum_has_no_surplus_of_energy(make, swing, pendulum):
    t, s = swing(amplitude=2.0)
    falling = make(t, s["position"], "effort", command=0.0 * t)
    assert units.surplus_energy(falling, pendulum("effort")) is None
