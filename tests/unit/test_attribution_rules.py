"""The rules by which effects are accepted, each on the smallest case that shows it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.diagnosis.data.signals import starts_at_rest
from gfm.diagnosis.former import attribution
from gfm.diagnosis.former.adequate import ADEQUATE, is_enough
from gfm.diagnosis.former.attribution import (
    Attribution,
    InStretches,
    Round,
    attribute,
    by_torque,
    not_judged,
    price,
    worth_it,
)
from gfm.diagnosis.inference import fitting
from gfm.diagnosis.inference.fitting import Fit, acting, along_valley, at_bound, nothing
from gfm.diagnosis.output.claims import WRONG_ALIKE, clearness, named_effects
from gfm.diagnosis.output.result import ErrorSummary
from gfm.diagnosis.residuals.problem import Problem, with_state_basis
from gfm.diagnosis.search.candidates import places
from gfm.diagnosis.search.screening import Screened, screen, shortlist
from gfm.effects import effect_library
from gfm.effects.plugins import USUAL_SCALES
from gfm.sim.segment import Prediction
from one_joint import TIME_S, fitted, instance, problem


class Predicted(Problem):
    """A problem whose model predicts zero for everything."""

    def predictions(self, candidates):
        zero = np.zeros_like(self.segments[0].position)
        one = Prediction(position=zero, effort=zero, diverged=False)
        return [[one] for _ in candidates]


def zero_model(position, outlying_from=None):
    plain = problem(position, outlying_from)
    return Predicted(**{name: getattr(plain, name) for name in plain.__dataclass_fields__})


def test_limits_follow_what_a_typical_stretch_shows_and_never_cut_into_noise():
    loud, quiet = np.full((len(TIME_S), 1), 5.0), np.full((len(TIME_S), 1), 1e-3)
    assert zero_model(loud).robust(()).outlying_from[0, 0] == pytest.approx(3.0 * 10.0)
    assert zero_model(quiet).robust(()).outlying_from[0, 0] == pytest.approx(3.0)


def test_an_initial_state_that_changes_nothing_explains_nothing():
    """As where simulations run away: all of them are cut off at the same size."""
    basis = with_state_basis(zero_model(np.ones((len(TIME_S), 1)))).state_basis[0]
    assert basis.shape == (len(TIME_S), 0)


def test_a_joint_rests_where_its_slope_is_noise():
    noise = 1e-4
    still = noise * np.random.default_rng(0).standard_normal(len(TIME_S))
    moving = still + 0.01 * TIME_S
    resting = starts_at_rest(TIME_S, np.stack([still, moving], axis=1), np.full(2, noise))
    assert resting.tolist() == [True, False]


@pytest.mark.parametrize(
    ("excess", "speed", "expected"), [(0.5, 0.05, False), (0.5, 5.0, True), (0.0, 0.05, True)]
)
def test_a_value_at_its_bound_has_not_been_found(excess, speed, expected):
    stribeck = instance("stribeck_friction", static_excess=excess, stribeck_velocity=speed)
    assert at_bound(stribeck) is expected


@pytest.mark.parametrize("beside", ["command_delay", "viscous_friction"])
def test_what_is_easily_taken_for_another_is_tried_without_however_much_it_seems_to_explain(
    monkeypatch, beside
):
    """To first order neither delay nor lag can do without the other."""
    lag, other = instance("actuator_lag", time_constant=0.01), effect_library()[beside]
    other = replace(lag, effect=other, values={other.parameters[0].name: 0.01})
    monkeypatch.setattr(
        attribution, "_without_one", lambda _p, effects: [(100.0, e) for e in effects]
    )
    monkeypatch.setattr(attribution, "fit", lambda _p, effects, **_: fitted(1.0, *effects))
    monkeypatch.setattr(attribution, "_costs", lambda _p, _e: np.ones(2))
    before = fitted(1.0, lag, other)
    after = attribution.without_superfluous(zero_model(np.zeros((len(TIME_S), 1))), before)
    assert len(after.effects) == (1 if beside == "command_delay" else 2)


@pytest.mark.parametrize(
    ("beside", "nominal", "stays"),
    [
        ("load_dependent_friction", 10_001.0, False),
        ("load_dependent_friction", 101.0, True),
        ("viscous_friction", 10_001.0, True),
    ],
)
def test_what_makes_up_for_the_inexactness_of_another_law_is_superfluous(
    monkeypatch, beside, nominal, stays
):
    first = instance("coulomb_friction", torque=0.1)
    other = instance(beside, coefficient=0.1)
    costs = {1: 5.0, 2: 1.0}  # of one effect, of both
    monkeypatch.setattr(
        attribution, "_without_one", lambda _p, e: [(5.0, e[0])] if len(e) == 2 else []
    )
    monkeypatch.setattr(attribution, "fit", lambda _p, effects, **_: fitted(1.0, *effects))
    monkeypatch.setattr(attribution, "_costs", lambda _p, e: np.full(2, costs[len(e)]))
    after = attribution.without_superfluous(
        zero_model(np.zeros((len(TIME_S), 1))),
        fitted(1.0, first, other),
        at_first=np.full(2, nominal),
    )
    assert (first in after.effects) is stays


@pytest.mark.parametrize(("lag_s", "expected"), [(5e-5, True), (5e-4, False)])
def test_a_lag_shorter_than_any_stamp_is_exact_has_not_been_found(lag_s, expected):
    assert at_bound(instance("actuator_lag", time_constant=lag_s)) is expected


def test_an_effect_of_which_a_fit_left_nothing_is_not_named():
    none, some = (instance("coulomb_friction", torque=t) for t in (0.0, 1e-4))
    less = instance("viscous_friction", coefficient=-0.1)  # taken off what the model has
    short = instance("command_delay", delay=1e-5)  # than any stamp is exact
    assert acting([none, some, less, short]) == (some, less)


def test_more_parameters_must_explain_more():
    coulomb = fitted(96.0, instance("coulomb_friction", torque=0.1))
    payload = fitted(90.0, instance("payload", mass=1.0, com_x=0.0, com_y=0.0, com_z=0.1))
    assert price(payload) == pytest.approx(4 * price(coulomb))
    here = zero_model(np.zeros((len(TIME_S), 1)))
    assert worth_it(here, coulomb, fitted(100.0))
    assert not worth_it(here, payload, fitted(100.0))


def test_what_only_lies_between_noise_and_what_is_adequate_is_not_named():
    """A time step that differs from a robot's does as much."""
    here, gain = zero_model(np.zeros((len(TIME_S), 1))), instance("actuator_gain", scale=1.004)
    assert not worth_it(here, fitted(1.0, gain), fitted(1.5))
    assert worth_it(here, fitted(1.0, gain), fitted(1.6))


