"""A delay is found where efforts are measured beside the commands of their stamps."""

import mujoco
import numpy as np
import pytest

from disc import DISC, followed
from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import accurately_simulated
from gfm.diagnosis.former.attribution import fit_best
from gfm.diagnosis.inference.fitting import fit, nothing
from gfm.diagnosis.residuals.problem import Noise, Problem, timed, with_state_basis
from gfm.diagnosis.search.screening import Screened
from gfm.effects import EffectInstance, find_effect
from gfm.sim.segment import Segment

#: A wrist of an arm with stiff servos, commanded and measured at 125 Hz; the delay is more than one
#: command and less than two.
INERTIA, KP, KV = 0.0724, 500.0, 45.0
PERIOD_S, DELAY_S = 0.008, 0.011
TIME_S = PERIOD_S * np.arange(500.0)
COMMAND = 0.6 * np.sin(2.0 * np.pi * 0.4 * TIME_S) + 0.2 * np.sin(2.0 * np.pi * 1.1 * TIME_S)
POSITION_NOISE, EFFORT_NOISE = 5e-5, 0.01


def recorded(late_s):
    """The problem of explaining what was recorded of it, with noise."""
    servo = {"period_s": PERIOD_S, "inertia": INERTIA, "kp": KP, "kv": KV}
    position, effort = followed(COMMAND, late_s=late_s, **servo)
    rng = np.random.default_rng(0)
    position = position + POSITION_NOISE * rng.standard_normal(position.shape)
    effort = effort + EFFORT_NOISE * rng.standard_normal(effort.shape)
    text = DISC.format(step=0.002, integrator="RK4", inertia=INERTIA, kp=KP, kv=KV)
    segment = Segment(
        time_s=TIME_S,
        position=position,
        effort=effort,
        effort_noise=np.array([EFFORT_NOISE]),
        kind=CommandKind.POSITION,
        command_time_s=TIME_S,
        command=COMMAND[:, None],
        initial_position=np.zeros(1),
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    problem = Problem(
        specs={CommandKind.POSITION: accurately_simulated(mujoco.MjSpec.from_string(text))},
        joints=("j",),
        segments=(segment,),
        noise=Noise(position=np.array([POSITION_NOISE]), effort=np.array([EFFORT_NOISE])),
    )
    return timed(with_state_basis(problem), ())


def delay(by_s):
    effect = find_effect("command_delay")
    return EffectInstance(effect=effect, joints=("j",), values={"delay": by_s})


def test_a_delay_past_the_command_of_a_stamp_is_reached_from_a_small_one():
    problem, begun = recorded(DELAY_S), delay(0.004)
    stuck = fit(problem, (begun,))
    assert stuck.effects[0].values["delay"] < 0.008
    screened = [Screened(instance=begun, gain=0.5)]
    fits = fit_best(problem, screened, nothing(problem), lambda _: None)
    best = min(fits, key=lambda f: f.cost)
    assert best.effects[0].values["delay"] == pytest.approx(DELAY_S, abs=5e-4)


def test_positions_alone_are_the_same_positions():
    problem = recorded(DELAY_S)
    alone = problem.positions_alone()
    assert problem.has_efforts
    assert not alone.has_efforts
    late = (delay(0.008),)
    whole, part = problem.as_measured(), alone.as_measured()
    assert part.position_errors(late)[0] == pytest.approx(whole.position_errors(late)[0])
    (basis,) = alone.state_basis
    assert basis.shape == (len(TIME_S), 2)
    assert basis.T @ basis == pytest.approx(np.eye(2), abs=1e-9)
