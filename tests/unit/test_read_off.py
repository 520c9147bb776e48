"""Amounts read off the missing torque, where rollouts go where the robot never was."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.search.candidates import Place, joint_scales
from gfm.diagnosis.search.hypothesis import FAR_OFF, nominal_hypothesis
from gfm.diagnosis.search.moves.missing_torque import missing_torque
from gfm.diagnosis.search.read_off import basis_of, column, looks_like, read_off, told_together
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, find_effect
from gfm.signals.torque_domain import torque_domain, torque_views

INERTIA, DAMPING, PERIOD_S = 0.02, 0.15, 0.005
DISC = f"""
<mujoco>
  <worldbody><body>
    <joint name="j" axis="0 0 1" damping="{DAMPING}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
  </body></worldbody>
  <actuator><motor name="j" joint="j"/></actuator>
</mujoco>
"""
AMPLITUDE, ORDER, PHASE = 0.18, 20, -1.2


def wave(q):
    return AMPLITUDE * np.sin(ORDER * q + PHASE)


def instance(name, **values):
    return EffectInstance(effect=find_effect(name), joints=("j",), values=values)


def recorded(seed):
    """A disc between magnets, under torques, integrated here."""
    stamps = PERIOD_S * np.arange(800)
    speeds, phases = np.random.default_rng(seed).uniform(1.0, 6.0, (2, 4))
    command = 0.12 * np.sin(np.outer(stamps, speeds) + phases).sum(axis=1)

    def law(time_s, state):
        index = min(int(time_s / PERIOD_S + 1e-9), len(stamps) - 1)
        return [state[1], (command[index] + wave(state[0]) - DAMPING * state[1]) / INERTIA]

    answer = solve_ivp(
        law, (0.0, stamps[-1]), [0.0, 0.0], t_eval=stamps, max_step=PERIOD_S, rtol=1e-8
    )
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(len(stamps))
    nanoseconds = (1e9 * stamps).astype(np.int64)
    return Trajectory(
        name=f"run_{seed}",
        joint_names=("j",),
        stamp_ns=nanoseconds,
        position=(answer.y[0] + noise)[:, None],
        velocity=None,
        effort=None,
        command_kind=CommandKind.EFFORT,
        command_stamp_ns=nanoseconds,
        command=command[:, None],
    )


RUNS = [recorded(seed) for seed in range(3)]
PROBLEM = prepared(all_segments({CommandKind.EFFORT: mujoco.MjSpec.from_string(DISC)}, RUNS))
(SCALES,) = joint_scales(PROBLEM, torque_views(PROBLEM, RUNS))
TORQUES = torque_domain(PROBLEM, RUNS)
FRICTION = instance("coulomb_friction", torque=0.1)
MAGNETS = instance("cogging_torque", amplitude=AMPLITUDE, per_revolution=ORDER, phase=PHASE)


def place(name):
    return Place(effect=find_effect(name), joints=("j",), scales=SCALES)


def told(name, torque, known=()):
    """What is read off a torque beside what is known: values of the best group of probes."""
    basis = basis_of(TORQUES, known)
    shown = read_off(TORQUES, place(name), without(torque, basis), basis)
    best = max(shown, key=lambda one: one.share, default=None)
    return best and (dict(best.instance.values), best.share)


def test_amounts_of_one_law_are_read_off_exactly():
    values, share = told("cogging_torque", column(TORQUES, MAGNETS))
    assert values == pytest.approx(MAGNETS.values)
    assert share == pytest.approx(1.0)


def test_what_is_known_to_be_missing_may_have_another_amount():
    both = column(TORQUES, MAGNETS) + 3.0 * column(TORQUES, FRICTION)
    values, _ = told("cogging_torque", both, [FRICTION])
    assert values["amplitude"] == pytest.approx(AMPLITUDE)
    alone, _ = told("cogging_torque", both)
    assert alone["amplitude"] != pytest.approx(AMPLITUDE, rel=1e-3)


def test_what_has_no_law_is_read_off_as_the_difference_of_two_models():
    inertia = instance("armature", inertia=0.01)
    values, share = told("armature", column(TORQUES, inertia))
    assert values["inertia"] == pytest.approx(0.01)
    assert share == pytest.approx(1.0)


def test_an_amount_that_an_effect_cannot_have_is_not_read_off():
    friction = column(TORQUES, instance("viscous_friction", coefficient=0.1))
    assert told("viscous_friction", friction) is not None
    assert told("viscous_friction", -friction) is None  # a friction that drives is none


def test_an_effect_looks_like_another_that_adds_nearly_the_same():
    wide = instance("stribeck_friction", static_excess=0.1, stribeck_velocity=100.0)
    assert looks_like(TORQUES, place("coulomb_friction"), wide, [])
    assert not looks_like(TORQUES, place("coulomb_friction"), MAGNETS, [])


@pytest.mark.parametrize(("factor", "far"), [(1.0, 0.0), (2.0, 2.0), (-3.0, 10.0), (50.0, 10.0)])
def test_an_amount_disagrees_by_the_factor_to_what_the_missing_torque_tells(factor, far):
    """By ten at most, as what points the wrong way does."""
    told = replace(MAGNETS, values={**MAGNETS.values, "amplitude": factor * AMPLITUDE})
    ((key, figure),) = TORQUES.disagreement([told]).items()
    assert key == MAGNETS.key
    assert figure == pytest.approx(np.log(max(far, 1.0)), abs=0.05)


def test_what_the_missing_torque_says_nothing_of_does_not_disagree():
    beside = instance("coulomb_friction", torque=0.5)
    assert TORQUES.disagreement([MAGNETS, beside])[beside.key] < 0.02
    motor = instance("joint_elasticity", stiffness=100.0)
    assert TORQUES.disagreement([motor]) == {motor.key: 0.0}


def test_a_disc_between_magnets_is_found_where_rollouts_say_little():
    nominal = nominal_hypothesis(PROBLEM.robust(()))
    assert nominal.fit.cost > FAR_OFF
    search = Search(candidates=[place("cogging_torque")], report=lambda _: None, torques=TORQUES)
    (magnets,) = missing_torque(nominal, search).chosen.new
    assert magnets.values["amplitude"] == pytest.approx(AMPLITUDE, rel=0.01)
    assert magnets.values["per_revolution"] == ORDER


def test_amounts_are_told_together_and_what_nothing_is_told_of_stays():
    late = EffectInstance(
        effect=find_effect("joint_elasticity"), joints=("j",), values={"stiffness": 50.0}
    )
    weak = replace(MAGNETS, values={**MAGNETS.values, "amplitude": 0.4 * AMPLITUDE})
    magnets, friction, same = told_together(TORQUES, [weak, FRICTION, late])
    assert magnets.values["amplitude"] == pytest.approx(AMPLITUDE, rel=0.1)
    assert friction == FRICTION  # there is none: a fit has to begin somewhere
    assert same == late


def test_amounts_are_told_within_their_bounds_and_a_gain_is_no_multiple():
    outside = replace(MAGNETS, values={**MAGNETS.values, "phase": -12.0})
    (told,) = told_together(TORQUES, [outside])
    assert told.values["phase"] == -10.0
    gain = instance("actuator_gain", scale=0.9)
    assert told_together(TORQUES, [gain]) == (gain,)