def test_what_takes_less_than_its_noise_off_a_joint_is_not_claimed():
    """However clearly it explains that: a time step that differs from a robot's does as much."""
    friction = instance("coulomb_friction", torque=0.1)
    gain = replace(instance("actuator_gain", scale=1.1), joints=("other",))
    rest, both = fitted(2.0, friction), fitted(1.2, friction, gain)
    both = replace(both, jacobian=np.eye(len(TIME_S))[:, :2])
    rounds = [
        Round(before=before, screened=(), fits=(fit,), accepted=fit)
        for before, fit in ((100.0, rest), (2.0, both))
    ]
    found = Attribution(nominal_cost=100.0, fit=both, rounds=tuple(rounds))
    by_joint = {
        "joint": ErrorSummary(before=10.0, after=1.1, noise_floor=1.0),
        "other": ErrorSummary(before=1.3, after=1.1, noise_floor=1.0),
    }
    overall = ErrorSummary(before=7.0, after=1.1, noise_floor=1.0)
    blocks = [slice(0, 20), slice(20, 40)]
    sure, unsure = named_effects(blocks, found, both.effects, overall, by_joint)
    assert (sure.effect, unsure.effect) == ("coulomb_friction", "actuator_gain")
    assert sure.confidence == 0.99
    assert unsure.confidence < 0.5
    louder = by_joint | {"other": replace(by_joint["other"], before=1.6)}
    assert named_effects(blocks, found, both.effects, overall, louder)[1].confidence == 0.99


def test_the_spread_of_a_model_that_stays_wrong_is_wider_than_an_interval():
    one = fitted(1.0, instance("coulomb_friction", torque=0.5))
    one = replace(one, jacobian=np.ones((len(TIME_S), 1)))
    this = Round(before=9.0, screened=(), fits=(one,), accepted=one)
    found, blocks = Attribution(nominal_cost=9.0, fit=one, rounds=(this,)), [slice(0, len(TIME_S))]
    right, wrong = (
        named_effects(
            blocks, found, one.effects, ErrorSummary(before=20.0, after=left, noise_floor=1.0)
        )[0].parameters["torque"]
        for left in (1.1, 5.0)
    )
    assert right.spread is None
    assert wrong.ci95 is None
    assert wrong.spread == pytest.approx(WRONG_ALIKE * (right.ci95[1] - right.value))


