"""Simulations at instants between two of their time steps: the state there, and what drives do.

Shape letters: K time steps, S numbers of a state (mjSTATE_FULLPHYSICS), T instants, N of all
simulations together.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np
from mujoco import rollout

from gfm.core.checks import Array
from gfm.effects.effect import MOTOR_SIDE
from gfm.sim.plant import Plant
from gfm.sim.segment import Segment


def states_at(model: mujoco.MjModel, initial: Array, rows: Array, place: Array) -> Array:
    """Returns the states at instants, shape (T, S).

    Hinges and slides follow the cubic that has the positions and speeds of both neighbours; all
    else goes straight, but for what actuators remember, which stays that of the one before.

    Args:
        model: What was simulated.
        initial: The state before the first time step, shape (S,).
        rows: The states after every time step, shape (K, S).
        place: The instants, in time steps, shape (T,).
    """
    low = np.clip(np.floor(place + 1e-9).astype(np.intp), 0, len(rows) - 1)
    share = (place - low)[:, None]
    before, after = rows[low - 1], rows[low]
    before[low == 0] = initial
    states = np.array(before)
    straight = 1 + model.nq + model.nv + model.na
    change = after[:, :straight] - before[:, :straight]
    states[:, :straight] += share * change
    single = model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE)
    position = 1 + model.jnt_qposadr[single]
    velocity = 1 + model.nq + model.jnt_dofadr[single]
    step_s = model.opt.timestep
    # What the cubic has beside the straight line (Hermite's form).
    bend = [step_s * row[:, velocity] - change[:, position] for row in (before, after)]
    states[:, position] += share * (1.0 - share) * ((1.0 - share) * bend[0] - share * bend[1])
    return states


def states_before(plant: Plant, segment: Segment, initial: Array, at_s: Array) -> Array:
    """Returns the states at times before the first, which are less than none, shape (T, S).

    Joints and their motor sides have come there with the acceleration with which the segment
    begins.
    """
    states = np.tile(initial, (len(at_s), 1))
    bend, nq = segment.initial_acceleration(), plant.model.nq
    for j, name in enumerate(plant.joints):
        sides = [plant.model.joint(name).id]
        if plant.motor_qpos[j] >= 0:
            sides.append(plant.model.joint(name + MOTOR_SIDE).id)
        for side in sides:
            q, v = 1 + plant.model.jnt_qposadr[side], 1 + nq + plant.model.jnt_dofadr[side]
            states[:, q] += (initial[v] + 0.5 * bend[j] * at_s) * at_s
            states[:, v] += bend[j] * at_s
    return states


def sensors_at(
    models: Sequence[mujoco.MjModel],
    states: Sequence[Array],
    controls: Sequence[Array],
    *,
    threads: int,
) -> list[Array]:
    """Returns what drives' sensors read in given states, shape (T, nsensordata) of each model.

    Args:
        models: Alike but for their values; the same one may stand there several times.
        states: Of each model, shape (T, S).
        controls: There, shape (T, nu).
        threads: On how many to compute.
    """
    told = [np.empty((len(own), models[0].nsensordata)) for own in states]
    places = defaultdict[int, list[int]](list)
    for i, model in enumerate(models):
        places[id(model)].append(i)
    data = [mujoco.MjData(models[0]) for _ in range(threads)]
    with _actuation_only(models):
        for own in places.values():
            _, sensors = rollout.rollout(
                models[own[0]],
                data,
                np.concatenate([states[i] for i in own]),
                np.concatenate([controls[i] for i in own])[:, None],
                nstep=1,
                persistent_pool=True,
            )
            ends = np.cumsum([len(states[i]) for i in own])[:-1]
            for i, part in zip(own, np.split(sensors[:, 0], ends), strict=True):
                told[i][:] = part
    return told


@contextmanager
def _actuation_only(models: Sequence[mujoco.MjModel]) -> Iterator[None]:
    """Lets models step at the least cost: what drives do is known before constraints are."""
    different = list({id(model): model for model in models}.values())
    before = [(model.opt.integrator, model.opt.disableflags) for model in different]
    try:
        for model in different:
            model.opt.integrator = int(mujoco.mjtIntegrator.mjINT_EULER)
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        yield
    finally:
        for model, (integrator, flags) in zip(different, before, strict=True):
            model.opt.integrator, model.opt.disableflags = integrator, flags
