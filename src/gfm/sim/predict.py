"""What plants predict for recordings: open-loop rollouts from a given state, in batch.

Shape letters: T measurements of a segment, J joints, K time steps.
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco import batch, rollout
from numpy.typing import NDArray
from scipy.signal import lfilter

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.sim.compensation import CompensationError, compensation_error
from gfm.sim.motor_sides import ahead_of_link, motor_of
from gfm.sim.plant import Plant, with_servo_gain
from gfm.sim.step_laws import middle_of_step, step_laws

#: Memory that one call of the batched rollout may fill, bytes.
CHUNK_BYTES = 200e6
#: Degrees of freedom that a thread must have to step, or it waits longer than it works.
THREAD_DOF = 60
#: Change of a command beside a larger one that is the share of a step before it came, at most.
MIXED = 0.1
#: How long before a segment commands are looked at: delays and lags remember them, s.
HISTORY_S = 0.6


@dataclass(frozen=True, kw_only=True, eq=False)
class Segment:
    """A stretch of one recording, to be predicted from its initial state.

    Attributes:
        time_s: Measurement times from the start of the segment, shape (T,).
        position: Measured, rad, shape (T, J).
        effort: Measured drive torque, N m, shape (T, J), or None.
        kind: What the commands are.
        command_time_s: When each command took effect, on the same clock, shape (C,).
        command: rad, rad/s or N m, shape (C, J).
        initial_position: rad, shape (J,).
        initial_velocity: rad/s, shape (J,).
        servo_gain: Factor on the servo's gain, shape (J,).
        recording: Index of the recording that it was cut from.
        effort_noise: Standard deviation of that recording's efforts, N m, shape (J,), or None.
        same_stamp_s: How far apart a command and a measurement are of the same stamp, s.
        initial_motor: How far motor sides are ahead of where their loads hold them, rad, and how
            much faster than their links they are, rad/s, shape (2, J); None for not at all.
        object_pose: Where a free object is at first, m and quaternion w x y z, shape (7,); None
            where that is not known.
    """

    time_s: Array
    position: Array
    effort: Array | None
    kind: CommandKind
    command_time_s: Array
    command: Array
    initial_position: Array
    initial_velocity: Array
    servo_gain: Array
    recording: int = 0
    effort_noise: Array | None = None
    same_stamp_s: float = 0.0
    initial_motor: Array | None = None
    object_pose: Array | None = None


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What a plant predicts for a segment, at its measurement times.

    Attributes:
        position: rad, shape (T, J).
        effort: Drive torque at each measurement time, under the command before that of the same
            stamp, N m, shape (T, J).
        effort_after: The same under the command of the same stamp, shape (T, J).
        diverged: Whether the simulation broke off.
    """

    position: Array
    effort: Array
    effort_after: Array
    diverged: bool


@dataclass
class _Job:
    plant: Plant
    segment: Segment
    place: tuple[int, int]
    steps: int
    model: mujoco.MjModel = field(init=False)
    compensation: CompensationError | None = field(init=False)

    def __post_init__(self) -> None:
        here, segment = self.plant, self.segment
        self.model = with_servo_gain(here.model, here.actuator, segment.kind, segment.servo_gain)
        self.compensation = compensation_error(self.plant, self.segment.position)


def predict(
    plants: Sequence[Plant], segments: Sequence[Segment], *, threads: int | None = None
) -> list[list[Prediction]]:
    """Returns the prediction of every plant for every segment, plants first."""
    answers: list[list[Prediction | None]] = [[None] * len(segments) for _ in plants]
    for jobs in _batches(plants, segments):
        run = _step_by_step if jobs[0].plant.stepwise else _rollout
        for job, prediction in zip(jobs, run(jobs, threads or os.cpu_count() or 1), strict=True):
            answers[job.place[0]][job.place[1]] = prediction
    return [[p for p in row if p is not None] for row in answers]


