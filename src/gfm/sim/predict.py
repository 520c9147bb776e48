"""What plants predict for recordings: open-loop rollouts from a given state, in batch.

Shape letters: T measurements of a segment, J joints, K time steps.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco import batch, rollout

from gfm.core.checks import Array
from gfm.effects import EffectInstance
from gfm.sim.commands import BEFORE, InForce, commands_at, stepping_commands
from gfm.sim.compensation import CompensationError, compensation_error
from gfm.sim.instants import sensors_at, states_at, states_before
from gfm.sim.late_servos import Feedback, LateServos, late_servos
from gfm.sim.motor_sides import ahead_of_link, motor_of
from gfm.sim.plant import Plant, drive_dofs, with_servo_gain
from gfm.sim.processors import processors
from gfm.sim.segment import Prediction, Segment
from gfm.sim.step_laws import LawsAtWork, Moment, StepLaws, step_laws

#: Memory that one call of the batched rollout may fill, bytes.
CHUNK_BYTES = 200e6
#: Degrees of freedom that a thread must have to step, or it waits longer than it works.
THREAD_DOF = 60


@dataclass
class _Job:
    plant: Plant
    segment: Segment
    place: tuple[int, int]
    steps: int
    model: mujoco.MjModel = field(init=False)
    servos: LateServos | None = field(init=False)
    compensation: CompensationError | None = field(init=False)

    def __post_init__(self) -> None:
        here, segment = self.plant, self.segment
        model = with_servo_gain(here.model, here.actuator, segment.kind, segment.servo_gain)
        self.model, self.servos = late_servos(here, model)
        self.compensation = compensation_error(self.plant, self.segment.position)


@dataclass(frozen=True, kw_only=True)
class _Settings:
    threads: int
    in_force: InForce
    efforts: bool


def predict(
    plants: Sequence[Plant],
    segments: Sequence[Segment],
    *,
    in_force: InForce = BEFORE,
    efforts: bool = True,
    threads: int | None = None,
) -> list[list[Prediction]]:
    """Returns the prediction of every plant for every segment, plants first.

    Args:
        plants: What to simulate.
        segments: What to predict.
        in_force: Under which commands of nearly the same stamp efforts are told.
        efforts: Whether to tell them where none were measured, too.
        threads: On how many to simulate; as many as there are processors for it by default.
    """
    settings = _Settings(threads=threads or processors(), in_force=in_force, efforts=efforts)
    answers: list[list[Prediction | None]] = [[None] * len(segments) for _ in plants]
    for jobs in _batches(plants, segments):
        run = _step_by_step if jobs[0].plant.stepwise else _rollout
        for job, prediction in zip(jobs, run(jobs, settings), strict=True):
            answers[job.place[0]][job.place[1]] = prediction
    return [[p for p in row if p is not None] for row in answers]


def _batches(plants: Sequence[Plant], segments: Sequence[Segment]) -> Iterator[list[_Job]]:
    """Yields jobs that can run together: same layout, similar length, bounded memory."""
    groups: dict[tuple[object, ...], list[_Job]] = defaultdict(list)
    for p, plant in enumerate(plants):
        names = tuple(effect.key for effect in plant.stepwise)
        for s, segment in enumerate(segments):
            end_s = segment.time_s[-1] + max(plant.effort_apart_s, 0.0)
            steps = int(np.ceil(end_s / plant.model.opt.timestep - 1e-6)) + 1
            key = (plant.layout, names, bool(plant.compensations), steps.bit_length())
            groups[key].append(_Job(plant, segment, (p, s), steps))
    for jobs in groups.values():
        jobs.sort(key=lambda job: job.steps)
        model = jobs[0].plant.model
        width = 1 + model.nq + model.nv + model.na + model.nsensordata + model.nu
        most = max(1, int(CHUNK_BYTES / (8 * width * jobs[-1].steps)))
        for start in range(0, len(jobs), most):
            yield jobs[start : start + most]


def _rollout(jobs: list[_Job], settings: _Settings) -> list[Prediction]:
    steps = max(job.steps for job in jobs)
    controls = _controls(jobs, steps)
    inputs, what = controls, mujoco.mjtState.mjSTATE_CTRL.value
    if jobs[0].plant.compensations:
        inputs = np.concatenate([controls, np.stack([_forces(j, steps) for j in jobs])], axis=2)
        what |= mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
    initial = _initial_states(jobs)
    with _quiet():
        states, _ = rollout.rollout(
            [job.model for job in jobs],
            [mujoco.MjData(jobs[0].model) for _ in range(min(settings.threads, len(jobs)))],
            initial,
            inputs,
            control_spec=what,
            persistent_pool=True,
        )
        return _predictions(jobs, initial, states, settings)


def _forces(job: _Job, steps: int) -> Array:
    """Returns the generalized forces of every time step, at its middle, shape (K, nv)."""
    if job.compensation is None:
        return np.zeros((steps, job.model.nv))
    grid = job.model.opt.timestep * (np.arange(steps) + 0.5)
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


def _initial_states(jobs: list[_Job]) -> Array:
    """Returns the state in which each simulation begins, shape (len(jobs), S)."""
    plants = {id(job.plant): job.plant for job in jobs}
    data = mujoco.MjData(jobs[0].model)  # of all: models that run together are of one layout
    at_rest = {key: _at_rest(plant.model, data) for key, plant in plants.items()}
    states = np.stack([at_rest[id(job.plant)] for job in jobs])
    nq, nv = jobs[0].model.nq, jobs[0].model.nv
    for job, state in zip(jobs, states, strict=True):
        _set_initial(job, data, state[1 : 1 + nq], state[1 + nq : 1 + nq + nv])
    return states


def _at_rest(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    mujoco.mj_resetData(model, data)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def _set_initial(job: _Job, data: mujoco.MjData, qpos: Array, qvel: Array) -> None:
    """Writes the segment's initial state; a motor side goes with its link, under its load.

    Data are for the computations of its model.
    """
    plant, segment = job.plant, job.segment
    qpos[plant.qpos] = segment.initial_position
    qvel[plant.dof] = segment.initial_velocity
    if segment.object_pose is not None:
        free = np.flatnonzero(plant.model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))
        if len(free) == 1:
            first = int(plant.model.jnt_qposadr[free[0]])
            qpos[first : first + 7] = segment.object_pose
    with_motor = np.flatnonzero(plant.motor_qpos >= 0)
    if len(with_motor):
        load = _load(job, data, qpos)[plant.dof]
    own = np.zeros((2, len(plant.joints))) if (o := segment.initial_motor) is None else o
    for j in with_motor:
        motor = motor_of(plant, int(j))
        ahead = ahead_of_link(plant.model, motor, float(load[j]))
        qpos[plant.motor_qpos[j]] = segment.initial_position[j] + ahead + own[0, j]
        qvel[plant.model.jnt_dofadr[motor]] = segment.initial_velocity[j] + own[1, j]


def _load(job: _Job, data: mujoco.MjData, qpos: Array) -> Array:
    """Returns the torques that hold every joint at rest, beside MuJoCo's compensation, (nv,)."""
    data.qpos[:] = qpos
    mujoco.mj_fwdPosition(job.model, data)
    mujoco.mj_fwdVelocity(job.model, data)
    applied = 0.0 if job.compensation is None else job.compensation.force[0]
    return np.asarray(data.qfrc_bias - data.qfrc_gravcomp - applied)


