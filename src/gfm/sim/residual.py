"""The generalized forces that the nominal model lacks, by inverse dynamics along a recording.

They start a generalized force model close to its goal: regressed on what it observes, then refined
by reinforcement learning over the horizon.

Shape letters: K control periods, S integration steps in each, A generalized forces, T times.
"""

from __future__ import annotations

import copy

import mujoco
import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.sim.batch import initial_activation
from gfm.sim.hybrid import HybridModel
from gfm.sim.replay import Replay, make_replay
from gfm.sim.step_laws import Moment

_CONTINUOUS = int(mujoco.mjtIntegrator.mjINT_RK4)


def residual_forces(model: HybridModel, trajectory: Trajectory) -> Array:
    """Returns inverse dynamics minus drives, averaged over each control period, shape (K, A).

    Not clipped to the force limits. Positions are the smoothed ones of `gfm.sim.replay`, so that
    what is faster than their noise allows is averaged away.
    """
    replay = make_replay(model, trajectory)
    force = np.array(_step_forces(model, replay))
    periods = force.reshape(replay.periods, model.substeps, -1)
    return np.asarray(periods.mean(axis=1)[:, model.force_dof])


def _step_forces(model: HybridModel, replay: Replay) -> list[Array]:
    """Returns the missing force at each integration step, shape (K S, nv).

    RK4 follows the continuous motion, whose accelerations are taken at the middle of each step.
    The other integrators take q+ = q + h v+, v+ = v + h a: with velocities and accelerations
    differenced the same way, their own discrete inverse gives the forces that reproduce the
    recorded positions step by step.
    """
    inverse = copy.copy(replay.model)
    discrete = int(inverse.opt.integrator) != _CONTINUOUS
    if discrete:
        inverse.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    else:  # MuJoCo refuses the inverse of RK4; without the flag Euler's is the continuous one
        inverse.opt.integrator = int(mujoco.mjtIntegrator.mjINT_EULER)
    inverse.actuator_delay[:] = 0.0  # the commands below come late instead
    qpos, qvel, qacc = _sampled_motion(replay, model, discrete=discrete)
    command = _as_arriving(model, replay)
    compensation = model.erring_compensation()
    extra = np.zeros_like(qvel) if compensation is None else compensation.at(qpos).force
    laws, constant = model.step_laws(1), inverse.dof_frictionloss.copy()
    data = mujoco.MjData(inverse)
    data.act[:] = initial_activation(inverse, model.layout.actuator, command[0])
    forces = []
    for q, v, a, u, known in zip(qpos, qvel, qacc, command, extra, strict=True):
        data.qpos[:], data.qvel[:] = q, v
        data.ctrl[model.layout.actuator[model.layout.driven]] = u[model.layout.driven]
        mujoco.mj_forward(inverse, data)
        data.act += inverse.opt.timestep * data.act_dot
        if laws is not None:
            state = (data.qpos[None], data.qvel[None], data.sensordata[None])
            now = Moment(qpos=state[0], qvel=state[1], sensordata=state[2])
            acting = laws.acting(now)
            inverse.dof_frictionloss[:] = constant + acting.friction[0]
            known = known + acting.force[0]
        data.qacc[:] = a
        mujoco.mj_inverse(inverse, data)
        forces.append(data.qfrc_inverse - data.qfrc_actuator - known)
    return forces


def _sampled_motion(
    replay: Replay, model: HybridModel, *, discrete: bool
) -> tuple[Array, Array, Array]:
    """Returns positions, velocities and accelerations at each integration step."""
    h, count = model.timestep_s, replay.periods * model.substeps
    start = np.asarray(replay.start_s + h * np.arange(count), np.float64)
    if not discrete:
        middle = start + 0.5 * h
        qacc = (replay.motion.qvel(start + h) - replay.motion.qvel(start)) / h
        return replay.motion.qpos(middle), replay.motion.qvel(middle), qacc
    before = replay.motion.qvel(start - 0.5 * h)
    after = replay.motion.qvel(start + 0.5 * h)
    return replay.motion.qpos(start), before, (after - before) / h


def _as_arriving(model: HybridModel, replay: Replay) -> Array:
    """Returns the commands when they reach the drives, delays of the model included, (K S, J)."""
    steps = np.arange(replay.periods * model.substeps)
    flat = replay.command.reshape(-1, replay.command.shape[2])
    arriving = flat[steps].copy()
    for joint, actuator in enumerate(model.layout.actuator):
        if actuator >= 0 and replay.model.actuator_history[actuator, 0]:
            late = round(replay.model.actuator_delay[actuator] / model.timestep_s)
            arriving[:, joint] = flat[np.maximum(steps - late, 0), joint]
    return arriving
