"""What is late is found by its place, and is named together with what it cannot be told from."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.inference.amounts import at_bound
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.residuals.problem import timed
from gfm.diagnosis.search.naming import Recorded, equals_of, looked_for, recorded
from gfm.effects import EffectInstance, effect_library, find_effect
from gfm.effects.plugins import USUAL_SCALES
from gfm.sim.plant import native_spec, stepping_spec
from late_places import Late, late_run
from pendulum import MODEL, PERIOD_S

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
MOTOR = MODEL[: MODEL.index("<actuator>")] + (
    '<actuator><motor name="j" joint="j"/></actuator></mujoco>'
)
TIME_S = PERIOD_S * np.arange(500)
WAVES = 0.3 * np.sin(2 * np.pi * 0.7 * TIME_S) + 0.1 * np.sin(2 * np.pi * 1.9 * TIME_S)
STEPS = 0.15 * (np.floor((TIME_S + 0.3) / 0.53) % 2) * (TIME_S > 0.0)
#: By how much each place is late here, s: past a period of commands, and within one.
PLACES = {
    "command_delay": Late(command=0.0125),
    "servo_delay": Late(servo=0.0075),
    "position_delay": Late(position=0.0125),
    "effort_delay": Late(effort=0.0125),
    "clock_offset": Late(clock=-0.0125),
}
AMOUNTS = {name: 0.0125 for name in PLACES} | {"servo_delay": 0.0075, "clock_offset": -0.0125}
DELAYS = set(PLACES)
WITH, WITHOUT = Recorded(has_efforts=True), Recorded(has_efforts=False)


def instance(name, amount):
    effect = find_effect(name)
    return EffectInstance(effect=effect, joints=("j",), values={effect.parameters[0].name: amount})


def amount(one):
    return one.values[one.effect.parameters[0].name]


def names(found):
    return {one.effect.name for one in found}


@cache
def problem(place):
    return prepared(all_segments(SPECS, [late_run(WAVES + STEPS, PLACES[place], seed=1)]))


def fitted(here, name):
    """Returns the best fit of a delay, begun at its probes, as the search does."""
    effect = find_effect(name)
    starts = [
        (EffectInstance(effect=effect, joints=("j",), values=g[0]),)
        for g in effect.probes(USUAL_SCALES)
    ]
    alone = [] if name == "effort_delay" else [fit(here.positions_alone(), starts[0]).effects]
    fits = [fit(timed(here, start), start) for start in (*starts, *alone)]
    return min(fits, key=lambda one: one.cost)


@pytest.mark.parametrize("place", PLACES)
def test_a_delay_is_measured_at_each_place(place):
    best = fitted(problem(place), place)
    assert amount(best.effects[0]) == pytest.approx(AMOUNTS[place], rel=0.01)
    assert best.cost < 1.1


@pytest.mark.parametrize(
    ("place", "other"),
    [("command_delay", "position_delay"), ("position_delay", "command_delay")],
)
def test_efforts_tell_a_late_command_from_a_late_position_and_nothing_else_does(place, other):
    here = problem(place)
    right, wrong = (fitted(here, name) for name in (place, other))
    assert right.cost < 1.1
    assert wrong.cost > 50.0
    alone = here.positions_alone()
    both = [[instance(name, 0.0125)] for name in (place, other)]
    same = alone.residuals(both)
    np.testing.assert_allclose(same[0], same[1], atol=1e-9)


def test_an_offset_of_clocks_is_a_late_command_in_every_channel():
    told = problem("command_delay").residuals(
        [[instance(name, 0.0125)] for name in ("command_delay", "clock_offset")]
    )
    np.testing.assert_array_equal(told[0], told[1])


@pytest.mark.parametrize(
    ("late", "right", "wrong"),
    [
        (Late(spring=60.0), "joint_elasticity", "servo_delay"),
        (Late(servo=0.0075), "servo_delay", "joint_elasticity"),
    ],
)
def test_a_spring_is_told_from_a_late_servo_by_how_it_rings(late, right, wrong):
    ringing = 0.4 * (np.floor((TIME_S + 0.3) / 0.53) % 2) * (TIME_S > 0.0)
    here = prepared(all_segments(SPECS, [late_run(ringing[:190], late, seed=3)]))
    starts = {"joint_elasticity": (40.0, 90.0, 200.0), "servo_delay": (0.004,)}
    cost = {
        name: min(fit(timed(here, (one,)), (one,)).cost for one in (instance(name, s) for s in own))
        for name, own in starts.items()
    }
    assert cost[right] < 1.2
    assert cost[wrong] > 100.0


def test_mujoco_itself_delays_the_command_and_not_the_feedback():
    model = native_spec(SPECS[CommandKind.POSITION], [instance("command_delay", 0.02)]).compile()
    data = mujoco.MjData(model)
    data.qpos[0] = 0.1
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(-0.1 * 20.0)


def test_a_servo_that_hardly_waits_is_as_good_as_in_time():
    here = problem("command_delay")
    told = here.predictions([(), (instance("servo_delay", 0.0),)])
    for nominal, late in zip(*told, strict=True):
        np.testing.assert_allclose(late.position, nominal.position, atol=1e-4)


def test_without_efforts_a_shift_has_three_names():
    for name in ("command_delay", "position_delay", "clock_offset"):
        others = {"command_delay", "position_delay", "clock_offset"} - {name}
        found = equals_of(instance(name, 0.01), WITHOUT)
        assert names(found) == others
        assert all(amount(one) == 0.01 and one.joints == ("j",) for one in found)


def test_efforts_leave_a_late_command_the_name_of_a_clock_only():
    assert names(equals_of(instance("command_delay", 0.01), WITH)) == {"clock_offset"}
    assert equals_of(instance("position_delay", 0.01), WITH) == ()
    assert equals_of(instance("effort_delay", 0.01), WITH) == ()


def test_a_clock_that_is_behind_is_no_delay():
    assert equals_of(instance("clock_offset", -0.01), WITHOUT) == ()


def test_a_late_servo_is_a_late_command_where_it_feels_nothing():
    torques = Recorded(has_efforts=True, has_feedback=False)
    assert names(equals_of(instance("servo_delay", 0.01), torques)) == {
        "command_delay",
        "clock_offset",
    }
    assert equals_of(instance("servo_delay", 0.01), WITH) == ()


def test_a_torque_beside_its_command_hides_delays_within_a_period():
    beside = Recorded(has_efforts=True, has_feedback=False, command_period_s=0.01)
    assert "position_delay" in names(equals_of(instance("command_delay", 0.004), beside))
    assert "position_delay" not in names(equals_of(instance("command_delay", 0.012), beside))
    assert equals_of(instance("effort_delay", 0.004), beside) == ()


def test_what_is_no_delay_has_no_equal():
    assert equals_of(instance("actuator_lag", 0.01), WITHOUT) == ()


@pytest.mark.parametrize(
    ("seen", "kept"),
    [
        (WITHOUT, {"command_delay", "servo_delay", "clock_offset"}),
        (WITH, DELAYS),
        (Recorded(has_efforts=False, has_feedback=False), {"command_delay", "clock_offset"}),
        (Recorded(has_efforts=True, has_feedback=False), DELAYS - {"servo_delay"}),
    ],
)
def test_names_of_what_is_looked_for_already_are_left_out(seen, kept):
    library = list(effect_library().values())
    left = looked_for(library, seen)
    assert {one.name for one in left} & DELAYS == kept
    assert [one for one in left if one.name not in DELAYS] == [
        one for one in library if one.name not in DELAYS
    ]


def test_a_problem_says_what_of_delays_it_could_tell():
    here = problem("command_delay")
    assert recorded(here) == WITH
    assert recorded(here.positions_alone()) == WITHOUT
    spec = {CommandKind.EFFORT: mujoco.MjSpec.from_string(MOTOR)}
    torques = late_run(0.3 * WAVES, Late(command=0.005), seed=2, feedback=False)
    seen = recorded(prepared(all_segments(spec, [torques])))
    assert not seen.has_feedback
    assert seen.command_period_s == pytest.approx(PERIOD_S)
    free = replace(torques, command_stamp_ns=torques.command_stamp_ns + 5_000_000)
    assert recorded(prepared(all_segments(spec, [free]))).command_period_s == 0.0


@pytest.mark.parametrize(
    ("late", "told_apart"), [(Late(command=0.005), False), (Late(position=0.005), True)]
)
def test_torques_of_the_command_before_may_be_early_or_late(late, told_apart):
    spec = {CommandKind.EFFORT: mujoco.MjSpec.from_string(MOTOR)}
    here = prepared(
        all_segments(spec, [late_run(0.5 * WAVES + STEPS, late, seed=2, feedback=False)])
    )
    names = ("command_delay", "position_delay")
    problems = {name: timed(here, [instance(name, 0.005)]) for name in names}
    cost = {
        name: float(np.mean(one.residuals([[instance(name, 0.005)]])[0] ** 2))
        for name, one in problems.items()
    }
    assert cost["position_delay"] < 1.1
    assert (cost["command_delay"] < 1.1) != told_apart
    seen = recorded(problems["position_delay"])
    equal = {one.effect.name for one in equals_of(instance("position_delay", 0.005), seen)}
    assert ("command_delay" in equal) != told_apart


def test_no_delay_takes_more_to_screen_than_a_rollout_or_three():
    probes = {name: len(find_effect(name).probes(USUAL_SCALES)) for name in PLACES}
    assert probes == dict.fromkeys(PLACES, 1) | {"effort_delay": 3}


def test_a_clock_that_is_ahead_is_looked_for_as_a_late_command():
    clock = find_effect("clock_offset")
    (group,) = clock.probes(USUAL_SCALES)
    assert clock.combine(group, [2.0]) == {"offset": -0.008}
    assert clock.combine(group, [-2.0]) is None


def test_an_offset_smaller_than_stamps_are_exact_has_not_been_found():
    assert at_bound(instance("clock_offset", -1e-4))
    assert not at_bound(instance("clock_offset", -1e-3))


@pytest.mark.parametrize("name", ["position_delay", "effort_delay", "clock_offset"])
def test_stepped_simulations_leave_late_sensors_out_and_it_is_said(name):
    spec = SPECS[CommandKind.POSITION]
    late = instance(name, 0.0125)
    assert stepping_spec(spec, [late]).to_xml() == spec.copy().to_xml()
    assert late.effect.not_stepped


def test_stepped_simulations_take_the_command_of_a_late_servo_late():
    model = stepping_spec(SPECS[CommandKind.POSITION], [instance("servo_delay", 0.0125)]).compile()
    assert model.actuator_delay[0] == pytest.approx(0.0125)
    assert find_effect("servo_delay").not_stepped
