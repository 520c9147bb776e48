"""The evidence chain, on a pendulum that SciPy integrates and on made-up numbers."""

import re
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.evidence.adequacy import energy_by, slow_share
from gfm.diagnosis.evidence.domains import Agreement, two_domains
from gfm.diagnosis.evidence.links import evidence_chain
from gfm.diagnosis.evidence.searched import confusable_sets, stopping
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.output.claims import SPREAD_WIDTH, SPREADS_ASKED, SPREADS_HELD
from gfm.diagnosis.search.trace import Evidence, Move, SearchResult, Step, Tried
from gfm.effects import EffectInstance, find_effect
from gfm.signals.energy import energy_balance
from gfm.signals.torque_domain import regressed, torque_domain
from one_joint import problem
from pendulum import MODEL, PERIOD_S, swung

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
NOISE, FRICTION = 1e-4, 0.3
RESULTS = Path(__file__).parents[2] / "docs" / "results"


def recording(seed=0, friction=0.0, inertia=0.0, duration=8.0):
    stamps = np.arange(0.0, duration, PERIOD_S)
    speeds, phases = np.random.default_rng(seed).uniform(1.0, 5.0, (2, 3))
    told = 0.3 * np.minimum(stamps, 1.0) * np.sin(np.outer(stamps, speeds) + phases).sum(axis=1)

    def torque(_q, v):
        return -friction * np.tanh(v / 1e-3)

    return swung(told, seed=seed, noise=NOISE, torque=torque, inertia=inertia)


def effect(name, joints=("j",), **values):
    return EffectInstance(effect=find_effect(name), joints=joints, values=values)


@pytest.fixture(scope="module")
def rubbing():
    return [recording(friction=FRICTION)]


def chain_of(runs, effects, found=None):
    problem = prepared(all_segments(SPECS, runs, windows_s=WHOLE))
    errors = (problem.position_errors(()), problem.position_errors(effects))
    return evidence_chain(problem, runs, found, effects, errors)


def domain_of(runs, specs=SPECS):
    return torque_domain(prepared(all_segments(specs, runs)), runs)


def fit_leaving(cost, *effects):
    return Fit(effects=effects, jacobian=np.zeros((1, 1)), residual=np.array([np.sqrt(cost)]))


def tried(instance, cost, base=(), gain=100.0, error=10.0):
    """A hypothesis that was weighed: an effect beside others, and what they leave."""
    return Tried(
        new=(instance,), fit=fit_leaving(cost, *base, instance), gain=Difference(gain, error)
    )


def step(before, *ranked, won=True, move=Move.ADD, replaced=()):
    chosen = ranked[0] if won else None
    return Step(move=move, before=before, ranked=ranked, chosen=chosen, replaced=replaced)


def found_in(*steps, effects=(), left=1.0, room=(0.0, 1.0), **more):
    """The trace of a search."""
    end = fit_leaving(left, *effects)
    return SearchResult(
        problem=problem(np.zeros((4, 1))), fit=end, room=Difference(*room), steps=steps, **more
    )


def test_the_share_of_a_slow_part_is_what_neighbours_have_in_common():
    rng = np.random.default_rng(0)
    white = rng.standard_normal(20000)
    slow = np.sqrt(2.0) * np.sin(np.linspace(0.0, 60.0, 20000))
    assert slow_share([white]) == pytest.approx(0.0, abs=0.02)
    assert slow_share([slow]) == pytest.approx(1.0, abs=1e-3)
    assert slow_share([white[:9000] + slow[:9000], white[9000:] + slow[9000:]]) == pytest.approx(
        0.5, abs=0.02
    )
    assert slow_share([np.zeros(5)]) == 0.0


def test_friction_that_a_model_lacks_goes_with_the_sign_of_the_velocity(rubbing):
    (row,) = chain_of(rubbing, [effect("coulomb_friction", torque=FRICTION)]).adequacy
    assert row.before.goes_with == "sign_of_velocity"
    assert row.before.correlations["sign_of_velocity"] < -0.9
    assert not row.before.adequate
    assert row.after.adequate
    assert row.words == "noise"