@pytest.mark.parametrize(("laws", "sure"), [(2, True), (3, False)])
def test_a_third_law_on_a_joint_is_claimed_only_where_noise_is_left(laws, sure):
    effects = (
        instance("coulomb_friction", torque=0.1),
        instance("joint_spring", stiffness=0.1, rest_angle=0.0),
        instance("encoder_offset", offset=0.1),
    )[:laws]
    fits = [fitted(10.0**-i, *effects[: i + 1]) for i in range(laws)]
    found = Attribution(
        nominal_cost=10.0,
        fit=replace(fits[-1], jacobian=np.eye(len(TIME_S), 4)[:, : laws + (laws > 1)]),
        rounds=tuple(
            Round(before=10.0 * one.cost, screened=(), fits=(one,), accepted=one) for one in fits
        ),
    )
    error = ErrorSummary(before=80.0, after=4.2, noise_floor=1.0)
    names = named_effects([slice(0, 20), slice(20, 40)], found, effects, error, {"joint": error})
    assert all((one.confidence > 0.5) is sure for one in names)


@pytest.mark.parametrize(("damping", "sure"), [(0.4, True), (30.0, False)])
def test_what_changes_slightly_what_a_model_says_of_a_joint_is_not_claimed(damping, sure):
    one = fitted(1.0, instance("viscous_friction", coefficient=0.5))
    one = replace(one, jacobian=np.ones((len(TIME_S), 1)))
    found = Attribution(
        nominal_cost=9.0,
        fit=one,
        rounds=(Round(before=9.0, screened=(), fits=(one,), accepted=one),),
    )
    error = ErrorSummary(before=3.0, after=1.0, noise_floor=1.0)
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_joint(name="joint").damping[0] = damping
    blocks = [slice(0, 20), slice(20, 40)]
    (named,) = named_effects(blocks, found, one.effects, error, {"joint": error}, [spec])
    assert (named.confidence > 0.9) is sure


def test_every_order_of_a_cogging_torque_is_fitted():
    orders = [
        Screened(
            instance=instance("cogging_torque", amplitude=1.0, per_revolution=order, phase=0.0),
            gain=gain,
        )
        for order, gain in ((23.0, 0.9), (24.0, 0.8), (25.0, 0.7))
    ]
    assert shortlist(orders) == orders


def test_a_phase_is_told_within_half_a_turn():
    cogging = effect_library()["cogging_torque"]
    told = cogging.canonical({"amplitude": 1.0, "per_revolution": 24.0, "phase": -3.58})
    assert told["phase"] == pytest.approx(2.0 * np.pi - 3.58)


def test_a_runner_up_counts_by_what_it_leaves_where_the_best_leaves_noise():
    best = fitted(1.0, instance("command_delay", delay=0.01))
    other = fitted(2.0, instance("actuator_lag", time_constant=0.01))
    assert clearness([best, other], 2000.0, adequate=True) == pytest.approx(0.99)
    assert clearness([best, other], 2000.0, adequate=False) < 0.6
    assert clearness([best, fitted(1.0, *other.effects)], 2000.0, adequate=True) == 0.5


def test_what_needs_more_parameters_is_no_rival():
    best = fitted(1.0, instance("torque_offset", torque=0.1))
    spring = fitted(1.0, instance("joint_spring", stiffness=0.1, rest_angle=9.0))
    assert clearness([best, spring], 2000.0, adequate=True) == 0.99


def test_what_looks_weak_where_friction_holds_begins_stronger():
    stribeck = effect_library()["stribeck_friction"]
    probe = {"static_excess": 0.1, "stribeck_velocity": 0.05}
    assert stribeck.combine([probe], [1.0])["static_excess"] > 0.1


class Told:
    """Stretches that tell of an effect when they are looked into for the first time."""

    def __init__(self, effect):
        self.effect, self.looked_beside = effect, []

    def __call__(self, problem, beside):
        self.looked_beside.append([e.effect.name for e in beside.effects])
        if len(self.looked_beside) > 1:
            return InStretches(problem=problem, fit=beside)
        both = replace(beside, effects=(*beside.effects, self.effect))
        this = Round(before=200.0, screened=(), fits=(both,), accepted=both, stretches=4)
        return InStretches(problem=problem, fit=both, rounds=(this,), stretches=(problem,))


def test_stretches_are_looked_into_once_and_what_they_tell_of_stays():
    off = zero_model(np.full((40, 1), 5.0))
    table = instance("surface_contact", height=0.0, x=0.0, y=0.0, z=0.0, friction=0.3)
    told = Told(table)
    found = attribute(off, (), (), in_stretches=told)
    assert told.looked_beside == [[]]
    assert found.fit.effects == (table,)
    assert [(this.stretches, this.accepted is None) for this in found.rounds] == [
        (4, False),
        (0, True),
    ]
    assert len(found.stretches) == 1


def test_a_search_goes_on_from_what_was_found_in_other_stretches():
    off = zero_model(np.full((40, 1), 5.0))
    offset = instance("torque_offset", torque=0.1)
    start = nothing(off.robust(()))
    won = replace(start, effects=(offset,), jacobian=np.zeros((len(start.residual), 1)))
    this = Round(before=200.0, screened=(), fits=(won,), accepted=won)
    found = attribute(off, (), (), begun=Attribution(nominal_cost=200.0, fit=won, rounds=(this,)))
    assert found.fit.effects == (offset,)
    assert found.nominal_cost == 200.0
    assert found.rounds[0] is this
    assert [one.accepted is None for one in found.rounds] == [False, True]


