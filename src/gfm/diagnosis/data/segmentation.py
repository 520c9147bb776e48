"""Recordings cut into segments: how a diagnosis' least-squares problem is made.

Shape letters: T measurements of a segment, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TypeAlias

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.core.checks import Array
from gfm.core.noise import noise_std, steady_noise, typical_noise
from gfm.diagnosis.residuals.initial_states import with_state_basis
from gfm.diagnosis.residuals.problem import Problem, timed
from gfm.diagnosis.residuals.rollouts import Noise
from gfm.diagnosis.residuals.time_steps import with_suitable_steps
from gfm.effects import EffectInstance
from gfm.effects.elements import let_friction_hold
from gfm.signals.smoothing import same_stamp_s, smooth_states, starts_at_rest
from gfm.signals.touching import (
    ENOUGH_AIR_S,
    Touch,
    at_ease,
    resting_pose,
    seconds,
    surely_in_the_air,
)
from gfm.sim.commands import AHEAD_S, HISTORY_S
from gfm.sim.plant import check_joints
from gfm.sim.segment import Segment
from gfm.sim.still import unrecorded, with_still_joints

#: Length of the segments in which effects are looked for. A servo keeps a rollout on track and a
#: torque does not; in longer ones errors add up, and fits end in the nearest of many valleys.
SERVOED = CommandKind.POSITION, CommandKind.VELOCITY
SHORT = {CommandKind.EFFORT: 0.5, **dict.fromkeys(SERVOED, 2.0)}
#: Length of those on which amounts are settled, and on which errors are told. A velocity servo
#: never regains what it loses, so that only the whole shows what adds up slowly.
LONG = {**SHORT, CommandKind.POSITION: 6.0, CommandKind.VELOCITY: float("inf")}
WHOLE = {**SHORT, **dict.fromkeys(SERVOED, float("inf"))}
#: Measurements that a segment has at least.
LEAST_MEASUREMENTS = 8
#: First row and the one behind the last.
Rows: TypeAlias = tuple[int, int]
#: Of a robot that touches nothing no contacts are looked for, nor islands in what constrains it.
_ONE_ROBOT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ISLAND)


def prepared(problem: Problem, most_s: float = float("inf")) -> Problem:
    """Returns a problem with what takes simulations to make: time steps, what states explain.

    Args:
        problem: With all segments.
        most_s: Recorded time of the segments that are kept, see `Problem.sample`; one of each
            recording is kept in any case.
    """
    kept = with_suitable_steps(problem.subset(problem.sample(most_s, of_each=1)))
    return timed(with_state_basis(kept), ())


def all_segments(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    noise: Noise | None = None,
    *,
    given: Sequence[EffectInstance] = (),
    windows_s: Mapping[CommandKind, float] = SHORT,
    placed: Sequence[EffectInstance] = (),
    touching: bool = False,
) -> Problem:
    """Returns the problem with all segments, and nothing yet that takes simulations to make.

    Initial states are as measured, and efforts taken before the command of the same stamp. The
    models are simulated accurately whatever they say themselves: a first-order step of theirs would
    show as a delay. What they drive beside the recorded joints stands still.

    Args:
        specs: The nominal model by command kind.
        recordings: What it should explain.
        noise: Of the sensors; measured where it is not given.
        given: Effects of the nominal model that `specs` cannot say.
        windows_s: Length of a rollout by kind of command, s.
        placed: Effects that say where the robot is: by it and by the model contacts are told.
        touching: Whether of the segments in which the robot touches something, beside enough
            others. If not, of those in which it touches nothing, simulated without contacts; where
            they are too few, of all.

    Raises:
        ConfigError: a recording's commands are of a kind for which there is no model, or its
            joints are not those of the others.
        UnknownNameError: a model lacks a recorded joint.
    """
    joints = recordings[0].joint_names
    check_recordings(specs, recordings)
    for spec in specs.values():
        check_joints(spec, joints)
    still = {kind: unrecorded(spec, joints) for kind, spec in specs.items()}
    accurate = {
        kind: accurately_simulated(with_still_joints(spec, still[kind]))
        for kind, spec in specs.items()
    }
    noise, segments = noise or measure_noise(recordings), list[Segment]()
    along = {kind: Touch(spec, joints, (*given, *placed)) for kind, spec in accurate.items()}
    rows, air = _rows(along, recordings, windows_s, touching=touching)
    for spec in accurate.values() if air else ():
        spec.option.disableflags |= _ONE_ROBOT
    for i, run in enumerate(recordings):
        segments += cut(run, i, noise, rows[i])
    whole = all(air[i] == [(0, len(recordings[i].time_s))] for i in air)
    return Problem(
        specs=accurate,
        joints=joints,
        segments=tuple(segments),
        noise=noise,
        given=tuple(given),
        still={name: at for one in still.values() for name, at in one.items()},
        air={} if whole else air,
    )


def airborne(recordings: Sequence[Trajectory], problem: Problem) -> list[Trajectory]:
    """Returns the pieces of recordings by which a robot is judged that touches things elsewhere."""
    return [
        recordings[i].measured_at(slice(start, end))
        for i, pieces in problem.air.items()
        for start, end in pieces
        if end - start >= LEAST_MEASUREMENTS
    ]


def _rows(
    along: Mapping[CommandKind, Touch],
    runs: Sequence[Trajectory],
    windows_s: Mapping[CommandKind, float],
    *,
    touching: bool,
) -> tuple[list[list[Rows]], dict[int, list[Rows]]]:
    """Returns the rows of each recording's segments, and of the pieces of which these are a part.

    The latter where the robot is judged by its motion in the air.

    Where it touches something, each begins with it in the air, if it can, and an object at rest.
    Nothing is followed for long then: what is touched a little earlier is soon elsewhere.
    """
    touches = [along[run.command_kind].along(run) for run in runs]
    air = surely_in_the_air(touches, runs)
    judges = seconds(air, runs) >= ENOUGH_AIR_S or not any(map(np.any, touches))
    if judges and not touching:
        return [
            [rows for piece in pieces for rows in windows(run, piece, windows_s[run.command_kind])]
            for run, pieces in zip(runs, air, strict=True)
        ], dict(enumerate(air))
    if touching and not judges:
        return [[] for _ in runs], {}
    at_rest = []
    for run in runs:
        kind = run.command_kind
        short_s = min(windows_s[kind], SHORT[kind])
        ends = [end for _, end in windows(run, (0, len(run.time_s)), short_s)]
        edges = at_ease(along[kind], run, np.array([0, *ends]))
        at_rest.append(list(pairwise(edges.tolist())))
    if touching:
        pairs = zip(at_rest, touches, strict=True)
        at_rest = [[(a, b) for a, b in rows if there[a:b].any()] for rows, there in pairs]
    return at_rest, {}


def windows(recording: Trajectory, piece: Rows, window_s: float) -> list[Rows]:
    """Returns the rows of segments of about so long in a piece of a recording, first to last.

    What is shorter than one is one.
    """
    start, end = piece
    time_s = recording.time_s[start:end] - recording.time_s[start]
    count = max(int(time_s[-1] / window_s), 1)
    edges = start + np.searchsorted(time_s, np.arange(count + 1) * min(window_s, time_s[-1]))
    edges[-1] = end
    return list(pairwise(edges.tolist()))


def accurately_simulated(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Returns a copy that is integrated by the fourth-order Runge-Kutta method.

    Its dry friction holds: what creeps by MuJoCo's default, no robot does.
    """
    accurate = spec.copy()
    accurate.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    let_friction_hold(accurate)
    return accurate