def test_the_missing_torque_tells_a_friction_from_an_inertia(rubbing):
    friction, inertia = effect("coulomb_friction", torque=0.2), effect("armature", inertia=0.01)
    found = found_in(step(100.0, tried(friction, 1.0), tried(inertia, 50.0)))
    named, other = two_domains(domain_of(rubbing), found, [friction])
    assert named.torque_share > 0.9
    assert other.torque_share < 0.1


def test_half_of_the_friction_leaves_the_other_half():
    half = [effect("coulomb_friction", torque=0.5 * FRICTION)]
    (row,) = chain_of([recording(friction=FRICTION)], half).adequacy
    assert row.after.goes_with == "sign_of_velocity"
    assert row.words.startswith("goes with the sign of the velocity (correlation -0.9")


def test_thirds_of_time_share_a_torque_that_does_not_care():
    signal = np.random.default_rng(0).standard_normal(3000)
    assert energy_by(np.ones(3000), signal) == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    assert energy_by(np.where(signal > 1.5, 1.0, 0.0), signal) == pytest.approx((0.0, 0.0, 1.0))
    assert energy_by(np.zeros(3000), signal) == (0.0, 0.0, 0.0)


def test_a_torque_at_high_angles_is_found_there(rubbing):
    spring = [effect("joint_spring", stiffness=2.0, rest_angle=-0.6)]
    (row,) = chain_of([recording()], spring).regions
    assert row.misfit_share == 0.0  # nothing is missing: it is not asked where
    assert row.words == ""
    (row,) = chain_of(rubbing, ()).regions
    assert row.misfit_share == row.misfit_share_after == 1.0


def test_energy_adds_up_with_the_friction_that_there_is(rubbing):
    domain = domain_of(rubbing)
    speed = np.abs(np.gradient(rubbing[0].position[:, 0], 0.01)).mean()
    told = energy_balance(domain, [effect("coulomb_friction", torque=FRICTION)])
    assert told.named[0].power_w == pytest.approx(FRICTION * speed, rel=0.05)
    assert told.missing_w == pytest.approx(told.named[0].power_w, rel=0.05)
    assert told.even


def test_energy_does_not_add_up_without_it_with_too_much_or_with_one_that_drives(rubbing):
    domain = domain_of(rubbing)
    assert not energy_balance(domain, ()).even
    assert not energy_balance(domain, [effect("coulomb_friction", torque=3.0 * FRICTION)]).even
    pushing = energy_balance(domain, [effect("coulomb_friction", torque=-0.001)])
    assert not pushing.named[0].possible


def test_a_friction_that_the_model_has_too_much_of_drives_nothing(rubbing):
    said = MODEL.replace('<joint name="j"', '<joint name="j" frictionloss="0.5"')
    domain = domain_of(rubbing, {CommandKind.POSITION: mujoco.MjSpec.from_string(said)})
    less = energy_balance(domain, [effect("coulomb_friction", torque=FRICTION - 0.5)])
    assert less.named[0].power_w < 0.0
    assert less.named[0].possible
    assert less.even
    driven = energy_balance(domain, [effect("coulomb_friction", torque=-0.6)])
    assert not driven.named[0].possible


def test_a_clean_robot_has_an_even_balance_and_stores_what_gravity_takes():
    told = energy_balance(domain_of([recording()]), ())
    assert told.even
    assert told.named == ()
    assert told.drive_w == pytest.approx(told.stored_w, abs=0.02 * told.through_w)


def test_what_an_effect_adds_is_its_law_or_what_it_changes_in_the_model(rubbing):
    domain = domain_of(rubbing)
    velocity = domain.signals["velocity"]
    damped = domain.response(effect("viscous_friction", coefficient=0.7))
    np.testing.assert_allclose(damped, -0.7 * velocity, atol=1e-12)
    # A heavier rotor needs more torque to speed up: -inertia times acceleration.
    heavier = domain.response(effect("armature", inertia=0.1))
    change = np.gradient(velocity[:, 0], 0.1)
    assert np.corrcoef(heavier[5:-5, 0], -change[5:-5])[0, 1] > 0.97
    assert not domain.response(effect("backlash", gap=0.1)).any()


