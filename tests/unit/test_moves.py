"""Hypotheses and the moves between them, on a pendulum that SciPy integrates."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.core.deadline import OutOfTimeError
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.inference.constants import UNWEIGHED
from gfm.diagnosis.inference.fitting import Fit, fit, measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.inference.steadiness import apart
from gfm.diagnosis.search.candidates import Place, joint_scales
from gfm.diagnosis.search.hypothesis import FAR_OFF, Hypothesis, parameters_of
from gfm.diagnosis.search.moves.add import (
    _above_their_level,
    _beginnings,
    _together,
    add,
    beside,
    best_first,
    best_of,
    worth_more,
)
from gfm.diagnosis.search.moves.begin_anew import begun_anew
from gfm.diagnosis.search.moves.common_errors import common_errors
from gfm.diagnosis.search.moves.merge import merge
from gfm.diagnosis.search.moves.missing_torque import borne_out, fewest, missing_torque
from gfm.diagnosis.search.moves.reduce import (
    Compared,
    _not_told_apart,
    exchange,
    gains_of_each,
    remove,
    rivals_of,
)
from gfm.diagnosis.search.nameless import STATES, _adding_nothing, _shown
from gfm.diagnosis.search.read_off import ALIKE
from gfm.diagnosis.search.screening import Screened
from gfm.diagnosis.search.steps import run
from gfm.diagnosis.search.support import _does, support
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, Motion, find_effect
from gfm.effects.curve import KNOTS, CurveOfPosition
from gfm.signals.torque_domain import torque_domain, torque_views
from pendulum import LENGTH, MASS, MODEL, PERIOD_S, swung

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
NOISE, FRICTION, LITTLE, OFFSET, LIMIT = 3e-4, 0.3, 0.2, 0.25, 3.0


def command(seed, duration_s=8.0):
    time_s = np.arange(0.0, duration_s, PERIOD_S)
    speeds, phases = np.random.default_rng(seed).uniform(1.0, 5.0, (2, 3))
    waves = np.sin(np.outer(time_s, speeds) + phases).sum(axis=1)
    return 0.3 * np.minimum(time_s, 1.0) * waves


def runs(count=2, **truth):
    return [swung(command(seed), seed=seed, noise=NOISE, **truth) for seed in range(count)]


def dry(_q, v):
    return -FRICTION * np.tanh(v / 1e-3)


def instance(name, **values):
    return EffectInstance(effect=find_effect(name), joints=("j",), values=values)


class Case:
    """Recordings, the problem of explaining them, and hypotheses about it."""

    def __init__(self, recordings):
        self.problem = prepared(all_segments(SPECS, recordings)).robust(())
        views = torque_views(self.problem, recordings)
        (self.scales,) = joint_scales(self.problem, views)
        self.torques = torque_domain(self.problem, recordings)
        self.nominal = self.problem.joint_costs(measured(self.problem, ()).residual)

    def with_effects(self, *effects):
        return Hypothesis(
            problem=self.problem, fit=fit(self.problem, effects), nominal=self.nominal
        )

    def search(self, *names, **more):
        """A search among some effects on the joint, which says nothing unless it is asked to."""
        places = [
            Place(effect=find_effect(name), joints=("j",), scales=self.scales) for name in names
        ]
        return Search(**({"candidates": places, "report": lambda _: None} | more))


@pytest.fixture(scope="module")
def rubbing():
    return Case(runs(4, torque=dry))


@pytest.fixture(scope="module")
def pulled():
    return Case(runs(torque=lambda _q, _v: OFFSET))


@pytest.fixture(scope="module")
def right():
    return Case(runs())


def added(case, *names, before=()):
    return add(case.with_effects(*before), case.search(*names))


LAWS = ("coulomb_friction", "viscous_friction", "armature", "quadratic_drag", "command_delay")


def test_a_right_model_is_not_open_and_a_wrong_one_is(rubbing, right):
    assert rubbing.with_effects().is_open
    assert rubbing.with_effects().open_joints == ("j",)
    assert not rubbing.with_effects(instance("coulomb_friction", torque=0.1)).is_open
    assert not right.with_effects().is_open


def test_what_one_hypothesis_gains_another_loses(rubbing):
    nominal = rubbing.with_effects()
    friction = rubbing.with_effects(instance("coulomb_friction", torque=0.1))
    gain, loss = friction.over(nominal.fit), nominal.over(friction.fit)
    assert gain.clear
    assert not loss.clear
    assert gain.nats == pytest.approx(-loss.nats)
    assert gain.error == pytest.approx(loss.error)
    assert (-loss).nats == pytest.approx(gain.nats)
    assert gain.nats <= 1.001 * nominal.room.nats or gain.error > 0.0


def test_every_number_of_an_effect_that_is_something_is_a_parameter():
    wave = instance("cogging_torque", amplitude=0.1, per_revolution=12.0, phase=0.7)
    spring = instance("joint_spring", stiffness=0.1, rest_angle=0.002)
    columns = 100.0 * np.eye(8)[:, :4]  # an amount is known to a hundredth
    fitted = Fit(effects=(wave, spring), jacobian=columns, residual=np.ones(8))
    assert parameters_of([wave], fitted) == 3  # the number of periods was found among many
    assert parameters_of([spring], fitted) == 1  # rest is at zero, to within its error
    assert parameters_of([wave, spring], fitted) == 4


def test_derivatives_belong_to_the_effect_whose_amounts_they_are_by(rubbing):
    friction = instance("coulomb_friction", torque=0.1)
    spring = instance("joint_spring", stiffness=0.1, rest_angle=0.1)
    found = rubbing.with_effects(friction, spring).fit
    assert found.owners.tolist() == [0, 1, 1]
    assert rubbing.with_effects().fit.owners.tolist() == []


def test_what_is_missing_is_added_with_its_amount(rubbing):
    step = added(rubbing, *LAWS)
    (new,) = step.chosen.new
    assert step.move is Move.ADD
    assert new.effect.name == "coulomb_friction"
    assert new.values["torque"] == pytest.approx(FRICTION, rel=0.03)
    assert step.chosen.gain.clear
    assert step.before > 10.0 > step.chosen.fit.cost
    gains = [tried.gain.nats for tried in step.ranked]
    assert gains == sorted(gains, reverse=True)


def test_nothing_is_added_where_nothing_is_missing(right):
    assert added(right, *LAWS).chosen is None


def test_what_could_gain_nothing_clear_is_not_fitted(right, rubbing):
    told = []
    for case in (right, rubbing):
        add(case.with_effects(), case.search(*LAWS, report=told.append))
    fitted = [line for line in told if line.startswith("fitting")]
    assert fitted[0] == "fitting coulomb friction on j"
    assert len(told) - len(fitted) == 2  # both are screened, one alone lacks anything


def test_nothing_is_added_to_what_is_right_already(rubbing):
    friction = instance("coulomb_friction", torque=0.1)
    step = added(rubbing, *LAWS, before=(friction,))
    assert step.chosen is None
    assert all(tried.new[0].effect.name != "coulomb_friction" for tried in step.ranked)


def test_of_what_predicts_as_well_the_simplest_is_added(pulled):
    """A spring whose rest is far away pulls with the same torque everywhere."""
    step = added(pulled, "joint_spring", "torque_offset")
    assert step.chosen.new[0].effect.name == "torque_offset"
    assert step.chosen.new[0].values["torque"] == pytest.approx(OFFSET, rel=0.02)


def test_lags_on_all_joints_are_tried_in_the_place_of_late_commands(rubbing):
    here = rubbing.with_effects()
    lags = [
        replace(instance("actuator_lag", time_constant=0.01), joints=(joint,)) for joint in "jk"
    ]
    screened = [Screened(lag, Difference(100.0, 10.0)) for lag in lags]
    late = replace(instance("command_delay", delay=0.01), joints=("j", "k"))
    explained = rubbing.with_effects(instance("coulomb_friction", torque=0.1)).fit
    gain = Difference(1e4, 10.0)  # there is nothing left that could gain as much
    assert _together(here, screened, [Tried(new=(late,), fit=explained, gain=gain)]) == [
        tuple(lags)
    ]
    assert _together(here, screened, [Tried(new=(lags[0],), fit=explained, gain=gain)]) == []


def test_an_amount_that_is_none_or_has_no_end_is_never_the_best(rubbing):
    before = rubbing.with_effects()
    friction = rubbing.with_effects(instance("coulomb_friction", torque=0.1)).fit
    none, some = (
        Tried(new=(instance("coulomb_friction", torque=t),), fit=friction, gain=Difference(n, 1.0))
        for t, n in ((0.0, 90.0), (0.3, 50.0))
    )
    faint = replace(some, gain=Difference(1.0, 1.0))
    assert best_of(before, [none, some]) is some
    assert best_of(before, [none]) is None
    assert best_of(before, [faint]) is None


@pytest.mark.parametrize("asked", [1.5, 15.0])
def test_a_torque_limit_is_added_though_only_few_segments_reach_it(asked):
    """What is asked for is ten times, or a hundred times the limit."""
    time_s, recordings = np.arange(0.0, 18.0, PERIOD_S), []
    for seed in range(2):
        told = 0.15 * command(seed, 18.0)
        for dip in (5.0, 11.0):
            told[(time_s > dip + seed) & (time_s < dip + seed + 0.4)] += asked
        recordings.append(swung(told, seed=seed, noise=0.3 * NOISE, limit=LIMIT))
    case = Case(recordings)
    step = added(case, "torque_saturation", "coulomb_friction", "armature")
    best = step.ranked[0].new[0]
    assert best.effect.name == "torque_saturation"
    assert best.values["limit"] == pytest.approx(LIMIT, rel=0.01)


COMMON = ("command_delay", "actuator_gain", "coulomb_friction", "viscous_friction", "armature")


@pytest.fixture(scope="module")
def wrong_all_over():
    return Case(runs(torque=lambda _q, v: -LITTLE * np.tanh(v / 1e-3), delay=0.03, gain=0.15))


@pytest.mark.parametrize("known", [(), (instance("coulomb_friction", torque=0.05),)])
def test_common_errors_are_found_together_beside_what_is_known(wrong_all_over, known):
    before = wrong_all_over.with_effects(*known)
    nothing_yet = Step(move=Move.ADD, before=before.fit.cost)
    step = common_errors(before, wrong_all_over.search(*COMMON), nothing_yet)
    found = {e.effect.name: next(iter(e.values.values())) for e in step.chosen.fit.effects}
    assert found["command_delay"] == pytest.approx(0.03, rel=0.1)
    assert found["actuator_gain"] == pytest.approx(0.15, rel=0.05)
    assert found["coulomb_friction"] == pytest.approx(LITTLE, rel=0.05)
    assert {e.key for e in step.chosen.new}.isdisjoint(e.key for e in known)


@pytest.mark.parametrize("move", [Move.ADD, Move.MISSING_TORQUE])
def test_one_effect_that_gains_half_spares_common_errors_and_several_do_not(wrong_all_over, move):
    before = wrong_all_over.with_effects()
    new = instance("armature", inertia=1e-3), instance("payload", mass=1e-3)
    most = Difference(before.room.nats, 1.0)

    def proposed_beside(*effects, left=before.fit):
        tried = Tried(new=effects, fit=left, gain=most)
        best = Step(move=move, before=before.fit.cost, ranked=(tried,), chosen=tried)
        return common_errors(before, wrong_all_over.search(*COMMON), best)

    assert proposed_beside(new[0]) is None
    assert proposed_beside(*new).chosen is not None
    at_noise_level = replace(before.fit, residual=before.fit.residual / np.sqrt(before.fit.cost))
    assert proposed_beside(*new, left=at_noise_level) is None


@pytest.mark.parametrize("far_off", [True, False])
def test_far_off_common_errors_are_looked_for_however_much_was_explained(wrong_all_over, far_off):
    """Of a twentieth of the nominal misfit; what is in front gains next to nothing."""
    before = wrong_all_over.with_effects(instance("actuator_gain", scale=0.15))
    assert before.fit.cost > 2.0 * FAR_OFF
    size = 1.0 if far_off else np.sqrt(0.5 * FAR_OFF / before.fit.cost)
    left = replace(before.fit, residual=size * before.fit.residual)
    before = replace(before, fit=left, nominal=np.full(1, 20.0 * left.cost))
    slight = Tried(new=before.effects, fit=left, gain=Difference(1.0, 0.1))
    best = Step(move=Move.ADD, before=left.cost, ranked=(slight,), chosen=slight)
    told = []
    search = wrong_all_over.search(report=told.append)  # no candidates: there is nothing to fit
    common_errors(before, search, best)
    assert bool(told) == far_off


def test_near_what_was_measured_common_errors_are_not_looked_for_where_nothing_gains(right):
    before = right.with_effects()
    nothing = Step(move=Move.ADD, before=before.fit.cost)
    assert common_errors(before, right.search(*COMMON), nothing) is None


def test_what_an_effect_gains_is_clear_only_where_it_is_there(rubbing):
    friction, armature = (
        instance("coulomb_friction", torque=0.1),
        instance("armature", inertia=1e-3),
    )
    gains = {e.effect.name: g for g, e in gains_of_each(rubbing.with_effects(friction, armature))}
    assert gains["coulomb_friction"].clear
    assert not gains["armature"].clear
    assert gains_of_each(rubbing.with_effects()) == []


def test_what_says_nothing_is_removed_and_what_is_there_stays(rubbing):
    both = rubbing.with_effects(
        instance("armature", inertia=1e-3), instance("coulomb_friction", torque=0.1)
    )
    search = rubbing.search()
    after = remove(both, search)
    assert [e.effect.name for e in after.effects] == ["coulomb_friction"]
    assert [(s.move, s.replaced[0].effect.name) for s in search.steps] == [
        (Move.REMOVE, "armature")
    ]
    assert after.effects[0].values["torque"] == pytest.approx(FRICTION, rel=0.03)


def test_effects_that_say_nothing_are_removed_together_and_what_one_of_them_says_stays(rubbing):
    nothing = [
        instance("armature", inertia=1e-3),
        instance("joint_spring", stiffness=1e-3, rest_angle=0.0),
        instance("quadratic_drag", coefficient=1e-4),
    ]
    search = rubbing.search()
    after = remove(rubbing.with_effects(*nothing, instance("coulomb_friction", torque=0.1)), search)
    assert [e.effect.name for e in after.effects] == ["coulomb_friction"]
    first = search.steps[0]
    assert (first.move, len(first.replaced)) == (Move.REMOVE, 3)
    # Each of two equal halves is said by the other, and both together by none.
    halves = rubbing.with_effects(
        *nothing[:1],
        instance("coulomb_friction", torque=0.05),
        instance("stribeck_friction", static_excess=0.05, stribeck_velocity=4.5),
    )
    after = remove(halves, search)
    assert len(after.effects) == 1
    assert after.effects[0].effect.name != "armature"


def test_what_few_segments_judge_and_the_last_effect_are_not_removed(rubbing, right):
    armature = instance("armature", inertia=1e-3)
    both = rubbing.with_effects(armature, instance("coulomb_friction", torque=0.1))
    assert armature.key not in {e.key for e in remove(both, rubbing.search()).effects}
    tried = Tried(new=(armature,), fit=both.fit, gain=Difference(9.0, 1.0))
    few = Step(move=Move.INTERMITTENT, before=1.0, chosen=tried, segments=4)
    assert remove(both, rubbing.search(steps=[few])) is both
    alone = right.with_effects(armature)
    assert remove(alone, right.search()) is alone


def test_a_spring_makes_way_for_the_constant_torque_that_it_stands_for(pulled):
    spring, friction = (
        instance("joint_spring", stiffness=0.01, rest_angle=15.0),
        instance("viscous_friction", coefficient=1e-3),
    )
    here = pulled.with_effects(spring, friction)
    search = pulled.search("torque_offset")
    after, told = exchange(here, search)
    assert {e.effect.name for e in after.effects} == {"torque_offset", "viscous_friction"}
    (step,) = search.steps
    assert (step.move, step.replaced[0].effect.name) == (Move.EXCHANGE, "joint_spring")
    assert [one.instance.effect.name for one in told] == ["viscous_friction"]
    offset = next(e for e in after.effects if e.effect.name == "torque_offset")
    assert offset.values["torque"] == pytest.approx(OFFSET, rel=0.02)


def test_a_weaker_drive_and_a_spring_make_way_for_the_load_that_they_stand_for():
    def weight(q, _v):
        return -0.3 * 9.81 * LENGTH * np.sin(q)

    loaded = Case(runs(torque=weight, inertia=0.3 * LENGTH**2))
    both = loaded.with_effects(
        instance("actuator_gain", scale=0.7),
        instance("joint_spring", stiffness=0.1, rest_angle=0.0),
    )
    search = loaded.search("payload", "viscous_friction", "armature")
    after = merge(both, search)
    (payload,) = after.effects
    assert payload.effect.name == "payload"
    assert payload.values["mass"] == pytest.approx(0.3, rel=0.05)
    (step,) = search.steps
    assert step.move is Move.EXCHANGE
    assert {e.effect.name for e in step.replaced} == {"actuator_gain", "joint_spring"}


def test_two_effects_that_are_there_do_not_make_way_for_one():
    case = Case(runs(torque=lambda q, v: dry(q, v) + OFFSET))
    both = case.with_effects(
        instance("coulomb_friction", torque=0.1), instance("torque_offset", torque=0.1)
    )
    search = case.search("payload", "viscous_friction", "asymmetric_friction", "joint_spring")
    assert merge(both, search) is both
    assert search.steps == []


def test_what_says_the_same_far_from_the_noise_is_found_beside_what_comes_near_it():
    """Without the effect nearly everything is outlying by what it leaves."""
    tilt, weight = 0.3, MASS * 9.81 * LENGTH
    tilted = Case(runs(torque=lambda q, _v: weight * (np.sin(q) - np.sin(q + tilt))))
    here = tilted.with_effects(instance("torque_offset", torque=-0.08))
    here = replace(here, problem=here.problem.robust(here.effects))
    here = replace(here, fit=fit(here.problem, here.effects))
    rest = replace(here, fit=fit(here.problem, ()))
    search = tilted.search("encoder_offset", "payload", "viscous_friction", "armature")
    best = min(rivals_of(here.effects[0], rest, search), key=lambda one: one.cost)
    assert best.effects[0].effect.name == "encoder_offset"
    assert best.effects[0].values["offset"] == pytest.approx(-tilt, rel=0.05)


@pytest.mark.parametrize(
    ("more", "errors", "taken"),
    [
        (-1, -0.9, True),  # simpler, and as good to within one error
        (-1, -1.8, False),
        (0, 0.9, False),
        (0, 1.1, True),
        (1, 1.9, False),
        (1, 2.1, True),
    ],
)
def test_what_is_there_makes_way_by_one_error_and_for_more_parameters_by_two(
    rubbing, more, errors, taken
):
    there, other = instance("cogging_torque", amplitude=0.1), instance("torque_offset", torque=0.1)
    tried = Tried(new=(other,), fit=rubbing.with_effects().fit, gain=Difference(9.0 * errors, 9.0))
    assert Compared(instance=there, rival=tried, more=more).better == taken


def test_a_right_effect_stays_and_is_told_with_what_was_weighed_beside_it(rubbing):
    friction = rubbing.with_effects(instance("coulomb_friction", torque=0.1))
    before = rubbing.with_effects()
    tried = tuple(
        Tried(new=fitted.effects, fit=fitted, gain=-before.over(fitted))
        for fitted in (
            friction.fit,
            rubbing.with_effects(instance("viscous_friction", coefficient=0.1)).fit,
        )
    )
    step = Step(move=Move.ADD, before=before.fit.cost, ranked=tried, chosen=tried[0])
    search = rubbing.search("armature", steps=[step])
    after, told = exchange(friction, search)
    assert after is friction
    assert search.steps == [step]
    assert [one.rival.new[0].effect.name for one in told] == ["viscous_friction"]
    assert (-told[0].rival.gain).clear


def test_a_search_whose_time_is_over_keeps_what_it_has(rubbing):
    here, said = rubbing.with_effects(), []
    late = rubbing.search(
        "coulomb_friction",
        report=said.append,
        in_time=lambda: False,
        clock=rubbing.problem.clock,
    )
    assert run(here, late, [add]) is here
    assert late.steps == []
    assert said[-1] == "the time is over"
    rubbing.problem.residuals([()])  # nothing is bounded any more


@pytest.mark.parametrize("steps_are_over", [True, False])
def test_a_search_says_whether_more_time_might_have_led_elsewhere(rubbing, steps_are_over):
    here, asked = rubbing.with_effects(), []
    search = rubbing.search(goes_on=lambda: not (asked and steps_are_over))

    def nothing_gains(before, _search, _best):
        asked.append(before)

    run(here, search, [nothing_gains])
    assert here.is_open
    assert search.out_of_time is steps_are_over


@pytest.mark.parametrize("far_off", [True, False])
def test_far_off_a_step_that_was_not_compared_with_everything_is_not_taken(rubbing, far_off):
    """The time for steps is over while moves propose."""
    nominal, friction = rubbing.with_effects(), instance("coulomb_friction", torque=FRICTION)
    assert nominal.fit.cost > FAR_OFF
    size = 1.0 if far_off else np.sqrt(0.5 * FAR_OFF / nominal.fit.cost)
    here = replace(nominal, fit=replace(nominal.fit, residual=size * nominal.fit.residual))
    proposed = []

    def rub(before, _search, _best):
        proposed.append(before)
        return best_first(before, [beside(before, rubbing.with_effects(friction).fit)])

    search = rubbing.search(goes_on=lambda: not proposed)
    after = run(here, search, [rub])
    assert (after is here) == far_off
    assert [step.chosen is None for step in search.steps] == [far_off]
    assert search.ended_early == far_off


def test_an_effect_whose_rivals_were_not_weighed_stays_and_less_speaks_for_it(rubbing):
    here = rubbing.with_effects(instance("coulomb_friction", torque=0.1))

    def none_in_time(_instance, _rest, _search):
        raise OutOfTimeError

    search = rubbing.search()
    after, compared = exchange(here, search, none_in_time)
    assert after is here
    assert search.steps == []
    (evidence,) = support(here, search, compared).values()
    assert evidence.rival.errors == pytest.approx(UNWEIGHED * evidence.without.errors)


def test_what_can_do_more_than_an_effect_and_predicts_no_better_is_no_rival(rubbing):
    here = rubbing.with_effects(instance("coulomb_friction", torque=0.1))
    stribeck = instance("stribeck_friction", static_excess=0.1, stribeck_velocity=0.5)

    def richer(_instance, rest, _search):
        return [measured(rest.problem, (stribeck,))]

    def as_simple(_instance, rest, _search):
        return [measured(rest.problem, (instance("viscous_friction", coefficient=0.05),))]

    for rivals, told in ((richer, None), (as_simple, "viscous_friction")):
        (compared,) = exchange(here, rubbing.search(), rivals)[1]
        rival = compared.rival
        assert (rival and rival.new[0].effect.name) == told


@pytest.mark.parametrize("lightness", [1.0, 0.98])
def test_a_tilt_in_the_plane_of_a_joint_is_its_encoders_offset_under_another_name(lightness):
    """Both are the same torque of the same motion; the tilt across the plane is none, or in doubt.

    Where the robot is a little lighter, that tilt says it, less clearly than its own error.
    """
    weight = MASS * 9.81 * LENGTH
    tilted = Case(runs(torque=lambda q, _v: weight * (np.sin(q) - lightness * np.sin(q + 0.1))))
    here = tilted.with_effects(instance("encoder_offset", offset=0.05))
    tilt = EffectInstance(
        effect=find_effect("gravity_direction"), joints=(), values={"tilt_x": 0.02, "tilt_y": 0.05}
    )

    def both(_instance, rest, _search):
        others = tilt, instance("viscous_friction", coefficient=0.05)
        return [rest.fitted((other,)) for other in others]

    (compared,) = exchange(here, tilted.search(), both)[1]
    (equal,) = compared.equals
    assert equal.effect.name == "gravity_direction"
    assert equal.values["tilt_x"] == 0.0
    assert compared.rival.new[0].effect.name == "viscous_friction"


def test_only_lookalikes_that_the_data_do_not_decide_between_are_named_together(rubbing):
    """A late command and a lag are known to be confused; late commands and a gain are not."""
    here = rubbing.with_effects(instance("coulomb_friction", torque=0.1))
    tried = partial(Tried, fit=here.fit)
    delay, lag = instance("command_delay", delay=0.01), instance("actuator_lag", time_constant=0.01)
    told = {
        (one, nats): _not_told_apart(delay, tried(new=(other,), gain=Difference(nats, 3.0)))
        for one, other in (("lag", lag), ("gain", instance("actuator_gain", scale=0.9)))
        for nats in (-7.0, -4.0, 2.0)
    }
    assert told == {
        ("lag", -7.0): False,
        ("lag", -4.0): True,
        ("lag", 2.0): True,
        ("gain", -7.0): False,
        ("gain", -4.0): False,
        ("gain", 2.0): False,
    }
    assert _not_told_apart(lag, tried(new=(delay,), gain=Difference(-2.0, 3.0)))
    assert _not_told_apart(
        delay, tried(new=(instance("actuator_gain", scale=0.9),), gain=Difference(-0.5, 0.9))
    )


def test_a_fit_that_stays_behind_begins_anew_with_what_the_missing_torque_tells(rubbing):
    behind = replace(
        rubbing.with_effects(),
        fit=measured(rubbing.problem, [instance("coulomb_friction", torque=0.02)]),
    )
    anew = begun_anew(behind, rubbing.search(torques=rubbing.torques))
    assert anew.effects[0].values["torque"] == pytest.approx(FRICTION, rel=0.01)
    assert begun_anew(behind, rubbing.search()) is behind  # nobody tells another beginning


def test_what_leaves_nothing_is_not_begun_anew(rubbing):
    here = rubbing.with_effects(instance("coulomb_friction", torque=0.3))
    assert begun_anew(here, rubbing.search(torques=rubbing.torques)) is here


def test_what_a_fit_leads_back_to_is_not_settled_anew(rubbing):
    """Damping for dry friction: much is left, and it has one end, wherever it begins."""
    here = rubbing.with_effects(instance("viscous_friction", coefficient=0.1))
    assert here.room.clear
    assert begun_anew(here, rubbing.search(torques=rubbing.torques, after=None)) is here


@pytest.mark.parametrize(("asked", "taken"), [(0.28, True), (0.1, False)])
def test_of_two_ends_that_predict_as_well_that_nearer_to_the_missing_torque_is_taken(
    rubbing, asked, taken
):
    here = replace(  # not fitted: it has an end elsewhere
        rubbing.with_effects(),
        fit=measured(rubbing.problem, [instance("coulomb_friction", torque=0.15)]),
    )
    other = (instance("coulomb_friction", torque=asked),)
    there = replace(here, fit=replace(here.fit, effects=other))
    search = rubbing.search(torques=rubbing.torques, after=lambda _here, _step: there)
    assert begun_anew(here, search) is (there if taken else here)


def test_laws_of_one_state_are_as_steady_as_they_are_together(rubbing):
    """Dry friction alone holds everywhere; as part of one law with a wrong one it is asked anew."""
    dry_one, wrong = (
        instance("coulomb_friction", torque=0.3),
        instance("viscous_friction", coefficient=0.2),
    )
    spring = instance("joint_spring", stiffness=1.0, rest_angle=0.0)
    problem, nominal = rubbing.problem, rubbing.nominal
    here = Hypothesis(
        problem=problem, fit=measured(problem, (dry_one, wrong, spring)), nominal=nominal
    )
    told = {key[0]: one for key, one in support(here, rubbing.search(), ()).items()}
    assert told["coulomb_friction"].apart == told["viscous_friction"].apart
    assert told["coulomb_friction"].bends == told["viscous_friction"].bends
    assert told["coulomb_friction"].apart != told["joint_spring"].apart


def test_an_amount_is_as_unsure_as_what_more_of_it_would_do():
    """Damping that nearly holds a joint does much; twice as much would do little more."""
    case = Case(runs(4, torque=lambda _q, v: -20.0 * v))
    damping = instance("viscous_friction", coefficient=20.0)
    here = case.with_effects(damping)
    with_it, without = case.problem.plain().residuals([here.effects, ()])
    own = np.array([True])
    of_all_it_does = apart(here.fit, case.problem.blocks, own, without - with_it)
    assert support(here, case.search(), ())[damping.key].apart > 2.0 * of_all_it_does > 0.0


def test_what_an_effect_does_is_told_by_its_amount_and_not_by_where_it_begins(pulled):
    """A spring whose rest is far away: moving that is another law, not more of the same."""
    spring = instance("joint_spring", stiffness=0.5, rest_angle=1.5)
    here = replace(pulled.with_effects(), fit=measured(pulled.problem, (spring,)))
    assert _does(here, (spring,), np.ones(1)) == pytest.approx(0.5 * here.fit.jacobian[:, 0])


def test_what_a_weaker_drive_does_is_what_is_missing_without_it(pulled):
    """No gain is none: its scale, as a number, would say that it does ten times as much."""
    gain = instance("actuator_gain", scale=0.9)
    here = replace(pulled.with_effects(), fit=measured(pulled.problem, (gain,)))
    with_it, without = pulled.problem.plain().residuals([here.effects, ()])
    assert _does(here, (gain,), np.ones(1)) == pytest.approx(without - with_it)


def bent(case, *effects):
    """How much of what effects leave each of them explains if its amount changes with the state."""
    told = support(case.with_effects(*effects), case.search(), ())
    return [told[one.key].bends for one in effects]


def test_laws_that_hold_leave_nothing_that_they_would_do_bent(rubbing):
    assert bent(rubbing, instance("coulomb_friction", torque=0.1)) == [pytest.approx(0.0, abs=0.05)]
    both = Case(runs(torque=lambda _q, v: dry(_q, v) - 0.2 * v))
    laws = instance("coulomb_friction", torque=0.1), instance("viscous_friction", coefficient=0.1)
    assert bent(both, *laws) == [pytest.approx(0.0, abs=0.05)] * 2


def test_laws_that_only_come_near_leave_what_they_would_do_bent():
    """Friction with the root of the speed under two names, and a spring that hardens under one."""
    root = Case(runs(torque=lambda _q, v: -0.4 * np.sign(v) * np.sqrt(np.abs(v))))
    laws = instance("coulomb_friction", torque=0.1), instance("viscous_friction", coefficient=0.1)
    assert min(bent(root, *laws)) > 0.3
    hard = Case(runs(torque=lambda q, _v: -3.0 * q**3))
    assert min(bent(hard, instance("joint_spring", stiffness=1.0, rest_angle=0.0))) > 0.5


def test_a_gain_leaves_what_a_drive_does_that_is_stronger_one_way():
    gain = instance("actuator_gain", scale=1.1)
    for truth, least, most in (({"uneven": 0.3}, 0.3, 1.0), ({"gain": 1.15}, 0.0, 0.05)):
        case = Case(runs(**truth))
        told = support(case.with_effects(gain), case.search(torques=case.torques), ())
        assert least <= told[gain.key].bends <= most


def nameless(case, *effects, **more):
    """The law without a name for which each of several effects stands."""
    told = support(case.with_effects(*effects), case.search("armature", **more), ())
    return [told[one.key].nameless for one in effects]


def test_a_law_without_a_name_speaks_against_the_two_that_stand_for_it():
    """A spring that hardens is a spring and a cogging torque of four per turn, nearly."""
    hard = Case(runs(torque=lambda q, _v: -12.0 * q**3))
    wave = instance("cogging_torque", amplitude=0.1, per_revolution=4.0, phase=0.0)
    spring = instance("joint_spring", stiffness=1.0, rest_angle=0.0)
    friction = instance("coulomb_friction", torque=0.01)
    first, second, other = nameless(hard, spring, wave, friction)
    assert first is second
    assert first.over.errors < -2.0
    assert (first.state, first.joint) == ("position", "j")
    assert other is None


def test_a_curve_that_no_bent_law_is_speaks_against_the_laws_that_stand_for_it():
    """A cable that is slack up to an angle: its kink is no polynomial of the angle."""
    cable = Case(runs(torque=lambda q, _v: -1.0 * np.maximum(q - 0.2, 0.0)))
    spring = instance("joint_spring", stiffness=0.3, rest_angle=0.0)
    wave = instance("cogging_torque", amplitude=0.05, per_revolution=4.0, phase=0.0)
    first, second = nameless(cable, spring, wave, torques=cable.torques)
    assert first is second
    assert first.over.errors < -2.0
    assert (first.state, first.joint) == ("position", "j")
    both = Case(runs(torque=lambda q, _v: -0.3 * q + 0.05 * np.sin(4.0 * q)))
    assert nameless(both, spring, wave, torques=both.torques) == [None, None]


def test_far_from_the_truth_a_lone_law_gives_way_to_one_that_leaves_next_to_nothing():
    """A spring that hardens, told as one that does not; and a real spring, not all that acts."""
    spring = instance("joint_spring", stiffness=5.0, rest_angle=0.0)
    hard = Case(runs(torque=lambda q, _v: -30.0 * q**3))
    assert hard.with_effects(spring).fit.cost > FAR_OFF
    (law,) = nameless(hard, spring)
    assert (law.state, law.joint) == ("position", "j")
    assert law.over.errors < -2.0
    rubbed = Case(runs(torque=lambda q, v: -5.0 * q - 1.0 * np.sign(v) * np.sqrt(np.abs(v))))
    assert rubbed.with_effects(spring).fit.cost > FAR_OFF
    assert nameless(rubbed, spring) == [None]


def test_what_says_nothing_beside_a_law_without_a_name_stands_for_it_too():
    """A constant torque, beside a curve that has it; dry friction says something of its own."""
    rubbed = Case(runs(torque=lambda q, v: dry(q, v) - np.maximum(q - 0.2, 0.0) - 0.3))
    ends = np.array([-0.6, 0.6])
    curve = CurveOfPosition(Motion(position=ends, velocity=ends, drive=ends))
    knots = np.linspace(-0.6, 0.6, KNOTS)
    amounts = {f"torque_{k}": -max(q - 0.2, 0.0) - 0.3 for k, q in enumerate(knots)}
    law = EffectInstance(effect=curve, joints=("j",), values=amounts)
    friction = instance("coulomb_friction", torque=FRICTION)
    offset = instance("torque_offset", torque=-0.4)
    here = rubbed.with_effects(friction, offset)
    best = here.fitted((friction, offset, law))
    assert [e.key[0] for e in _adding_nothing(here, best, here.effects)] == ["torque_offset"]


def test_two_laws_that_hold_are_told_although_one_of_them_bent_may_be_both(rubbing):
    both = Case(runs(torque=lambda _q, v: dry(_q, v) - 0.2 * v))
    laws = instance("coulomb_friction", torque=0.1), instance("viscous_friction", coefficient=0.1)
    assert nameless(both, *laws) == [None, None]
    assert nameless(rubbing, laws[0]) == [None]


def test_far_from_the_truth_a_curve_that_the_missing_torque_shows_speaks_against_a_name():
    """A cable that is slack up to an angle, taken for a limit of the drive; and a real limit."""
    cable = Case(runs(torque=lambda q, _v: -20.0 * np.maximum(q - 0.2, 0.0)))
    limit = instance("torque_saturation", limit=3.0)
    (law,) = nameless(cable, limit, torques=cable.torques)
    assert (law.state, law.joint) == ("position", "j")
    assert law.over.errors < -2.0
    weak = Case(runs(limit=LIMIT))
    assert nameless(weak, limit, torques=weak.torques) == [None]


def test_a_curve_is_nearly_all_of_the_missing_torque_where_a_name_is_no_part_of_it():
    """Of a cable that is told as a limit; not of a limit or a spring that are there."""
    cable = Case(runs(torque=lambda q, _v: -20.0 * np.maximum(q - 0.2, 0.0)))
    spring = Case(runs(torque=lambda q, _v: -5.0 * q))
    stiff = instance("joint_spring", stiffness=5.0, rest_angle=0.0)
    shares = []
    for case, one in (
        (cable, instance("torque_saturation", limit=5.0)),
        (Case(runs(limit=LIMIT)), instance("torque_saturation", limit=LIMIT)),
        (spring, stiff),
    ):
        here, (place, *_) = case.with_effects(one), case.search("armature").candidates
        shares.append(max(share for share, *_ in _shown(case.torques, place, STATES, here.effects)))
    assert shares[0] > ALIKE > 5.0 * max(shares[1:])


def shown(case, *before):
    """The step of the effects that the missing torque of a case shows."""
    names = (*LAWS, "joint_spring", "torque_offset", "stribeck_friction", "armature", "payload")
    names = (*names, "encoder_offset")
    return shown_of(case, *names, before=before)


def shown_of(case, *names, before=()):
    """The same, of some candidates."""
    here = case.with_effects(*before)
    step = missing_torque(here, case.search(*names, torques=case.torques))
    return step and fewest(here, step)


def told_by(step):
    return {one.effect.name: dict(one.values) for one in step.chosen.new}


def test_an_amount_that_ran_into_its_bound_is_no_step():
    """A drive that does nothing: any gain below the least one would do as well."""
    loose = Case(runs(gain=0.0))
    assert shown_of(loose, "actuator_gain").chosen is None


def test_effects_are_taken_together_as_the_missing_torque_shows_them():
    both = Case(runs(torque=lambda q, v: OFFSET + dry(q, v)))
    step = shown(both)
    assert step.move is Move.MISSING_TORQUE
    assert told_by(step) == {
        "torque_offset": {"torque": pytest.approx(OFFSET, rel=0.02)},
        "coulomb_friction": {"torque": pytest.approx(FRICTION, rel=0.02)},
    }
    assert step.chosen.fit.cost < 2.0
    assert shown(both, *step.chosen.new) is None  # nothing is missing any more


def test_the_missing_torque_shows_one_effect_alone_and_none_where_none_is_missing(rubbing, right):
    step = shown(rubbing)
    assert list(told_by(step)) == ["coulomb_friction"]
    assert shown(right) is None


def test_the_missing_torque_shows_what_is_no_law_of_position_and_speed():
    """Inertia: what it adds is the difference of two models' inverse dynamics."""
    heavy = Case(runs(inertia=0.05, torque=dry))
    told = told_by(shown(heavy))
    assert told["armature"]["inertia"] == pytest.approx(0.05, rel=0.03)
    assert told["coulomb_friction"]["torque"] == pytest.approx(FRICTION, rel=0.02)