def check_recordings(
    specs: Mapping[CommandKind, mujoco.MjSpec], recordings: Sequence[Trajectory]
) -> None:
    """Raises ConfigError where commands have no model of their kind, or joints differ."""
    first = recordings[0]
    for recording in recordings:
        if recording.command_kind not in specs:
            kinds = ", ".join(sorted(specs))
            raise ConfigError(
                f"{recording.name}: its commands are of kind {recording.command_kind}, "
                f"the actuators of the model are of kind {kinds}"
            )
        if sorted(recording.joint_names) != sorted(first.joint_names):
            raise ConfigError(
                f"{recording.name}: joints {', '.join(recording.joint_names)}; "
                f"{first.name} has {', '.join(first.joint_names)}"
            )


def in_model_order(
    specs: Mapping[CommandKind, mujoco.MjSpec], recordings: Sequence[Trajectory]
) -> list[Trajectory]:
    """Returns recordings with their joints as the model has them, from the base on.

    Whatever recorded them may have gone by the alphabet, and each recording by an order of its own.
    Joints that the model lacks come last.
    """
    model = next(iter(specs.values())).copy().compile()
    place = {model.joint(i).name: i for i in range(model.njnt)}
    first = recordings[0].joint_names
    names = sorted(first, key=lambda name: place.get(name, model.njnt))
    return [recording.with_joints(names) for recording in recordings]


