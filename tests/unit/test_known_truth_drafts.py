"""The known-truth suite: how sizes of hidden effects are found."""

import numpy as np
import pytest
from known_truth.amounts import Hidden
from known_truth.draft import draft
from known_truth.plans import plans

SHAKES = float("inf")


def drafted(name):
    return draft(next(plan for plan in plans(0) if plan.name == name))


def gains(one):
    return [np.concatenate(run.control) for run in one.runs]


def viscous(coefficient=1.0):
    return Hidden(effect="viscous_friction", joints=(0,), parameters={"coefficient": coefficient})


def test_a_loop_over_torques_that_shakes_is_softened_and_tried_again():
    one = drafted("planar_effort-viscous_friction")
    before = gains(one)
    one.judge(viscous(), SHAKES)
    assert np.array(gains(one)) == pytest.approx(0.5 * np.array(before))
    assert not one.nominal  # simulated anew with these gains
    assert not one.complete
    assert one.attempt == 0


def test_a_loop_is_not_softened_for_ever():
    one = drafted("planar_effort-viscous_friction")
    before = gains(one)
    for _ in range(5):
        one.judge(viscous(), SHAKES)
    assert np.array(gains(one)) == pytest.approx(np.array(before) / 8.0)
    assert one.attempt > 0
    assert one.strength < 1.0


def test_servos_of_their_own_are_left_as_they_are():
    one = drafted("planar_position-viscous_friction")
    before = gains(one)
    one.judge(viscous(), SHAKES)
    assert np.array(gains(one)) == pytest.approx(np.array(before))
    assert one.strength < 1.0


def test_a_signal_that_is_seen_and_no_more_is_taken():
    one = drafted("planar_effort-viscous_friction")
    one.judge(viscous(), 1.0)
    assert not one.found
    assert one.strength > 1.0
    one.judge(viscous(2.0), 50.0)
    assert one.found == [viscous(2.0)]
    assert one.complete


def test_what_can_never_be_seen_is_left_out_and_the_suite_goes_on(capsys):
    one = drafted("planar_effort-viscous_friction")
    tries = 0
    while not one.complete:
        one.judge(viscous(), 1e-9)
        tries += 1
    assert one.given_up
    assert not one.found
    assert 1 < tries < 100
    assert "no size of viscous_friction can be seen" in capsys.readouterr().out
