"""Where nothing leads a joint back, what a stretch began with is fitted to its end."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfm.core import CommandKind
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.residuals.problem import Problem, unsettled
from gfm.diagnosis.residuals.rollouts import Noise
from gfm.diagnosis.search.hypothesis import Hypothesis, settled_hypothesis
from gfm.effects import EffectInstance, find_effect
from gfm.sim.segment import Segment

#: A point mass on a light rod, near its upright equilibrium, whose fall multiplies what it begins
#: with by about 50: q'' = g / l sin q.
LENGTH = 0.5
ROD = """
<mujoco><option timestep="0.002" integrator="RK4" gravity="0 0 -9.81"/><worldbody>
  <body name="rod"><joint name="j" axis="0 1 0"/>
    <inertial pos="0 0 {length}" mass="1" diaginertia="1e-9 1e-9 1e-9"/></body>
</worldbody><actuator><motor name="j" joint="j"/></actuator></mujoco>
"""
TIME_S = 0.01 * np.arange(100.0)
NOISE = 1e-4


def fallen(angle, speed, friction=0.0):
    """Returns the angles of the fall, shape (T, 1), with viscous friction in N m s/rad."""
    found = solve_ivp(
        lambda _, y: [y[1], 9.81 / LENGTH * np.sin(y[0]) - friction / LENGTH**2 * y[1]],
        (0.0, TIME_S[-1]),
        [angle, speed],
        t_eval=TIME_S,
        rtol=1e-10,
        atol=1e-12,
    )
    return found.y[:1].T


def falling(kind, *, error):
    """Returns the problem of a fall from 0.1 rad at rest, its initial speed known with an error."""
    segment = Segment(
        time_s=TIME_S,
        position=fallen(0.1, 0.0),
        effort=None,
        kind=kind,
        command_time_s=TIME_S,
        command=np.zeros((len(TIME_S), 1)),
        initial_position=np.array([0.1]),
        initial_velocity=np.array([error]),
        servo_gain=np.ones(1),
    )
    return Problem(
        specs={kind: mujoco.MjSpec.from_string(ROD.format(length=LENGTH))},
        joints=("j",),
        segments=(segment,),
        noise=Noise(position=np.full(1, NOISE), effort=None),
        state_basis=(np.zeros((len(TIME_S), 0)),),
    )


def test_initial_states_are_found_where_the_first_order_is_not_enough():
    rough = falling(CommandKind.EFFORT, error=0.05)
    fine = rough.settled(())
    assert fine.segments[0].initial_velocity[0] == pytest.approx(0.0, abs=1e-3)
    assert fine.segments[0].initial_position[0] == pytest.approx(0.1, abs=1e-4)
    assert np.abs(rough.position_errors(())[0]).max() > 0.1
    assert np.abs(fine.position_errors(())[0]).max() < NOISE


def test_a_servo_forgets_how_it_began():
    led = falling(CommandKind.POSITION, error=0.05)
    assert led.settled(()).segments == led.segments
    off = replace(led, segments=(replace(led.segments[0], servo_gain=np.zeros(1)),))
    assert off.settled(()).segments[0].initial_velocity[0] == pytest.approx(0.0, abs=1e-3)


def test_a_stretch_that_is_followed_as_it_begins_stays_as_it_is():
    followed = falling(CommandKind.EFFORT, error=0.0)
    assert followed.settled(()).segments[0] is followed.segments[0]


def suited_to_none(friction):
    """The problem of a fall with friction, from initial states that suit a model without it."""
    problem = falling(CommandKind.EFFORT, error=0.0)
    slowed = replace(problem.segments[0], position=fallen(0.1, 0.0, friction))
    return replace(problem, segments=(slowed,)).settled(())


def viscous(coefficient):
    effect = find_effect("viscous_friction")
    return EffectInstance(effect=effect, joints=("j",), values={"coefficient": coefficient})


def test_states_and_amounts_are_found_in_turn():
    """States that suit the model without friction hold amounts back if they stay."""
    problem = suited_to_none(friction=0.3)
    assert fit(problem, (viscous(0.01),)).cost > 5.0
    found = settled_hypothesis(problem, (viscous(0.01),), np.full(1, 1e4))
    assert found.fit.cost < 0.1
    assert found.effects[0].values["coefficient"] == pytest.approx(0.3, rel=0.01)


def test_states_as_measured_are_kept_beside_those_that_suit_a_model():
    measured = falling(CommandKind.EFFORT, error=0.0)
    slowed = replace(measured.segments[0], position=fallen(0.1, 0.0, 0.3))
    bent = replace(measured, segments=(slowed,)).settled(()).settled((viscous(0.1),))
    assert bent.segments[0].initial_velocity[0] < -0.01
    assert unsettled(bent, (viscous(0.3),)).segments[0] is slowed


def test_errors_as_measured_are_those_of_what_was_measured():
    """A speed that is off by 0.05 rad/s, in closed form; bent states make nothing of it better."""
    measured = falling(CommandKind.EFFORT, error=0.05)
    off = fallen(0.1, 0.0) - fallen(0.1, 0.05)
    for problem in (measured, measured.settled(())):
        assert problem.as_measured().position_errors(())[0] == pytest.approx(off, abs=1e-5)


def test_rivals_are_compared_from_initial_states_of_their_own():
    """Those of the problem suit the model without friction: beside it, friction looks wrong."""
    suited = suited_to_none(friction=0.05)
    there = fit(suited, (viscous(0.01),))
    assert there.cost > 5.0
    nominal = Hypothesis(problem=suited, fit=fit(suited, ()), nominal=np.full(1, 1e4))
    best = nominal.fitted_out(there)
    assert best.cost < 0.1
    assert best.effects[0].values["coefficient"] == pytest.approx(0.05, rel=0.01)