@pytest.mark.parametrize(
    ("truth", "amount", "named", "parameter"),
    [("loss", 0.5, "drive_loss", "coefficient"), ("dead", 0.1, "drive_dead_zone", "torque")],
)
def test_the_missing_torque_shows_what_a_drive_does_not_give(truth, amount, named, parameter):
    case = Case(runs(**{truth: amount}))
    told = told_by(shown_of(case, "drive_loss", "drive_dead_zone", "actuator_gain"))
    assert told == {named: {parameter: pytest.approx(amount, rel=0.03)}}


def test_what_is_late_is_shown_with_what_acts_beside_it():
    """A delay, beside which dry friction is read off no worse; and such a friction alone."""
    late = told_by(shown(Case(runs(torque=dry, delay=0.03))))
    assert late["coulomb_friction"]["torque"] == pytest.approx(FRICTION, rel=0.03)
    assert late["command_delay"]["delay"] == pytest.approx(0.03, rel=0.02)


def test_what_the_motion_in_the_air_shows_is_proposed_too():
    """Elsewhere something pushes back, and stands for other effects."""

    def lacks(q, v):
        return OFFSET + dry(q, v)

    both = Case(runs(4, torque=lacks))
    pushed = torque_domain(both.problem, runs(4, torque=lambda q, v: lacks(q, v) + np.sin(7.0 * q)))
    names = ("coulomb_friction", "torque_offset", "viscous_friction", "joint_spring")
    elsewhere, there = (
        missing_torque(both.with_effects(), both.search(*names, torques=pushed, witness=witness))
        for witness in (None, both.torques)
    )
    assert elsewhere is None or elsewhere.chosen.fit.cost > 10.0
    assert told_by(there) == {
        "torque_offset": {"torque": pytest.approx(OFFSET, rel=0.02)},
        "coulomb_friction": {"torque": pytest.approx(FRICTION, rel=0.02)},
    }