def _batches(plants: Sequence[Plant], segments: Sequence[Segment]) -> Iterator[list[_Job]]:
    """Yields jobs that can run together: same layout, similar length, bounded memory."""
    groups: dict[tuple[object, ...], list[_Job]] = defaultdict(list)
    for p, plant in enumerate(plants):
        names = tuple(effect.key for effect in plant.stepwise)
        for s, segment in enumerate(segments):
            steps = int(np.ceil(segment.time_s[-1] / plant.model.opt.timestep - 1e-6)) + 1
            key = (plant.layout, names, bool(plant.compensations), steps.bit_length())
            groups[key].append(_Job(plant, segment, (p, s), steps))
    for jobs in groups.values():
        jobs.sort(key=lambda job: job.steps)
        model = jobs[0].plant.model
        width = 1 + model.nq + model.nv + model.na + model.nsensordata + model.nu
        most = max(1, int(CHUNK_BYTES / (8 * width * jobs[-1].steps)))
        for start in range(0, len(jobs), most):
            yield jobs[start : start + most]


def _rollout(jobs: list[_Job], threads: int) -> list[Prediction]:
    steps = max(job.steps for job in jobs)
    controls = np.stack([_controls(job, steps) for job in jobs])
    inputs, what = controls, mujoco.mjtState.mjSTATE_CTRL.value
    if jobs[0].plant.compensations:
        inputs = np.concatenate([controls, np.stack([_forces(j, steps) for j in jobs])], axis=2)
        what |= mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
    with _quiet():
        states, sensors = rollout.rollout(
            [job.model for job in jobs],
            [mujoco.MjData(jobs[0].model) for _ in range(min(threads, len(jobs)))],
            np.stack([_initial_state(job) for job in jobs]),
            inputs,
            control_spec=what,
            persistent_pool=True,
        )
    nq = jobs[0].model.nq
    return [
        _prediction(job, states[i, :, 0], states[i, :, 1 : 1 + nq], sensors[i], controls[i])
        for i, job in enumerate(jobs)
    ]