def measure_noise(recordings: Sequence[Trajectory]) -> Noise:
    """Returns the sensor noise over the recordings.

    That of efforts is the typical one; they may well be noisier where they are large.
    """
    efforts = [(r.time_s, r.effort) for r in recordings if r.effort is not None]
    return Noise(
        position=steady_noise([(r.time_s, r.position) for r in recordings]),
        effort=typical_noise(efforts) if efforts else None,
    )


def _own_effort_noise(recording: Trajectory, noise: Noise) -> Array | None:
    """Returns the noise of one recording's efforts, shape (J,): the usual one of those at rest."""
    if recording.effort is None or noise.effort is None:
        return None
    own = noise_std(recording.time_s, recording.effort)
    return np.where(np.ptp(recording.effort, axis=0) > 0.0, own, noise.effort)


def cut(recording: Trajectory, index: int, noise: Noise, rows: Sequence[Rows]) -> list[Segment]:
    """Returns the segments of a recording that are rolled out.

    What rests at first begins with no speed at all: where nothing holds a joint (play in a gear,
    friction that is missing in the model), a speed made of noise would carry it away. What has next
    to no measurements is left out.

    Args:
        recording: What is cut.
        index: Its place among others.
        noise: Of the sensors.
        rows: Of each segment.
    """
    time_s = recording.time_s
    position, velocity, _ = smooth_states(time_s, recording.position)
    effort_noise = _own_effort_noise(recording, noise)
    together_s = same_stamp_s(recording.command_time_s, time_s)
    segments = []
    for start, end in rows:
        if end - start < LEAST_MEASUREMENTS:
            continue
        here = slice(start, end)
        resting = starts_at_rest(time_s[here], recording.position[here], noise.position)
        commanded_s, command = _commands(recording, float(time_s[start]), float(time_s[end - 1]))
        segments.append(
            Segment(
                time_s=time_s[here] - time_s[start],
                position=recording.position[here],
                effort=None if recording.effort is None else recording.effort[here],
                effort_noise=effort_noise,
                same_stamp_s=together_s,
                kind=recording.command_kind,
                command_time_s=commanded_s,
                command=command,
                initial_position=position[start],
                initial_velocity=np.where(resting, 0.0, velocity[start]),
                servo_gain=recording.gains,
                recording=index,
                object_pose=resting_pose(recording, int(recording.stamp_ns[start])),
            )
        )
    return segments


def _commands(recording: Trajectory, start_s: float, end_s: float) -> tuple[Array, Array]:
    """Returns the commands in force between two times, and those shortly before for delays.

    And those shortly after: their clock may be behind.

    First when each took effect, from the first time on, s, shape (C,), then what, shape (C, J).
    """
    time_s = recording.command_time_s
    first = max(int(np.searchsorted(time_s, start_s - HISTORY_S, side="right")) - 1, 0)
    last = max(int(np.searchsorted(time_s, end_s + AHEAD_S, side="right")), first + 1)
    return time_s[first:last] - start_s, recording.command[first:last]