def test_rollouts_say_how_many_of_the_effects_that_are_shown_there_are(rubbing):
    friction = instance("coulomb_friction", torque=FRICTION)
    beside = instance("torque_offset", torque=1e-4)
    far = instance("torque_offset", torque=0.5)
    there = rubbing.with_effects()
    assert borne_out(there, [[friction], [friction, beside]]) == [friction]
    assert borne_out(there, [[far], [friction, beside]]) == [friction, beside]
    assert borne_out(there, [[far]]) == ()
    assert borne_out(there, []) == ()


def test_what_takes_long_to_simulate_rivals_what_adds_nearly_the_same_torque():
    """A weak drive, and one that loses torque where it gives much; a dead zone is another."""
    weak, gain = Case(runs(gain=0.8)), instance("actuator_gain", scale=0.8)
    search = weak.search("drive_loss", "drive_dead_zone", torques=weak.torques)
    rivals = rivals_of(gain, weak.with_effects(), search)
    assert [fitted.effects[-1].effect.name for fitted in rivals] == ["drive_loss"]
    assert rivals_of(gain, weak.with_effects(), replace(search, torques=None)) == []


def test_an_effect_without_a_torque_of_its_own_does_not_bend(right):
    assert bent(right, instance("armature", inertia=0.01)) == [0.0]


