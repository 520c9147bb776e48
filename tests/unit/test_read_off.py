"""Amounts read off the missing torque, where rollouts go where the robot never was."""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import make_problem
from gfm.diagnosis.search.candidates import Place, joint_scales
from gfm.diagnosis.search.hypothesis import FAR_OFF, nominal_hypothesis
from gfm.diagnosis.search.read_off import read_off
from gfm.diagnosis.search.screening import screen
from gfm.effects import EffectInstance, Scales, find_effect
from gfm.effects.friction import SIGN_WIDTH_RAD_S
from gfm.signals.torque_domain import torque_views
from gfm.signals.torques import TorqueView, joined

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
SCALES = Scales(
    torque_nm=1.0,
    excess_nm=0.1,
    velocity_rad_s=1.0,
    position_rad=1.0,
    peak_nm=1.0,
    servo_nm=1.0,
    inertia=INERTIA,
    cogging_per_revolution=(ORDER,),
)


def wave(q):
    return AMPLITUDE * np.sin(ORDER * q + PHASE)


def place(name, scales=SCALES):
    return Place(effect=find_effect(name), joints=("j",), scales=scales)


def friction(torque):
    return EffectInstance(
        effect=find_effect("coulomb_friction"), joints=("j",), values={"torque": torque}
    )


def view(missing):
    time_s = np.linspace(0.0, 10.0, 2000)
    q = np.sin(time_s)
    rows = [column[:, None] for column in (q, np.cos(time_s), np.zeros_like(q))]
    told = missing(*rows[:2])
    return TorqueView(
        joints=("j",), position=rows[0], velocity=rows[1], drive=rows[2], missing=told, served=told
    )


def test_amounts_of_one_law_are_read_off_exactly():
    (found,) = read_off(view(lambda q, _v: wave(q)), [place("cogging_torque")], ())
    told = {"amplitude": AMPLITUDE, "per_revolution": ORDER, "phase": PHASE}
    assert found.values == pytest.approx(told)


def test_what_is_known_to_be_missing_may_have_another_amount():
    both = view(lambda q, v: wave(q) - 0.3 * np.tanh(v / SIGN_WIDTH_RAD_S))
    (found,) = read_off(both, [place("cogging_torque")], [friction(0.1)])
    assert found.values["amplitude"] == pytest.approx(AMPLITUDE)
    (alone,) = read_off(both, [place("cogging_torque")], ())
    assert alone.values["amplitude"] != pytest.approx(AMPLITUDE, rel=1e-3)


def test_what_no_law_tells_is_not_read_off():
    left = view(lambda q, _v: wave(q))
    assert read_off(left, [place("armature"), place("command_delay")], ()) == []
    # A friction that drives is none.
    assert read_off(view(lambda _q, v: v), [place("viscous_friction")], ()) == []


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


def test_a_disc_between_magnets_is_found_where_rollouts_say_little():
    runs = [recorded(seed) for seed in range(3)]
    problem = make_problem({CommandKind.EFFORT: mujoco.MjSpec.from_string(DISC)}, runs)
    views = torque_views(problem, runs)
    (scales,) = joint_scales(problem, views)
    nominal = nominal_hypothesis(problem.robust(()))
    assert nominal.fit.cost > FAR_OFF
    tried = [place("cogging_torque", scales)]
    blind, seen = (screen(nominal, tried, 24.0, v)[0] for v in (None, joined(views)))
    assert seen.instance.values["amplitude"] == pytest.approx(AMPLITUDE, rel=0.1)
    assert seen.instance.values["per_revolution"] == ORDER
    assert seen.gain.nats > 4.0 * max(blind.gain.nats, 1.0)