def _controls(jobs: list[_Job], steps: int) -> Array:
    """Returns the controls of every time step, shape (len(jobs), K, nu)."""
    told = _commanded(jobs, lambda job: stepping_commands(job.plant, job.segment, steps))
    return np.stack([_as_control(job, command) for job, command in zip(jobs, told, strict=True)])


def _measured_controls(jobs: list[_Job], in_force: InForce) -> list[Array]:
    """Returns the controls under which efforts of every job are measured, shape (T, nu) each."""

    def at_measurements(job: _Job) -> Array:
        at = job.segment.time_s + job.plant.effort_apart_s
        return commands_at(job.plant, job.segment, at, in_force)

    told = _commanded(jobs, at_measurements)
    return [_as_control(*one) for one in zip(jobs, told, strict=True)]


def _commanded(jobs: list[_Job], commands: Callable[[_Job], Array]) -> list[Array]:
    """Returns the commands of every job; those that differ in something else share them."""
    known: dict[Hashable, Array] = {}
    keys = [
        (job.place[1], job.model.opt.timestep, job.plant.on_commands, job.plant.effort_apart_s)
        for job in jobs
    ]
    for job, key in zip(jobs, keys, strict=True):
        if key not in known:
            known[key] = commands(job)
    return [known[key] for key in keys]