def test_a_motor_apart_from_its_link_rivals_an_effect_beside_what_its_step_weighed(rubbing):
    """Its spring gives way under a load, as a weak drive does; no step weighs the two together."""
    search = rubbing.search("coulomb_friction", "viscous_friction", "joint_elasticity")
    step = add(rubbing.with_effects(), search)
    search.steps.append(step)
    (friction,) = step.chosen.new
    rivals = rivals_of(friction, rubbing.with_effects(), search)
    names = [one.effects[-1].effect.name for one in rivals]
    assert names == ["viscous_friction", "joint_elasticity"]


def test_a_motor_that_is_apart_already_is_no_rival(rubbing):
    names = ("coulomb_friction", "joint_elasticity", "backlash")
    search, friction = rubbing.search(*names), instance("coulomb_friction", torque=0.1)
    spring = instance("joint_elasticity", stiffness=100.0)
    tried = [beside(rubbing.with_effects(), measured(rubbing.problem, [friction]))]
    play = Tried(new=(instance("backlash", gap=0.01),), fit=tried[0].fit, gain=tried[0].gain)
    search.steps.append(Step(move=Move.ADD, before=9.0, ranked=(tried[0], play), chosen=tried[0]))
    rest = replace(rubbing.with_effects(), fit=measured(rubbing.problem, [spring]))
    assert rivals_of(friction, rest, search) == []


