"""What drives do between two time steps, against exact solutions of the same motion."""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
from scipy.integrate import solve_ivp

from disc import DISC
from gfm.core import CommandKind
from gfm.effects import EffectInstance, find_effect
from gfm.sim.commands import AFTER, BEFORE
from gfm.sim.instants import sensors_at, states_at
from gfm.sim.plant import make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Segment

INERTIA, KP, KV, LAG_S = 0.05, 200.0, 5.0, 0.03
STIFF = DISC.format(step=0.002, integrator="RK4", inertia=INERTIA, kp=KP, kv=KV)
MOTOR = STIFF[: STIFF.index("<general")] + '<motor name="j" joint="j"/></actuator></mujoco>'
#: A motor of gear 2 whose torque is read.
DRIVEN = MOTOR.replace('joint="j"/>', 'joint="j" gear="2"/>').replace(
    "</mujoco>", '<sensor><jointactuatorfrc joint="j"/></sensor></mujoco>'
)
#: Off the grid of time steps, and between commands.
TIME_S = 0.0107 + 0.01 * np.arange(60)
COMMAND_TIME_S = 0.0093 + 0.01 * np.arange(60)
COMMAND = 0.3 * np.sin(7.0 * COMMAND_TIME_S)


def held(t, times=COMMAND_TIME_S):
    return COMMAND[np.clip(np.searchsorted(times, t, side="right") - 1, 0, None)]


def exact_torque():
    """Returns the drive's torque, N m, shape (T,); the motion is integrated command by command."""
    knots = [0.0, *COMMAND_TIME_S, TIME_S[-1] + 0.01]
    state, torque = np.zeros(2), []
    for begin, end in pairwise(knots):
        u = held(begin)
        here = TIME_S[(begin <= TIME_S) & (end > TIME_S)]
        found = solve_ivp(
            lambda _, y, u=u: [y[1], (KP * (u - y[0]) - KV * y[1]) / INERTIA],
            (begin, end),
            state,
            method="Radau",
            t_eval=[*here, end],
            rtol=1e-10,
            atol=1e-12,
        )
        torque += list(KP * (u - found.y[0, :-1]) - KV * found.y[1, :-1])
        state = found.y[:, -1]
    return np.array(torque)


def told(effects=(), *, text=STIFF, in_force=BEFORE, **changes):
    segment = Segment(
        time_s=TIME_S,
        position=np.zeros((len(TIME_S), 1)),
        effort=None,
        kind=CommandKind.POSITION,
        command_time_s=COMMAND_TIME_S,
        command=COMMAND[:, None],
        initial_position=np.zeros(1),
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    plant = make_plant(mujoco.MjSpec.from_string(text), ("j",), effects)
    return predict([plant], [replace(segment, **changes)], in_force=in_force)[0][0]


def test_torques_between_steps_are_those_of_the_exact_motion():
    exact = exact_torque()
    error = np.abs(told().effort[:, 0] - exact)
    assert np.abs(exact).max() > 2.0
    assert error.max() < 0.02 * np.abs(exact).max()


def test_a_torque_of_the_same_stamp_is_under_the_command_before_or_after():
    before, after = (told(time_s=COMMAND_TIME_S, in_force=a).effort[1:, 0] for a in (BEFORE, AFTER))
    np.testing.assert_allclose(after - before, KP * np.diff(COMMAND), rtol=1e-6, atol=1e-9)


def test_a_torque_keeps_its_own_command_where_stamps_jitter():
    early = {"time_s": COMMAND_TIME_S, "command_time_s": COMMAND_TIME_S - 0.001}
    before, after = (
        told(**early, same_stamp_s=0.0015, in_force=a).effort[1:, 0] for a in (BEFORE, AFTER)
    )
    np.testing.assert_allclose(after - before, KP * np.diff(COMMAND), rtol=1e-6, atol=1e-9)


def test_a_lagging_drive_answers_exponentially_between_steps():
    lag = EffectInstance(
        effect=find_effect("actuator_lag"), joints=("j",), values={"time_constant": LAG_S}
    )
    start = COMMAND_TIME_S[20]
    step = np.where(start > COMMAND_TIME_S, 0.0, 0.4)[:, None]
    moved = told([lag], text=MOTOR, kind=CommandKind.EFFORT, command=step)
    expected = 0.4 * -np.expm1(-np.maximum(TIME_S - start, 0.0) / LAG_S)
    np.testing.assert_allclose(moved.effort[:, 0], expected, atol=1e-4)


def test_states_between_rows_follow_a_constant_acceleration():
    model = mujoco.MjModel.from_xml_string(STIFF)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    rows = np.zeros((4, size))
    time_s = model.opt.timestep * np.arange(4)
    rows[:, 0], rows[:, 1], rows[:, 2] = time_s, 0.5 * 30.0 * time_s**2, 30.0 * time_s
    place = np.array([0.0, 0.25, 1.5, 2.0, 3.0])
    states, at = states_at(model, rows[0], rows[1:], place), model.opt.timestep * place
    np.testing.assert_allclose(states[:, 0], at, atol=1e-15)
    np.testing.assert_allclose(states[:, 1], 15.0 * at**2, atol=1e-15)
    np.testing.assert_allclose(states[:, 2], 30.0 * at, atol=1e-14)


def test_models_keep_their_options():
    model = mujoco.MjModel.from_xml_string(STIFF)
    flags = model.opt.disableflags
    state = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    sensors_at([model, model], [state, state], [np.zeros((1, 1))] * 2, threads=1)
    assert model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4)
    assert model.opt.disableflags == flags


def test_each_model_reads_its_own_sensors():
    strong, weak = (mujoco.MjModel.from_xml_string(DRIVEN) for _ in range(2))
    weak.actuator_gainprm[:] *= 0.5
    states = np.zeros((3, mujoco.mj_stateSize(strong, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    commands = [np.array([[1.0], [2.0]]), np.array([[4.0]]), np.array([[-1.0], [0.0], [3.0]])]
    parts = [states[:2], states[:1], states]
    told = sensors_at([strong, weak, strong], parts, commands, threads=2)
    expected = [2.0 * commands[0], 1.0 * commands[1], 2.0 * commands[2]]
    for one, there in zip(told, expected, strict=True):
        np.testing.assert_allclose(one, there, atol=1e-12)
