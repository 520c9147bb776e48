"""A motor behind a spring has a state of its own: where it rings, that is fitted, too."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfm.core import CommandKind
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.rollouts import Noise
from gfm.effects import EffectInstance, find_effect
from gfm.sim.motor_sides import springs
from gfm.sim.plant import make_plant
from gfm.sim.segment import Segment

#: Inertias of link and motor, kg m^2, and a stiffness at which they ring with 11 Hz.
LINK, MOTOR, STIFFNESS = 0.02, 0.01, 35.0
ROTOR = f"""
<mujoco><option timestep="0.001" integrator="RK4" gravity="0 0 0"/><worldbody>
  <body name="link"><joint name="j" axis="0 0 1" armature="{MOTOR}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{LINK} {LINK} {LINK}"/></body>
</worldbody><actuator><motor name="j" joint="j"/></actuator></mujoco>
"""
TIME_S = 0.005 * np.arange(100.0)
NOISE = 1e-4
TORQUE_NM = 0.5


def elastic(stiffness):
    effect = find_effect("joint_elasticity")
    return (EffectInstance(effect=effect, joints=("j",), values={"stiffness": stiffness}),)


def ringing(stiffness=STIFFNESS, *, ahead=0.0, faster=0.0):
    """Returns the link's angles under a constant torque, shape (T, 1).

    Its motor is ahead by so much at first, rad, and so much faster, rad/s.
    """
    found = solve_ivp(
        lambda _, y: [
            y[2],
            y[3],
            stiffness * (y[1] - y[0]) / LINK,
            (TORQUE_NM - stiffness * (y[1] - y[0])) / MOTOR,
        ],
        (0.0, TIME_S[-1]),
        [0.0, ahead, 0.0, faster],
        t_eval=TIME_S,
        rtol=1e-10,
        atol=1e-12,
    )
    return found.y[:1].T


def problem(position, *, kind=CommandKind.EFFORT):
    segment = Segment(
        time_s=TIME_S,
        position=position,
        effort=None,
        kind=kind,
        command_time_s=TIME_S,
        command=np.full((len(TIME_S), 1), TORQUE_NM),
        initial_position=np.zeros(1),
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    return with_state_basis(
        Problem(
            specs={kind: mujoco.MjSpec.from_string(ROTOR)},
            joints=("j",),
            segments=(segment,),
            noise=Noise(position=np.full(1, NOISE), effort=None),
        )
    )


def cost(problem, effects):
    return float(np.mean(problem.residuals([effects])[0] ** 2))


def test_a_spring_is_told_with_the_frequency_of_two_free_inertias():
    plant = make_plant(mujoco.MjSpec.from_string(ROTOR), ("j",), elastic(STIFFNESS))
    (spring,) = springs(plant)
    assert spring.joint == 0
    assert spring.stiffness == pytest.approx(STIFFNESS)
    exact = np.sqrt(STIFFNESS * (1.0 / LINK + 1.0 / MOTOR)) / (2.0 * np.pi)
    assert spring.ringing_hz == pytest.approx(exact, rel=1e-3)
    assert springs(make_plant(mujoco.MjSpec.from_string(ROTOR), ("j",), ())) == []


def test_how_a_motor_rings_at_first_is_no_misfit():
    """The state of the motor is in no measurement: it takes any phase and size."""
    rung = problem(ringing(ahead=0.02, faster=-1.0))
    assert cost(rung, ()) > 1e3
    assert cost(rung, elastic(STIFFNESS)) < 0.1
    assert np.abs(rung.position_errors(elastic(STIFFNESS))[0]).max() < NOISE


def test_a_wrong_frequency_stays_a_misfit():
    rung = problem(ringing(ahead=0.02, faster=-1.0))
    assert cost(rung, elastic(2.0 * STIFFNESS)) > 0.3 * cost(rung, ())


def test_a_spring_is_not_bent_farther_than_its_drive_could():
    """Else a spring of any stiffness would explain whatever has its frequency."""
    within, beyond = problem(ringing(ahead=0.02)), problem(ringing(ahead=0.2))
    assert cost(within, elastic(STIFFNESS)) < 0.1
    assert cost(beyond, elastic(STIFFNESS)) > 1e3


def test_what_swings_slower_than_a_stretch_tells_is_where_its_load_holds_it():
    soft = 0.02 * STIFFNESS
    slow = problem(ringing(soft, ahead=0.1))
    assert cost(slow, elastic(soft)) > 100.0


def test_states_of_motors_are_settled_with_those_of_links():
    rung = problem(ringing(ahead=0.02, faster=-1.0)).settled(elastic(STIFFNESS))
    found = rung.segments[0].initial_motor
    # The load that holds the link at first is none: the motor is ahead by what it was.
    np.testing.assert_allclose(found[:, 0], [0.02, -1.0], rtol=0.01)
    plain = replace(rung, state_basis=())
    assert cost(plain, elastic(STIFFNESS)) < 0.1