@pytest.fixture(scope="module")
def sticking():
    """Dry friction, and a peak of it at low speed."""
    return Case(runs(torque=lambda q, v: dry(q, v) * (1.0 + 2.0 * np.exp(-((v / 0.1) ** 2)))))


def test_a_peak_of_friction_begins_also_where_rollouts_leave_least(sticking):
    level = instance("coulomb_friction", torque=FRICTION)
    far = instance("stribeck_friction", static_excess=4.0 * FRICTION, stribeck_velocity=0.05)
    as_it_is, from_grid = _beginnings(sticking.with_effects(), (level, far))
    assert as_it_is == (level, far)
    assert from_grid[0] == level
    assert from_grid[1].values == {
        "static_excess": pytest.approx(2.0 * FRICTION),
        "stribeck_velocity": pytest.approx(0.1),
    }
    assert _beginnings(sticking.with_effects(), (level,)) == [(level,)]


def test_amounts_outside_their_bounds_are_no_beginning(sticking):
    fast = instance("stribeck_friction", static_excess=0.1, stribeck_velocity=5.0)
    _, (begun,) = _beginnings(sticking.with_effects(), (fast,))
    assert begun.values["stribeck_velocity"] <= 5.0


def peaks_beside(case, before, *amounts):
    """What is tried together with the level above which it comes."""
    peaks = [
        instance("stribeck_friction", static_excess=one, stribeck_velocity=speed)
        for one, speed in amounts
    ]
    tried = [beside(before, before.fitted((*before.effects, one))) for one in peaks]
    screened = [Screened(one, Difference(9.0, 1.0)) for one in peaks]
    search = case.search("coulomb_friction", torques=case.torques)
    return [
        (tried, _above_their_level(before, one, screened, tried))
        for one in (search, replace(search, torques=None))
    ]