def _as_control(job: _Job, command: Array) -> Array:
    control = np.zeros((len(command), job.model.nu))
    control[:, job.plant.actuator] = command
    return control


def _predictions(
    jobs: list[_Job],
    initial: Array,
    rows: Array,
    settings: _Settings,
    feedback: Feedback | None = None,
) -> list[Prediction]:
    """Returns the predictions from the states before the first and after every step.

    Args:
        jobs: What was simulated, N of them.
        initial: shape (N, S).
        rows: shape (N, K, S).
        settings: How it is told.
        feedback: What late drives felt, if there are any.
    """
    simulated = list(zip(jobs, initial, rows, strict=True))
    states = [_states(*one, one[0].segment.time_s) for one in simulated]
    at_efforts = [
        _states(*one, one[0].segment.time_s + apart)
        if (apart := one[0].plant.effort_apart_s)
        else s
        for one, s in zip(simulated, states, strict=True)
    ]
    efforts = _efforts(jobs, at_efforts, settings, feedback)
    told = zip(jobs, rows, states, efforts, strict=True)
    return [_prediction(*one) for one in told]


def _states(job: _Job, initial: Array, rows: Array, at_s: Array) -> Array:
    """Returns the states at given times, also before the first, shape (T, S)."""
    states = states_at(job.model, initial, rows, np.maximum(at_s, 0.0) / job.model.opt.timestep)
    before = at_s < 0.0
    if before.any():
        states[before] = states_before(job.plant, job.segment, initial, at_s[before])
    return states


def _prediction(job: _Job, rows: Array, states: Array, effort: Array) -> Prediction:
    goes_on = (np.diff(rows[: job.steps, 0]) > 0.0).all() and rows[0, 0] > 0.0
    return Prediction(
        position=states[:, 1 + job.plant.qpos],
        effort=effort,
        diverged=not (goes_on and np.isfinite(rows[:, 1 : 1 + job.model.nq]).all()),
    )


def _efforts(
    jobs: list[_Job], states: list[Array], settings: _Settings, feedback: Feedback | None
) -> list[Array]:
    """Returns the drive torques of every job in given states, N m, shape (T, J) each."""
    efforts = [
        np.full((len(here), len(job.plant.joints)), np.nan)
        for job, here in zip(jobs, states, strict=True)
    ]
    asked = [i for i, job in enumerate(jobs) if settings.efforts or job.segment.effort is not None]
    if not asked:
        return efforts
    controls = _measured_controls([jobs[i] for i in asked], settings.in_force)
    if feedback is not None:
        for i, own in zip(asked, controls, strict=True):
            feedback.write_at(i, jobs[i].segment.time_s + jobs[i].plant.effort_apart_s, own)
    sensors = sensors_at(
        [jobs[i].model for i in asked],
        [states[i] for i in asked],
        controls,
        threads=settings.threads,
    )
    for i, here in zip(asked, sensors, strict=True):
        plant, error = jobs[i].plant, jobs[i].compensation
        beside = 0.0 if error is None else error.drive[:, plant.dof]
        efforts[i] = here @ plant.drive.T + beside
        if (laws := _laws(plant, [plant.effects])) is not None:
            efforts[i] += laws.drive_changes(_moments(plant.model, states[i], here))
    return efforts


def _moments(model: mujoco.MjModel, states: Array, sensordata: Array) -> Moment:
    """Returns the states of one simulation, shape (T, S), as so many moments."""
    qpos, qvel = np.split(states[:, 1 : 1 + model.nq + model.nv], [model.nq], axis=1)
    return Moment(qpos=qpos, qvel=qvel, sensordata=sensordata)