def test_a_drive_that_was_switched_off_exerts_nothing(rubbing):
    off = replace(rubbing[0], servo_gain={"j": 0.0})
    assert not domain_of([off]).signals["drive"].any()
    half = replace(rubbing[0], servo_gain={"j": 0.5})
    assert domain_of([half]).signals["drive"].any()


def test_a_dense_recording_is_looked_at_over_its_whole_length(rubbing):
    stamps = np.arange(0.0, 8.0, 1e-3)
    stamp_ns = np.round(stamps * 1e9).astype(np.int64)
    position = 0.4 * np.sin(stamps)[:, None]
    dense = replace(rubbing[0], stamp_ns=stamp_ns, position=position)
    domain = domain_of([dense])
    assert len(domain.recordings[0].stamp_ns) == 800
    velocity = domain.signals["velocity"][:, 0]
    middles = 0.045 + 0.1 * np.arange(80)
    np.testing.assert_allclose(velocity[1:-1], 0.4 * np.cos(middles[1:-1]), atol=2e-3)


def test_a_regression_is_freed_of_what_stands_beside():
    one, other = np.eye(4)[0], np.eye(4)[0] + np.eye(4)[1]
    share, factor = regressed(2.0 * one + 3.0 * other, one, [other])
    assert factor == pytest.approx(2.0)
    assert share == pytest.approx(1.0)
    assert regressed(-one, one, []) == (1.0, -1.0)  # the wrong way round
    assert regressed(np.zeros(4), one, []) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("torque", "says"),
    [(FRICTION, Agreement.AGREES), (3.0 * FRICTION, Agreement.OTHER_AMOUNT)],
)
def test_the_missing_torque_is_a_second_witness_of_an_amount(rubbing, torque, says):
    named = effect("coulomb_friction", torque=torque)
    found = found_in(step(100.0, tried(named, 2.0)))
    (row,) = two_domains(domain_of(rubbing), found, [named])
    assert row.rollout_share == pytest.approx(0.98)
    assert row.torque_share > 0.8
    assert row.amount == pytest.approx(FRICTION / torque, rel=0.1)
    assert row.agreement is says


def test_the_missing_torque_can_prefer_a_rival(rubbing):
    wrong = effect("joint_spring", stiffness=0.2, rest_angle=1.0)
    right = effect("coulomb_friction", torque=FRICTION)
    found = found_in(step(100.0, tried(wrong, 2.0), tried(right, 3.0)))
    domain = domain_of(rubbing)
    row, rival = two_domains(domain, found, [wrong])
    assert rival.torque_share > row.torque_share
    assert not rival.named
    assert row.agreement in (Agreement.OTHER_EFFECT, Agreement.SILENT)
    viscous = effect("viscous_friction", coefficient=0.3)
    found = found_in(step(100.0, tried(viscous, 2.0), tried(right, 3.0)))
    row, _ = two_domains(domain, found, [viscous])
    assert row.agreement is Agreement.OTHER_EFFECT
    assert row.rival == "coulomb friction on j"


def test_the_missing_torque_is_silent_of_a_motor_apart_from_its_link(rubbing):
    named = effect("backlash", gap=0.01)
    found = found_in(step(100.0, tried(named, 2.0)))
    (row,) = two_domains(domain_of(rubbing), found, [named])
    assert row.agreement is Agreement.SILENT
    assert row.amount is None


def rivalled(named, rival, errors):
    """A search in the end of which a name predicts better than its rival by so many errors."""
    told = Evidence(
        without=Difference(50.0, 5.0),
        rival=Difference(5.0 * errors, 5.0),
        by=rival,
        apart=0.01,
        bends=0.1,
    )
    return found_in(effects=(named,), evidence={named.key: told})


@pytest.mark.parametrize(("errors", "equal"), [(-0.5, [True]), (1.5, [False]), (2.5, [])])
def test_a_rival_is_equal_close_or_none_by_its_standard_errors(errors, equal):
    offset = effect("torque_offset", torque=0.2)
    spring = effect("joint_spring", stiffness=0.1, rest_angle=2.0)
    (told,) = confusable_sets(rivalled(offset, spring, errors), [offset])
    assert [one.equal for one in told.alternatives] == equal
    assert all(one.effect == "joint_spring" and one.told_by for one in told.alternatives)


