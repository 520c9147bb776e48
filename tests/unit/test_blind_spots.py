"""What recordings could not have shown, told from how they moved alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory
from gfm.excitation.blind_spots import ANY, BlindSpot, blind_spots
from gfm.excitation.motion import JointRanges
from gfm.excitation.programme import FAMILIES
from gfm.excitation.sightings import sightings

PERIOD_S = 0.01
TIME_S = np.arange(0.0, 20.0, PERIOD_S)
RANGES = JointRanges(
    joint_names=("a", "b"),
    center=np.zeros(2),
    half_width=np.array([1.0, 1.0]),
    speed=np.array([1.0, 1.2]),
    acceleration=np.array([8.0, 8.0]),
)


def recording(position, *, command=None, effort=None, names=("a", "b")):
    """Returns a recording of `position`, shape (T, J), which by default is also the command."""
    stamps = (1e9 * PERIOD_S * np.arange(len(position))).astype(np.int64)
    return Trajectory(
        name="made",
        joint_names=names,
        stamp_ns=stamps,
        position=position,
        velocity=None,
        effort=effort,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamps,
        command=position if command is None else command,
    )


def both(one, two):
    return np.stack([one, two], axis=1)


def spots(*recordings, **asked) -> dict[str, BlindSpot]:
    found = blind_spots(recordings, **asked)
    assert len({spot.effect for spot in found}) == len(found)
    return {spot.effect: spot for spot in found}


def sine(hertz, amplitude=1.0, phase=0.0):
    return amplitude * np.sin(2 * np.pi * hertz * TIME_S + phase)


def programme():
    """Returns recordings of everything that is proposed, with the torque of a load and inertia."""
    made = []
    for number, family in enumerate(FAMILIES):
        position = family.shape(RANGES, TIME_S, np.random.default_rng(number))
        acceleration = np.gradient(np.gradient(position, TIME_S, axis=0), TIME_S, axis=0)
        made.append(recording(position, effort=2.0 * np.sin(position) + 0.3 * acceleration))
    return made


def test_the_proposed_motions_leave_nothing_in_the_dark():
    assert blind_spots(programme()) == ()


@pytest.mark.parametrize("family", [one for one in FAMILIES if one.shows], ids=lambda f: f.label)
def test_a_motion_shows_what_it_is_there_for(family):
    position = family.shape(RANGES, TIME_S, np.random.default_rng(0))
    dark = spots(recording(position, effort=2.0 * np.sin(position)))
    assert set(dark).isdisjoint(family.shows)


def test_no_recordings_no_blind_spots():
    assert blind_spots([]) == ()


def test_a_joint_that_stands_still_is_named_once_and_nothing_else_is_said_of_it():
    found = blind_spots([recording(both(sine(0.4), 0.001 * sine(0.4)))])
    still = [spot for spot in found if "b" in spot.joints]
    assert [spot.effect for spot in still] == [ANY]
    assert still[0].why == "moved over less than 0.02 rad"


def test_one_way_without_reversals_hides_dry_friction_and_its_sides():
    ramp = 0.1 * TIME_S
    dark = spots(recording(both(ramp, sine(0.4))))
    assert dark["coulomb_friction"].joints == ("a",)
    assert dark["coulomb_friction"].why == "a: 0 reversals; expected at least 4 reversals"
    assert dark["coulomb_friction"].motion.startswith("ladder: ")
    assert "a" in dark["asymmetric_friction"].joints
    assert "a" in dark["torque_offset"].joints


def test_one_speed_hides_viscous_friction():
    triangle = np.abs((0.25 * TIME_S) % 1.0 - 0.5)
    dark = spots(recording(both(triangle, sine(0.3))))
    assert dark["viscous_friction"].joints == ("a",)
    assert "no slow motion" in dark["viscous_friction"].why


def test_slow_commands_hide_delay_and_lag_and_one_fast_joint_shows_the_delay():
    slow = spots(recording(both(sine(0.05), sine(0.05, phase=1.0))))
    assert slow["command_delay"].joints == ()
    assert slow["actuator_lag"].joints == ("a", "b")
    assert "commanded at 0.05 Hz" in slow["command_delay"].why
    mixed = spots(recording(both(sine(0.05), sine(0.8))))
    assert "command_delay" not in mixed
    assert mixed["actuator_lag"].joints == ("a",)


def test_a_sharp_step_shows_the_delay_though_it_is_rare():
    step = np.where(TIME_S > 10.0, 0.5, 0.0)
    moved = np.clip(TIME_S - 10.0, 0.0, 0.5)
    dark = spots(recording(both(moved, moved), command=both(step, step)))
    assert "command_delay" not in dark


def test_a_fast_recording_is_not_drowned_by_slow_ones():
    slow = recording(both(sine(0.05), sine(0.05, phase=1.0)))
    fast = recording(both(sine(0.8, 0.4), sine(0.9, 0.4))[:600])
    assert "actuator_lag" in spots(slow)
    dark = spots(*[slow] * 6, fast)
    assert {"actuator_lag", "armature", "joint_elasticity"}.isdisjoint(dark)


def test_little_range_hides_springs_angles_ripples_and_gravity():
    dark = spots(recording(both(sine(0.4, 0.1), sine(0.5, 0.6))))
    for effect in ("joint_spring", "cogging_torque", "encoder_offset"):
        assert dark[effect].joints == ("a",)
    assert "ripples of less than 32 a turn" in dark["cogging_torque"].why
    assert "gravity_direction" not in dark
    narrow = spots(recording(both(sine(0.4, 0.1), sine(0.5, 0.1))))
    assert narrow["gravity_direction"].joints == ()
    assert narrow["payload"].motion.startswith("holds: ")


def test_two_joints_that_move_as_one_hide_a_friction_between_them():
    assert spots(recording(both(sine(0.4), -sine(0.4))))["coupled_friction"].joints == ("a", "b")
    in_turn = both(np.where(TIME_S < 10, sine(0.4), 0.0), np.where(TIME_S < 10, 0.0, sine(0.4)))
    assert "coupled_friction" in spots(recording(in_turn))
    assert "coupled_friction" not in spots(recording(both(sine(0.4), sine(0.5))))


def test_a_robot_with_one_joint_lacks_no_second_one():
    assert "coupled_friction" not in spots(recording(sine(0.4)[:, np.newaxis], names=("a",)))


def test_an_even_load_hides_friction_that_depends_on_it_and_play():
    position = both(sine(0.4), sine(0.5))
    even = np.full_like(position, 3.0)
    dark = spots(recording(position, effort=even))
    assert dark["load_dependent_friction"].joints == ("a", "b")
    assert "varied by 0 %" in dark["load_dependent_friction"].why
    assert "loaded the rarer way for 0 s" in dark["backlash"].why
    varied = spots(recording(position, effort=3.0 * position))
    assert {"load_dependent_friction", "backlash"}.isdisjoint(varied)
    unknown = spots(recording(position))
    assert "load_dependent_friction" not in unknown


def test_saturation_is_judged_where_the_limit_is_known():
    position = both(sine(0.4), sine(0.5))
    made = recording(position, effort=3.0 * position)
    assert "torque_saturation" not in spots(made)
    dark = spots(made, torque_limit_nm={"a": 10.0, "b": 3.1})
    assert dark["torque_saturation"].joints == ("a",)
    assert "took 3 of 10 N m" in dark["torque_saturation"].why


def test_noise_at_rest_is_neither_motion_nor_reversal():
    rng = np.random.default_rng(0)
    move = np.clip(0.2 * (TIME_S - 5.0), 0.0, 1.0)
    noisy = both(move, sine(0.4)) + 2e-4 * rng.standard_normal((len(TIME_S), 2))
    first, second = sightings([recording(noisy)])
    assert first.reversals == 0
    assert second.reversals == 16
    assert first.top_speed == pytest.approx(0.2, rel=0.1)


def test_a_coarse_encoder_still_shows_slow_motion():
    step = 2 * np.pi / 4096
    coarse = step * np.round(both(sine(0.2, 0.2), sine(0.3, 0.2))[::2] / step)
    assert "stribeck_friction" not in spots(recording(coarse))


def test_frequencies_are_those_of_sines():
    first, second = sightings([recording(both(sine(0.25), sine(0.5, 0.3)))])
    assert (first.motion_hz, second.motion_hz) == pytest.approx((0.25, 0.5), rel=0.05)
    assert (first.command_hz, second.command_hz) == pytest.approx((0.25, 0.5), rel=0.05)
    assert (first.span, second.span) == pytest.approx((2.0, 0.6), rel=1e-3)
    assert first.beside_s == pytest.approx(20.0, rel=0.2)


def test_a_very_short_recording_with_one_command_lacks_nearly_everything():
    few = recording(both(sine(0.4), sine(0.5))[:10])
    one_command = replace(few, command_stamp_ns=few.command_stamp_ns[:1], command=few.command[:1])
    dark = spots(one_command)
    assert {"coulomb_friction", "viscous_friction", "command_delay", "joint_spring"} <= set(dark)
    assert "one command" in dark["command_delay"].why