def test_quiet_joints_do_not_hide_what_another_one_misses():
    two = replace(zero_model(np.zeros((40, 1))), joints=("quiet", "loud"))
    residual = np.tile([0.2, 1.48], 50)
    left = Fit(
        effects=(), cost=float(np.mean(residual**2)), jacobian=np.zeros((100, 0)), residual=residual
    )
    assert left.cost < ADEQUATE
    assert not is_enough(two, left)
    assert is_enough(two, replace(left, residual=np.tile([1.0, 1.05], 50)))


def test_close_calls_are_decided_by_the_torque_where_much_is_left():
    offset = instance("torque_offset", torque=0.1)
    armature = instance("armature", inertia=0.1)
    drag = instance("quadratic_drag", coefficient=0.1)
    shares = {"torque_offset": 0.0, "armature": 0.6, "quadratic_drag": 0.9}

    def order(*costs):
        fits = [fitted(c, e) for c, e in zip(costs, (offset, armature, drag), strict=True)]
        ranked = by_torque(fits, lambda f: shares[f.effects[-1].effect.name])
        return [f.effects[-1].effect.name for f in ranked]

    assert order(1000.0, 1150.0, 1300.0) == ["armature", "torque_offset", "quadratic_drag"]
    assert order(50.0, 52.0, 60.0) == ["torque_offset", "armature", "quadratic_drag"]
    assert by_torque([], lambda _: 0.0) == []


def test_amounts_are_begun_from_both_sides_of_their_valley(monkeypatch):
    """A landscape with a second minimum along the direction that is hardly determined."""
    dry, viscous = (
        instance("coulomb_friction", torque=1.0),
        instance("viscous_friction", coefficient=2.0),
    )
    begun = []

    def fit(_, effects):
        torque, coefficient = (next(iter(e.values.values())) for e in effects)
        begun.append((torque, coefficient))
        return replace(start, effects=effects, cost=5.0 if torque > 1.5 else 6.0)

    # More of the one for less of the other, by equal shares, changes a hundredth of the rest.
    jacobian = np.array([[1.0, 0.5], [0.01, -0.005]])
    start = Fit(effects=(dry, viscous), cost=6.0, jacobian=jacobian, residual=np.zeros(2))
    monkeypatch.setattr(fitting, "fit", fit)
    best = along_valley(zero_model(np.zeros((len(TIME_S), 1))), start)
    assert sorted(begun[:2]) == [pytest.approx((0.5, 4.0)), pytest.approx((2.0, 1.0))]
    assert best.cost == 5.0
    assert best.effects[0].values["torque"] == pytest.approx(2.0)
    assert len(begun) == 4  # from the better one again, on both sides, in vain


class Sticking(Predicted):
    """Dry friction changes the residual sideways at first; what is missing sticks, and is right."""

    def residuals(self, candidates):
        missing, sideways = np.zeros((2, len(TIME_S)))
        missing[0], sideways[1] = 1.0, 1.0
        rows = {0.0: missing, 0.5 * USUAL_SCALES.excess_nm: 0.7 * missing + 0.9 * sideways}
        torques = [sum(e.values["torque"] for e in effects) for effects in candidates]
        return np.stack([rows.get(torque, 0.2 * missing) for torque in torques])


def test_what_first_order_misjudges_is_screened_by_what_it_explains_where_it_is_put_in():
    plain = zero_model(np.zeros((len(TIME_S), 1)))
    sticking = Sticking(**{name: getattr(plain, name) for name in plain.__dataclass_fields__})
    base = nothing(sticking)
    (place,) = places(effect_library()["coulomb_friction"], ("joint",))
    (found,) = screen(sticking, [place], [USUAL_SCALES], base)
    assert found.gain == pytest.approx(1.0 - 0.2**2)  # to first order, 0.3^2 / (0.3^2 + 0.9^2)


def test_what_few_stretches_told_of_is_judged_like_all_else_where_nothing_is_left():
    drag = instance("quadratic_drag", coefficient=0.1)
    won = replace(fitted(50.0, drag), residual=np.full(40, 7.0))
    rounds = [Round(before=200.0, screened=(), fits=(won,), accepted=won, stretches=4)]
    one = problem(np.zeros((40, 1)))
    assert not_judged(one, won, 200.0, rounds) == [drag.key]
    assert not_judged(one, replace(won, residual=np.ones(40)), 200.0, rounds) == []
    common = [replace(rounds[0], stretches=0)]
    assert not_judged(one, won, 200.0, common) == []