def test_a_peak_of_friction_that_stands_for_all_of_it_is_tried_above_its_level(sticking):
    told, guessed = peaks_beside(sticking, sticking.with_effects(), (0.4, 0.2))
    (alone,), ((level, peak),) = guessed
    assert level.key == ("coulomb_friction", ("j",))
    assert level.values["torque"] == alone.new[0].values["static_excess"]
    assert peak.values == {"static_excess": 0.4, "stribeck_velocity": 0.2}
    _, ((level, peak),) = told  # by the missing torque
    assert level.values["torque"] == pytest.approx(FRICTION, rel=0.1)
    assert peak.values["stribeck_velocity"] == 0.2
    found = sticking.with_effects(*_beginnings(sticking.with_effects(), (level, peak))[1])
    both = {one.effect.name: one.values for one in found.effects}
    assert both["coulomb_friction"]["torque"] == pytest.approx(FRICTION, rel=0.1)
    assert both["stribeck_friction"]["static_excess"] == pytest.approx(2.0 * FRICTION, rel=0.2)


def test_a_peak_above_a_level_that_is_there_is_tried_alone(sticking):
    level = instance("coulomb_friction", torque=FRICTION)
    weak = instance("stribeck_friction", static_excess=0.4, stribeck_velocity=0.1)
    fits = [measured(sticking.problem, effects) for effects in ((level,), (level, weak))]
    before = Hypothesis(problem=sticking.problem, fit=fits[0], nominal=sticking.nominal)
    tried = beside(before, fits[1])
    assert best_of(before, [tried]) is tried
    assert worth_more(before, tried)
    search = sticking.search("coulomb_friction", torques=sticking.torques)
    screened = [Screened(weak, Difference(9.0, 1.0))]
    assert _above_their_level(before, search, screened, [tried]) == []
