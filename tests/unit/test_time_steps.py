"""Diagnoses simulate on steps that suit the model, whatever step it was written for."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from disc import DISC
from gfm.core import CommandKind
from gfm.diagnosis.problem import Noise, Problem
from gfm.diagnosis.time_steps import with_suitable_steps
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


def turning(*, step, inertia=0.05, kp=20.0, kv=2.0):
    segment = Segment(
        time_s=TIME_S,
        position=turned(inertia, kp, kv),
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
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    return Problem(
        specs={KIND: spec},
        joints=("j",),
        segments=(segment,),
        noise=Noise(position=np.full(1, NOISE), effort=None),
    )


def cost(problem, effects=()):
    return float(np.mean(problem.residuals([effects]) ** 2))


def test_a_short_step_is_as_long_as_nobody_sees():
    suited = with_suitable_steps(turning(step=0.00025))
    assert suited.steps_s == {KIND: pytest.approx(0.002)}
    assert cost(suited) < 0.01


def test_a_step_is_never_made_longer_than_the_longest():
    assert with_suitable_steps(turning(step=0.0015)).steps_s == {KIND: pytest.approx(0.0015)}
    assert with_suitable_steps(turning(step=0.005)).steps_s == {KIND: pytest.approx(0.005)}


def test_a_step_on_which_a_stiff_servo_runs_away_is_made_shorter():
    """At 4000 /s, steps of 2 ms are beyond what the Runge-Kutta method can follow."""
    stiff = turning(step=0.002, inertia=0.001, kp=100.0, kv=4.0)
    assert cost(stiff) > 1e4
    suited = with_suitable_steps(stiff)
    assert suited.steps_s[KIND] <= 0.0005
    assert cost(suited) < 0.1


def test_a_step_that_would_show_is_not_taken():
    """The same servo, written for a step on which it is followed."""
    suited = with_suitable_steps(turning(step=0.00025, inertia=0.001, kp=100.0, kv=4.0))
    assert suited.steps_s[KIND] <= 0.0005
    assert cost(suited) < 0.1


def test_what_is_added_may_ask_for_a_shorter_step():
    problem = with_suitable_steps(turning(step=0.0005))
    drag = find_effect("viscous_friction")
    heavy = EffectInstance(effect=drag, joints=("j",), values={"coefficient": 150.0})
    assert with_suitable_steps(problem, (heavy,)).steps_s[KIND] < problem.steps_s[KIND]


def test_a_motor_apart_from_its_link_keeps_the_models_step():
    problem = replace(turning(step=0.0005), steps_s={KIND: 0.002})
    own = replace(problem, steps_s={})
    elastic = find_effect("joint_elasticity")
    values = {p.name: max(p.lower, 1e-3) for p in elastic.parameters} | {"stiffness": 300.0}
    apart = EffectInstance(effect=elastic, joints=("j",), values=values)
    assert (problem.residuals([(apart,)]) == own.residuals([(apart,)])).all()
    assert (problem.residuals([()]) != own.residuals([()])).any()
    assert with_suitable_steps(own, (apart,)) is own
    # What is compared is simulated alike.
    both = problem.residuals([(), (apart,)])
    assert (both[0] == own.residuals([()])[0]).all()
