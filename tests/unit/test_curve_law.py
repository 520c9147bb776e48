"""Laws without a name: exact values between knots, and amounts read off a law that has one."""

import numpy as np
import pytest

from gfm.effects import EffectInstance
from gfm.effects.curve import CURVE_OF, KNOTS, CurveOfDrive, CurveOfPosition, CurveOfSpeed
from gfm.effects.effect import Motion

#: From -1 to 3, so that knots over all but a hundredth on each side are at -0.96 to 2.96.
PLACES = np.linspace(-1.0, 3.0, 101)
AT = np.linspace(-0.96, 2.96, KNOTS)
#: A joint at these places, that is driven by so much.
MOVED = Motion(position=PLACES, velocity=PLACES, drive=PLACES)


def motion(q, v):
    return Motion(position=np.array(q), velocity=np.array(v), drive=np.zeros(len(q)))


def values(*torques):
    return {f"torque_{k}": torque for k, torque in enumerate(torques)}


@pytest.mark.parametrize("kind", CURVE_OF.values())
def test_a_curve_of_nothing_is_nothing(kind):
    curve = EffectInstance(effect=kind(MOVED), joints=("j",), values=values(*np.zeros(KNOTS)))
    assert curve.added(motion([0.0, 1.0], [1.0, -2.0])) == pytest.approx(0.0)


def test_a_curve_of_the_drive_is_beside_what_it_should_give():
    heights, drive = np.arange(KNOTS) ** 2.0, np.array([AT[3], 0.5 * (AT[2] + AT[3]), 7.0])
    joint = Motion(position=np.zeros(3), velocity=np.zeros(3), drive=drive)
    told = CurveOfDrive(MOVED).drive_change(joint, values(*heights))
    assert told == pytest.approx([9.0, 6.5, 64.0])


def test_it_goes_through_its_knots_straight_and_on_as_it_ends():
    heights = np.arange(KNOTS) ** 2.0
    there = [*AT, 0.5 * (AT[2] + AT[3]), -5.0, 7.0]
    told = CurveOfPosition(MOVED).torque(motion(there, np.zeros(len(there))), values(*heights))
    assert told == pytest.approx([*heights, 6.5, 0.0, 64.0])


def test_a_curve_of_the_speed_is_against_the_motion():
    told = CurveOfSpeed(MOVED).torque(
        motion([0.0] * 3, [1.0, -1.0, 0.0]), values(*np.full(KNOTS, 2.0))
    )
    assert told == pytest.approx([-2.0, 2.0, 0.0])


def test_many_simulations_have_heights_of_their_own():
    heights = np.outer(np.ones(KNOTS), [1.0, 2.0, 3.0])
    told = CurveOfPosition(MOVED).torque(motion(np.zeros(3), np.zeros(3)), values(*heights))
    assert told == pytest.approx([1.0, 2.0, 3.0])


def test_probes_of_one_knot_each_are_combined_to_the_curve_that_they_explain():
    effect = CurveOfPosition(MOVED)
    (group,) = effect.probes(None)
    cable = -np.maximum(PLACES - AT[4], 0.0)  # slack up to a knot
    rest = np.zeros_like(PLACES)
    columns = np.stack([effect.torque(motion(PLACES, rest), one) for one in group], axis=1)
    told = effect.combine(group, np.linalg.lstsq(columns, cable)[0].tolist())
    assert effect.torque(motion(PLACES[2:-2], rest[2:-2]), told) == pytest.approx(
        cable[2:-2], abs=0.02
    )
    instance = EffectInstance(effect=effect, joints=("j",), values=told)
    assert instance.has_law
