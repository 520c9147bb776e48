"""Diagnoses simulate on steps that suit the model, whatever step it was written for."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from disc import DISC
from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import accurately_simulated
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.rollouts import Noise, Stepping
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.effects import EffectInstance, find_effect
from gfm.sim.segment import Segment

TIME_S = 0.01 * np.arange(100.0)
NOISE = 1e-4
KIND = CommandKind.POSITION


def turned(inertia, kp, kv):
    """Returns the angles after a command of half a radian, shape (T, 1)."""
    found = solve_ivp(
        lambda _, y: [y[1], (kp * (0.5 - y[0]) - kv * y[1]) / inertia],
        (0.0, TIME_S[-1]),
        [0.0, 0.0],
        method="Radau",
        t_eval=TIME_S,
        rtol=1e-9,
        atol=1e-11,
    )
    return found.y[:1].T


def turning(*, step, inertia=0.05, kp=20.0, kv=2.0, friction=0.0, angles=None):
    segment = Segment(
        time_s=TIME_S,
        position=turned(inertia, kp, kv) if angles is None else angles,
        effort=None,
        kind=KIND,
        command_time_s=TIME_S,
        command=np.full((len(TIME_S), 1), 0.5),
        initial_position=np.zeros(1),
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    text = DISC.format(step=step, integrator="implicitfast", inertia=inertia, kp=kp, kv=kv)
    spec = mujoco.MjSpec.from_string(text)
    spec.joint("j").frictionloss = friction
    return Problem(
        specs={KIND: accurately_simulated(spec)},
        joints=("j",),
        segments=(segment,),
        noise=Noise(position=np.full(1, NOISE), effort=None),
    )


def cost(problem, effects=()):
    return float(np.mean(problem.residuals([effects]) ** 2))


def test_a_short_step_is_as_long_as_nobody_sees():
    suited = with_suitable_steps(turning(step=0.00025))
    assert suited.stepping[KIND].step_s == pytest.approx(0.002)
    assert cost(suited) < 0.01


def test_a_step_is_never_made_longer_than_the_longest():
    assert with_suitable_steps(turning(step=0.0015)).stepping[KIND].step_s == pytest.approx(0.0015)
    assert with_suitable_steps(turning(step=0.005)).stepping[KIND].step_s == pytest.approx(0.005)


def test_a_stiff_servo_that_runs_away_on_its_models_step_is_followed_all_the_same():
    """At 4000 /s, steps of 2 ms are beyond what the Runge-Kutta method can follow."""
    stiff = turning(step=0.002, inertia=0.001, kp=100.0, kv=4.0)
    assert cost(stiff) > 1e4
    suited = with_suitable_steps(stiff)
    assert suited.stepping[KIND] != Stepping(step_s=0.002)
    assert cost(suited) < 0.1


def test_a_step_that_would_show_is_not_taken():
    """The same servo, written for a step on which it is followed."""
    suited = with_suitable_steps(turning(step=0.00025, inertia=0.001, kp=100.0, kv=4.0))
    assert suited.stepping[KIND].step_s <= 0.0005
    assert cost(suited) < 0.1


def test_a_long_segment_in_which_nothing_moves_does_not_decide_for_others():
    stiff = turning(step=0.00025, inertia=0.001, kp=100.0, kv=4.0)
    time_s = 0.01 * np.arange(700.0)
    still = replace(
        stiff.segments[0],
        time_s=time_s,
        position=np.zeros((len(time_s), 1)),
        command_time_s=np.zeros(1),
        command=np.zeros((1, 1)),
    )
    turning_later = replace(stiff.segments[0], recording=1)
    suited = with_suitable_steps(replace(stiff, segments=(still, turning_later)))
    assert suited.stepping[KIND].step_s <= 0.0005
    alone = with_suitable_steps(replace(stiff, segments=(still,)))
    assert alone.stepping[KIND].step_s == pytest.approx(0.002)


def test_what_is_added_may_ask_for_a_shorter_step():
    problem = with_suitable_steps(turning(step=0.0005))
    drag = find_effect("viscous_friction")
    heavy = EffectInstance(effect=drag, joints=("j",), values={"coefficient": 150.0})
    assert (
        with_suitable_steps(problem, (heavy,)).stepping[KIND].step_s < problem.stepping[KIND].step_s
    )


def test_a_servo_that_is_too_stiff_for_any_step_is_integrated_implicitly():
    """At 100 000 /s, as wrists of arms that are modelled without rotors."""
    stiff = turning(step=0.002, inertia=1e-4, kp=200.0, kv=10.0)
    assert cost(stiff) > 1e4
    suited = with_suitable_steps(stiff)
    assert suited.stepping[KIND].implicit
    assert cost(suited) < 0.1
    # Once it is known, the other method is not tried again.
    assert with_suitable_steps(suited).stepping == suited.stepping


def massless(kp, kv, friction):
    """Returns the angles after a command of half a radian where inertia is nothing, shape (T, 1).

    While it turns, kv q' = kp (u - q) - friction.
    """
    return ((0.5 - friction / kp) * -np.expm1(-kp / kv * TIME_S))[:, None]


@pytest.mark.parametrize("friction", [2.0, 8.0])
def test_dry_friction_holds_beside_a_servo_that_is_too_stiff(friction):
    stiff = turning(
        step=0.002,
        inertia=1e-5,
        kp=200.0,
        kv=10.0,
        friction=friction,
        angles=massless(200.0, 10.0, friction),
    )
    suited = with_suitable_steps(stiff)
    assert suited.stepping[KIND].implicit
    assert cost(suited) < 0.5


def test_what_is_extrapolated_is_of_second_order():
    problem = turning(step=0.002, inertia=1e-5, kp=200.0, kv=10.0, angles=massless(200.0, 10.0, 0))

    def error(step_s):
        on = {KIND: Stepping(step_s=step_s, implicit=True)}
        return cost(replace(problem, stepping=on)) ** 0.5

    assert error(0.01) / error(0.005) == pytest.approx(4.0, rel=0.25)


def elastic():
    """A motor apart from its link, by a spring."""
    effect = find_effect("joint_elasticity")
    values = {p.name: max(p.lower, 1e-3) for p in effect.parameters} | {"stiffness": 300.0}
    return EffectInstance(effect=effect, joints=("j",), values=values)


@pytest.mark.parametrize(
    ("own_s", "suitable_s", "taken_s"),
    [(0.0005, 0.002, 0.001), (0.002, 0.002, 0.002), (0.0005, 0.00025, 0.00025)],
)
def test_a_motor_apart_from_its_link_has_short_steps(own_s, suitable_s, taken_s):
    """A millisecond; the model's own, if that is longer; less, where less suits the model."""
    apart = elastic()
    problem = replace(turning(step=own_s), stepping={KIND: Stepping(step_s=suitable_s)})
    taken = replace(turning(step=taken_s), stepping={KIND: Stepping(step_s=taken_s)})
    assert (problem.residuals([(apart,)]) == taken.residuals([(apart,)])).all()
    assert with_suitable_steps(problem, (apart,)) is problem


def test_what_is_compared_with_a_motor_apart_is_simulated_alike():
    problem = replace(turning(step=0.0005), stepping={KIND: Stepping(step_s=0.002)})
    short = replace(problem, stepping={KIND: Stepping(step_s=0.001)})
    apart = elastic()
    both = problem.residuals([(), (apart,)])
    assert (both[0] == short.residuals([()])[0]).all()
    assert (both[0] != problem.residuals([()])[0]).any()