def _step_by_step(jobs: list[_Job], settings: _Settings) -> list[Prediction]:
    """Simulates with effects that are evaluated at every step, all jobs side by side."""
    steps = max(job.steps for job in jobs)
    work = sum(job.model.nv for job in jobs)
    sims = _stepping_batch(
        [job.model for job in jobs], min(settings.threads, 1 + work // THREAD_DOF)
    )
    qpos, qvel = sims.bind("qpos"), sims.bind("qvel")
    initial = _initial_states(jobs)
    rows = np.repeat(initial[:, None], steps, axis=1)
    nq, nv = jobs[0].model.nq, jobs[0].model.nv
    qpos[:], qvel[:] = initial[:, 1 : 1 + nq], initial[:, 1 + nq : 1 + nq + nv]
    controls = _controls(jobs, steps).swapaxes(0, 1)
    forces = np.stack([_forces(job, steps) for job in jobs], axis=1)
    plant = jobs[0].plant
    laws = _laws(plant, [job.plant.effects for job in jobs])
    constant = np.stack([job.model.dof_frictionloss for job in jobs])
    friction, applied = sims.expand("dof_frictionloss"), sims.bind("qfrc_applied")
    at_work = None if laws is None else LawsAtWork(sims, laws, jobs[0].model.opt.timestep)
    ctrl = sims.bind("ctrl")
    moving = _moving(sims, len(jobs))
    feedback = _feedback(jobs, initial, steps)
    with _quiet():
        for k in range(steps):
            if feedback is not None:
                feedback.write(k, controls[k])
            ctrl[:], applied[:] = controls[k], forces[k]
            if at_work is not None:
                friction[:] = constant + at_work.apply(forces[k]).friction
            sims.step(nstep=1)
            for place, now in moving:
                rows[:, k, place] = now
            if feedback is not None:
                feedback.note(k, qpos, qvel)
        return _predictions(jobs, initial, rows, settings, feedback)


def _moving(sims: batch.Batch, count: int) -> list[tuple[slice, Array]]:
    """Returns what moves in simulations, each with its place in a state."""
    moving, start = [], 0
    for name in ("time", "qpos", "qvel", "act"):
        now = np.reshape(sims.bind(name), (count, -1))
        moving.append((slice(start, start + now.shape[1]), now))
        start += now.shape[1]
    return moving


def _laws(plant: Plant, effects: Sequence[Sequence[EffectInstance]]) -> StepLaws | None:
    """Returns the laws among the effects of each job, all of plants like one; None without any."""
    places = (plant.qpos, plant.dof, drive_dofs(plant.model, plant.joints))
    return step_laws(effects, plant.joints, places, plant.drive)


def _feedback(jobs: list[_Job], initial: Array, steps: int) -> Feedback | None:
    """Returns what the late drives of all jobs feel; None where no drive is late."""
    servos = [job.servos for job in jobs if job.servos is not None]
    if not servos:
        return None
    plants, segments = [job.plant for job in jobs], [job.segment for job in jobs]
    return Feedback(plants, segments, servos, initial, steps)


def _stepping_batch(models: list[mujoco.MjModel], threads: int) -> batch.Batch:
    """Returns a batch whose simulations have the models' own values wherever those differ.

    A batch over a list of models would not let single fields be written at every step.
    """
    sims = batch.Batch(models[0], nsim=len(models), nthread=min(threads, len(models)))
    different = {id(model): model for model in models}  # those of one plant are the same
    for name in _array_fields(models[0]):
        values = {key: getattr(model, name) for key, model in different.items()}
        first = values[id(models[0])]
        if any(not np.array_equal(first, value) for value in values.values()):
            sims.expand(name)[:] = np.stack([values[id(model)] for model in models])
    return sims


def _array_fields(model: mujoco.MjModel) -> list[str]:
    names = [name for name in dir(model) if not name.startswith("_")]
    arrays = [name for name in names if isinstance(getattr(model, name), np.ndarray)]
    return [name for name in arrays if np.issubdtype(getattr(model, name).dtype, np.floating)]