def _forces(job: _Job, steps: int) -> Array:
    """Returns the generalized forces of every time step, shape (K, nv)."""
    if job.compensation is None:
        return np.zeros((steps, job.model.nv))
    grid = job.model.opt.timestep * np.arange(steps)
    columns = [np.interp(grid, job.segment.time_s, f) for f in job.compensation.force.T]
    return np.stack(columns, axis=1)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps MuJoCo from printing that a candidate's simulation diverged: that is an answer."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _initial_state(job: _Job) -> Array:
    model, data = job.model, mujoco.MjData(job.model)
    _set_initial(job, data.qpos, data.qvel)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def _set_initial(job: _Job, qpos: Array, qvel: Array) -> None:
    """Writes the segment's initial state; a motor side goes with its link, under its load."""
    plant, segment = job.plant, job.segment
    qpos[plant.qpos] = segment.initial_position
    qvel[plant.dof] = segment.initial_velocity
    free = np.flatnonzero(plant.model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
    if segment.object_pose is not None and len(free) == 1:
        first = int(plant.model.jnt_qposadr[free[0]])
        qpos[first : first + 7] = segment.object_pose
    with_motor = np.flatnonzero(plant.motor_qpos >= 0)
    if len(with_motor):
        load = _load(job, qpos)[plant.dof]
    own = np.zeros((2, len(plant.joints))) if (o := segment.initial_motor) is None else o
    for j in with_motor:
        motor = motor_of(plant, int(j))
        ahead = ahead_of_link(plant.model, motor, float(load[j]))
        qpos[plant.motor_qpos[j]] = segment.initial_position[j] + ahead + own[0, j]
        qvel[plant.model.jnt_dofadr[motor]] = segment.initial_velocity[j] + own[1, j]


def _load(job: _Job, qpos: Array) -> Array:
    """Returns the torques that hold every joint at rest, beside MuJoCo's compensation, (nv,)."""
    data = mujoco.MjData(job.model)
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(job.model, data)
    mujoco.mj_fwdVelocity(job.model, data)
    applied = 0.0 if job.compensation is None else job.compensation.force[0]
    return np.asarray(data.qfrc_bias - data.qfrc_gravcomp - applied)


def _controls(job: _Job, steps: int) -> Array:
    """Returns the control of every time step, shape (K, nu)."""
    controls = np.zeros((steps, job.model.nu))
    controls[:, job.plant.actuator] = applied_commands(job.plant, job.segment, steps)
    return controls


def applied_commands(plant: Plant, segment: Segment, steps: int) -> Array:
    """Returns the mean command of every time step after delays and lags, shape (K, J).

    A command that changes within a time step counts by its share of it, so that predictions are
    smooth in a delay. What was commanded shortly before the segment counts, too: a lag remembers.
    """
    period_s = plant.model.opt.timestep
    before = round(HISTORY_S / period_s)
    grid = period_s * np.arange(-before, steps + 1)
    columns = []
    for j, name in enumerate(plant.joints):
        here = [e for e in plant.effects if name in e.joints and not e.in_model]
        time_s = segment.command_time_s
        for instance in here:
            time_s = instance.effect.retime(time_s, instance.values)
        column = _held_means(grid, time_s, segment.command[:, j])
        lag_s = sum(e.effect.lag_s(e.values) for e in here)
        columns.append(_lagged_means(column, lag_s, period_s)[before:])
    return np.stack(columns, axis=1)


def _held_means(grid: Array, time_s: Array, value: Array) -> Array:
    """Returns the mean over each grid interval of a value held from each time to the next."""
    before = min(float(time_s[0]), float(grid[0])) - 1.0
    after = max(float(time_s[-1]), float(grid[-1])) + 1.0
    knots = np.concatenate([[before], time_s, [after]])
    held = np.concatenate([[value[0]], value])
    integral = np.concatenate([[0.0], np.cumsum(held * np.diff(knots))])
    return np.asarray(np.diff(np.interp(grid, knots, integral)) / np.diff(grid))


def _lagged_means(value: Array, lag_s: float, period_s: float) -> Array:
    """Returns the means over each step of a first-order lag's answer to a stepwise value."""
    if lag_s <= 0.0:
        return value
    decay = float(np.exp(-period_s / lag_s))
    # State at the start of each step: y+ = decay y + (1 - decay) u, settled at the first value.
    filtered = lfilter([1.0 - decay], [1.0, -decay], value, zi=np.array([decay * value[0]]))[0]
    start = np.concatenate([[value[0]], filtered[:-1]])
    return np.asarray(value + (start - value) * (lag_s / period_s) * (1.0 - decay))


def _prediction(
    job: _Job, time_s: Array, qpos: Array, sensors: Array, controls: Array
) -> Prediction:
    """Returns the prediction at the measurement times from what each step left behind.

    State k is that after step k; sensors k are those before it.
    """
    segment, plant = job.segment, job.plant
    period_s = job.model.opt.timestep
    after = np.concatenate([segment.initial_position[None], qpos[:, plant.qpos]])
    drive, command = sensors @ plant.drive.T, controls[:, plant.actuator]
    broken = bool(np.any(np.diff(time_s[: job.steps]) <= 0.0)) or not np.isfinite(after).all()
    beside = 0.0 if job.compensation is None else job.compensation.drive[:, plant.dof]
    place, apart = segment.time_s / period_s, max(segment.same_stamp_s / period_s, 1e-6)
    return Prediction(
        position=_sample(after, place),
        effort=_drive_at(drive, command, place, -apart) + beside,
        effort_after=_drive_at(drive, command, place, apart) + beside,
        diverged=broken,
    )


def _sample(values: Array, place: Array) -> Array:
    """Returns rows of `values` interpolated linearly at fractional row numbers."""
    low = np.clip(np.floor(place + 1e-9).astype(np.intp), 0, len(values) - 2)
    share = (place - low)[:, None]
    return np.asarray((1.0 - share) * values[low] + share * values[low + 1])


def _drive_at(drive: Array, command: Array, place: Array, later: float) -> Array:
    """Returns the drive torque at fractional row numbers, shape (T, J).

    Row k of `drive` holds at the start of step k, under the command of that step. Within a step
    the torque goes on to the next row where the command stays the same, and else as it came. The
    command is that of the step `later` rows on: stamps jitter.
    """
    last = len(drive) - 1
    row = np.clip(np.floor(place + later).astype(np.intp), 0, last)
    share = (place - row)[:, None]
    before, after = np.maximum(row - 1, 0), np.minimum(row + 1, last)
    rising, risen = command[after] - command[row], command[row] - command[before]
    onward = np.where(_next_to_none(rising, risen), drive[after] - drive[row], np.nan)
    backward = np.where(_next_to_none(risen, rising), drive[row] - drive[before], 0.0)
    return np.asarray(drive[row] + share * np.where(np.isnan(onward), backward, onward))


def _next_to_none(change: Array, neighbour: Array) -> NDArray[np.bool_]:
    """Returns where a command stays: a step in which it changed has a little of both."""
    return np.abs(change) <= np.maximum(MIXED * np.abs(neighbour), 1e-8)


def _step_by_step(jobs: list[_Job], threads: int) -> list[Prediction]:
    """Simulates with effects that are evaluated at every step, all jobs side by side."""
    steps = max(job.steps for job in jobs)
    work = sum(job.model.nv for job in jobs)
    sims = _stepping_batch([job.model for job in jobs], min(threads, 1 + work // THREAD_DOF))
    qpos, qvel = sims.bind("qpos"), sims.bind("qvel")
    for i, job in enumerate(jobs):
        _set_initial(job, qpos[i], qvel[i])
    controls = np.stack([_controls(job, steps) for job in jobs], axis=1)
    forces = np.stack([_forces(job, steps) for job in jobs], axis=1)
    plant = jobs[0].plant
    places, own = (plant.qpos, plant.dof), [job.plant.effects for job in jobs]
    laws = step_laws(own, plant.joints, places, plant.drive)
    constant = np.stack([job.model.dof_frictionloss for job in jobs])
    friction, applied = sims.expand("dof_frictionloss"), sims.bind("qfrc_applied")
    qacc, step_s = sims.bind("qacc"), jobs[0].model.opt.timestep
    time_s, kept_qpos, kept_sensors = [], [], []
    clock, sensordata, ctrl = sims.bind("time"), sims.bind("sensordata"), sims.bind("ctrl")
    with _quiet():
        for k in range(steps):
            ctrl[:], applied[:] = controls[k], forces[k]
            if laws is not None:
                sims.forward()  # the drives' torques under this step's commands
                now = middle_of_step(step_s, qpos, qvel, qacc, sensordata)
                friction[:] = laws.levels(constant, now)
                applied[:] += laws.forces(now)
            sims.step(nstep=1)
            time_s.append(np.array(clock).reshape(len(jobs)))
            kept_qpos.append(np.array(qpos))
            kept_sensors.append(np.array(sensordata))
    times, positions, sensors = np.stack(time_s), np.stack(kept_qpos), np.stack(kept_sensors)
    return [
        _prediction(job, times[:, i], positions[:, i], sensors[:, i], controls[:, i])
        for i, job in enumerate(jobs)
    ]


def _stepping_batch(models: list[mujoco.MjModel], threads: int) -> batch.Batch:
    """Returns a batch whose simulations have the models' own values wherever those differ.

    A batch over a list of models would not let single fields be written at every step.
    """
    sims = batch.Batch(models[0], nsim=len(models), nthread=min(threads, len(models)))
    for name in _array_fields(models[0]):
        values = [getattr(model, name) for model in models]
        if any(not np.array_equal(values[0], value) for value in values[1:]):
            sims.expand(name)[:] = np.stack(values)
    return sims


def _array_fields(model: mujoco.MjModel) -> list[str]:
    names = [name for name in dir(model) if not name.startswith("_")]
    arrays = [name for name in names if isinstance(getattr(model, name), np.ndarray)]
    return [name for name in arrays if np.issubdtype(getattr(model, name).dtype, np.floating)]
