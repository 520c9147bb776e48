"""The generalized forces on a free object that the nominal model lacks, by short rollouts.

Inverse dynamics say little of an object in contact: how deep it is in what it touches is not
measured, and a tenth of a millimetre of that is as much force as its weight. Where it will be a
moment later is measured. So each force is the constant one with which a short rollout ends where
the recording does. An object moves in the plane that it lies on: two forces and a torque.

Shape letters: K control periods, W windows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.envs.difference import state_difference
from gfm.envs.fit_problem import FitProblem, make_fit_problem
from gfm.sim.batch import HybridBatch
from gfm.sim.hybrid import ForceLimits, HybridModel

#: Length of a window, and from one window to the next, s.
_AHEAD_S, _EVERY_S = 0.2, 0.1
#: What counts as near: x, y (m) and yaw (rad), as exact as cameras are.
_NEAR = np.array([1e-3, 1e-3, 1e-2])
#: Of the object's six generalized forces, those in the plane.
_PLANE = np.array([0, 1, 5])
#: Fits end after so many steps; those that lead nowhere are damped, by so many times the prior.
_ROUNDS, _DAMPING = 5, 100.0
#: Of the weight: where derivatives are taken, and how large forces are thought to be.
_STEP, _LIKELY = 0.02, 0.5


def object_forces(model: HybridModel, recordings: Sequence[Trajectory]) -> list[Array]:
    """Returns the force that the object lacks in each control period, shape (K, 6) each.

    Not clipped to the force limits: N in the world, N m in the object's frame. Where friction holds
    the object, whatever the force, it is none; what the last window says holds until the end.

    Raises:
        RecordingError: a recording is shorter than a window, or has no object.
    """
    free = replace(model, limits=ForceLimits(object_n=1e3, object_nm=1e3))
    periods = max(1, round(_AHEAD_S / model.control_period_s))
    joints = len(model.layout.joint_names)
    scale = np.ones(2 * joints + 6)
    problem = make_fit_problem(free, recordings, horizon=periods, history=0, scale=scale.tolist())
    every = max(1, round(_EVERY_S / model.control_period_s))
    start = _every(problem, every)
    found, of = _in_six(_fitted(problem, start)), problem.windows.recording
    forces = []
    for i in range(len(recordings)):
        own = found[of[start] == i]
        window = np.minimum(np.arange(np.count_nonzero(of == i) - 1) // every, len(own) - 1)
        forces.append(own[window])
    return forces


def _every(problem: FitProblem, every: int) -> NDArray[np.intp]:
    """Returns every so-manieth start of every recording."""
    start, of = problem.windows.start, problem.windows.recording
    return np.concatenate([start[of[start] == i][::every] for i in np.unique(of)])


def _fitted(problem: FitProblem, start: NDArray[np.intp]) -> Array:
    """Returns the forces in the plane of all windows, N, N, N m, (W, 3), by Gauss-Newton."""
    step = _STEP * _weight(problem)
    likely = _LIKELY / _STEP * step
    force = np.zeros((len(start), 3))
    end, slope = _ends(problem, start, force, step)
    cost, damping = _cost(end, force / likely), np.zeros(len(start))
    for _ in range(_ROUNDS):
        prior = (1.0 + damping[:, None]) / likely**2
        normal = np.einsum("wca,wcb->wab", slope, slope) + prior[:, None] * np.eye(3)
        downhill = np.einsum("wca,wc->wa", slope, end) + force / likely**2
        trial = force - np.linalg.solve(normal, downhill[..., None])[..., 0]
        new_end, new_slope = _ends(problem, start, trial, step)
        new_cost = _cost(new_end, trial / likely)
        better = new_cost < cost
        force[better], end[better] = trial[better], new_end[better]
        slope[better], cost[better] = new_slope[better], new_cost[better]
        damping = np.where(better, 0.1 * damping, np.maximum(10.0 * damping, _DAMPING))
    return force


def _cost(end: Array, force: Array) -> Array:
    return np.asarray((end**2).sum(axis=1) + (force**2).sum(axis=1))


def _weight(problem: FitProblem) -> Array:
    """Returns the object's weight as two forces, N, and at its radius of gyration, N m, (3,)."""
    model, dof = problem.model.any_model, problem.model.layout.object_dof
    body = int(model.dof_bodyid[dof.start])
    weight = float(model.body_mass[body]) * float(np.linalg.norm(model.opt.gravity) or 9.81)
    radius = float(np.sqrt(model.body_inertia[body].max() / model.body_mass[body]))
    return weight * np.array([1.0, 1.0, radius])


def _ends(
    problem: FitProblem, start: NDArray[np.intp], force: Array, step: Array
) -> tuple[Array, Array]:
    """Returns how far windows end from the recording, shape (W, 3), and its slope, (W, 3, 3)."""
    moved = [force, *(force + step * axis for axis in np.eye(3))]
    count = len(start)
    ends = _end(problem, np.tile(start, 4), np.concatenate(moved)).reshape(4, count, 3)
    slope = (ends[1:] - ends[0]) / step[:, None, None]
    return ends[0], np.asarray(slope.transpose(1, 2, 0))


def _end(problem: FitProblem, start: NDArray[np.intp], force: Array) -> Array:
    """Returns how far the object is from the recording at the end of windows, shape (W, 3)."""
    model, windows = problem.model, problem.windows
    batch = HybridBatch(model, len(start))
    batch.reset(
        np.arange(len(start)),
        [windows.models[i] for i in windows.recording[start]],
        windows.qpos[start],
        windows.qvel[start],
        windows.command_before(start),
    )
    acting = np.zeros((len(start), len(model.force_limit)))
    acting[:, -6:] = _in_six(force)
    for period in range(problem.horizon):
        batch.step(windows.command[start + period], acting)
    after = start + problem.horizon
    difference = state_difference(
        model.layout, batch.qpos, batch.qvel, windows.qpos[after], windows.qvel[after]
    )
    return np.asarray(difference[:, -6:][:, _PLANE] / _NEAR)


def _in_six(force: Array) -> Array:
    """Returns forces in the plane, shape (W, 3), as all six of the object."""
    six = np.zeros((len(force), 6))
    six[:, _PLANE] = force
    return six
