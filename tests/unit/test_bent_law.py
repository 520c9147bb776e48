"""Laws whose amount changes with the state: exact values, and real simulations of both kinds."""

import numpy as np
import pytest

from gfm.effects import EffectInstance, find_effect
from gfm.effects.bent import (
    BEYOND,
    SLIGHTLY,
    BentByDrive,
    BentByPosition,
    BentBySpeed,
    BentLaw,
    bent,
    slightly,
    ways_to_bend,
)
from gfm.effects.effect import DRIVE, Motion

#: From -1 to 3, and 0 to 2 as fast as it goes; most of both is a little less.
PLACES, SPEEDS = np.linspace(-1.0, 3.0, 101), np.linspace(-2.0, 2.0, 101)
MOST_PLACES, MOST_SPEEDS = np.array([-0.92, 2.92]), np.array([0.04, 1.96])
#: Its drive gives 5 N m at most, and nearly always 4.8.
MOVED = Motion(position=PLACES, velocity=SPEEDS, drive=np.linspace(-5.0, 5.0, 101))


def instance(name, joint="hinge", **values):
    return EffectInstance(effect=find_effect(name), joints=(joint,), values=values)


def torque(how, law, q, v, **amounts):
    values = {p.name: 0.0 for p in how.parameters} | amounts
    motion = Motion(position=np.array(q), velocity=np.array(v), drive=np.zeros(len(q)))
    return how(law, MOVED).torque(motion, values)


@pytest.mark.parametrize("how", [BentByPosition, BentBySpeed])
def test_a_law_that_does_not_bend_adds_nothing(how):
    rubbing = [instance("viscous_friction", coefficient=3.0)]
    assert torque(how, rubbing, [0.0, 1.0], [1.0, -2.0]) == pytest.approx([0.0, 0.0])


def test_the_first_way_is_the_law_times_the_place_between_the_ends():
    spring = instance("joint_spring", stiffness=2.0, rest_angle=1.0)
    at = [*MOST_PLACES, 1.0, 1.98]
    expected = np.array([-1.0, 1.0, 0.0, 0.98 / 1.92]) * -2.0 * (np.array(at) - 1.0)
    there = torque(BentByPosition, [spring], at, np.zeros(4), degree_1=1.0)
    assert there == pytest.approx(expected)


def test_speed_counts_whichever_way():
    rubbing = instance("viscous_friction", coefficient=1.0)
    v = np.array([1.96, -1.96, 1.0])
    second = torque(BentBySpeed, [rubbing], np.zeros(3), v, degree_2=1.0)
    assert second == pytest.approx([-1.96, 1.96, 0.5])  # P2 is 1 at the ends, -1/2 in the middle


def test_effects_of_one_law_bend_together_and_far_out_no_further():
    law = [instance("torque_offset", torque=2.0), instance("cogging_torque", **COGGING)]
    here = torque(BentByPosition, law, [2.92], [0.0], degree_3=1.0)
    assert here == pytest.approx([2.0 + 0.5 * np.sin(4.0 * 2.92 + 0.3)])
    offset = [instance("torque_offset", torque=2.0)]
    far = torque(BentByPosition, offset, [50.0], [0.0], degree_1=1.0)
    assert far == pytest.approx([2.0 * BEYOND])


COGGING = {"amplitude": 0.5, "per_revolution": 4.0, "phase": 0.3}


def test_many_simulations_have_amounts_of_their_own():
    law, names = [instance("torque_offset", torque=1.0)], [p.name for p in BentLaw.parameters]
    values = {name: np.array([0.0, 1.0, 2.0]) if name == "degree_1" else 0.0 for name in names}
    values = {name: np.broadcast_to(value, 3) for name, value in values.items()}
    motion = Motion(position=np.zeros(3), velocity=np.full(3, 1.96), drive=np.zeros(3))
    bend = BentBySpeed(law, MOVED)
    assert bend.torque(motion, values) == pytest.approx([0.0, 1.0, 2.0])


def test_a_drive_bends_with_the_torque_that_it_should_give():
    drive = np.array([-4.8, 0.0, 2.4, 9.0])
    motion = Motion(position=np.zeros(4), velocity=np.zeros(4), drive=drive)
    effect = BentByDrive([instance("actuator_gain", scale=0.5)], MOVED)
    values = {"degree_1": np.full(4, 2.0), "degree_2": np.zeros(4), "degree_3": np.zeros(4)}
    bend = np.array([-1.0, 0.0, 0.5, BEYOND])
    assert effect.drive_change(motion, values) == pytest.approx(2.0 * bend * drive)
    assert effect.torque(motion, values) is None


def test_a_law_is_bent_in_one_way_at_a_time():
    ways = bent([instance("torque_offset", torque=1.0)], MOVED)
    assert list(ways) == ["position", "velocity"]
    for straight in ways.values():
        assert not any(straight.values.values())
        amounts = np.array([list(way.values.values()) for way in slightly(straight)])
        assert amounts == pytest.approx(SLIGHTLY * np.eye(3))


def test_what_is_no_torque_does_not_bend_with_the_torques_of_its_state():
    law = [
        instance("encoder_offset", offset=0.1),
        instance("joint_spring", stiffness=1.0, rest_angle=0),
    ]
    motion = Motion(position=np.array([2.92]), velocity=np.zeros(1), drive=np.zeros(1))
    way = bent(law, MOVED)["position"]
    first = {name: float(name == "degree_1") for name in way.values}
    assert way.effect.torque(motion, first) == pytest.approx([-2.92])


def test_only_laws_of_the_state_of_one_joint_bend():
    stribeck = instance("stribeck_friction", static_excess=1.0, stribeck_velocity=0.1)
    assert list(ways_to_bend(stribeck)) == ["position", "velocity"]
    for drive in (
        instance("actuator_gain", scale=0.9),
        instance("torque_saturation", limit=3.0),
        instance("drive_dead_zone", torque=0.1),
        instance("drive_loss", coefficient=0.1),
    ):
        assert list(ways_to_bend(drive)) == [DRIVE]
    payload = {"mass": 1.0, "com_x": 0.0, "com_y": 0.0, "com_z": 0.1}
    for none in (
        instance("armature", inertia=0.1),
        instance("backlash", gap=0.1),
        instance("actuator_lag", time_constant=0.01),
        instance("payload", **payload),
    ):
        assert not ways_to_bend(none)