def test_the_other_name_of_a_law_is_its_equal_and_stands_first():
    offset, viscous = effect("torque_offset", torque=0.2), effect("viscous_friction", coefficient=1)
    twin = effect("asymmetric_friction", difference=-0.4)
    found = replace(rivalled(offset, viscous, 1.0), equals={offset.key: (twin,)})
    (told,) = confusable_sets(found, [offset])
    assert [one.effect for one in told.alternatives] == ["asymmetric_friction", "viscous_friction"]
    assert told.alternatives[0].errors == 0.0


OFFSET = effect("torque_offset", torque=0.2)


@pytest.mark.parametrize(
    ("found", "reason"),
    [
        (found_in(), "is not visible beside what a right model leaves"),
        (found_in(room=(9.0, 1.0), out_of_time=True), "its time was over"),
        (
            found_in(step(9.0, tried(OFFSET, 8.0, gain=1.0), won=False), room=(9.0, 1.0)),
            "no candidate predicts clearly better",
        ),
        (
            found_in(
                step(9.0, tried(effect("coulomb_friction", torque=0.0), 8.0), won=False),
                room=(9.0, 1.0),
            ),
            "coulomb friction on j predicts best, but its amount is none, or has no end",
        ),
    ],
)
def test_it_is_said_why_the_search_ended(found, reason):
    told = stopping(found)
    assert reason in told.reason
    assert len(told.steps) == len(found.steps)
    assert (told.room, told.room_error) == (found.room.nats, found.room.error)


def test_it_is_said_of_every_step_what_was_best_and_what_it_brought():
    viscous = effect("viscous_friction", coefficient=0.1)
    both = Tried(
        new=(OFFSET, viscous), fit=tried(viscous, 2.0, (OFFSET,)).fit, gain=Difference(70.0, 9.0)
    )
    rows = stopping(
        found_in(
            step(100.0, both, move=Move.COMMON_ERRORS),
            step(2.0, tried(viscous, 1.9, gain=1.0, error=4.0), won=False),
            step(2.0, move=Move.INTERMITTENT, won=False),
        )
    ).steps
    assert [row.best for row in rows] == ["2 effects together", "viscous friction on j", ""]
    assert [row.chosen for row in rows] == [True, False, False]
    assert [(row.gain, row.error) for row in rows] == [(70.0, 9.0), (1.0, 4.0), (0.0, 0.0)]


def test_it_is_said_what_was_taken_out_again_and_why():
    spring = effect("joint_spring", stiffness=0.1, rest_angle=0.0)
    viscous = effect("viscous_friction", coefficient=0.1)
    less = Tried(new=(viscous,), fit=tried(OFFSET, 3.0).fit, gain=Difference(-1.0, 2.0))
    steps = (
        step(9.0, tried(OFFSET, 3.0), move=Move.EXCHANGE, replaced=(spring,)),
        Step(move=Move.REMOVE, before=3.0, chosen=less, replaced=(viscous,)),
    )
    told = stopping(found_in(*steps, effects=(OFFSET,)))
    assert [row.replaced for row in told.steps] == ["joint spring on j", "viscous friction on j"]
    assert [row.best for row in told.steps] == ["torque offset on j", ""]
    assert told.taken_out == (
        "joint spring on j: torque offset on j predicts better, or as well and is simpler",
        "viscous friction on j: it predicts as well without",
    )
    assert stopping(found_in(*steps, effects=(OFFSET, spring, viscous))).taken_out == ()


def test_spreads_are_said_to_hold_as_often_as_was_recorded():
    page = (RESULTS / "spreads.md").read_text()
    rows = re.findall(r"\| (\d+) of (\d+) \|$", page, flags=re.MULTILINE)
    held, asked = np.sum([[int(n) for n in row] for row in rows], axis=0)
    assert (held, asked) == (SPREADS_HELD, SPREADS_ASKED)
    misses = re.findall(r"\| \**([\d.]+)\** \|$", page, flags=re.MULTILINE)
    assert sum(float(miss) <= SPREAD_WIDTH for miss in misses) == held
