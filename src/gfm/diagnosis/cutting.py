"""Recordings cut into stretches: how a diagnosis' least-squares problem is made.

Shape letters: T measurements of a stretch, J joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.noise import noise_std, steady_noise, typical_noise
from gfm.diagnosis.problem import Noise, Problem, timed, with_state_basis
from gfm.diagnosis.signals import smooth_states, starts_at_rest
from gfm.effects import EffectInstance
from gfm.sim.plant import check_joints, make_plant
from gfm.sim.predict import HISTORY_S, Segment

#: Length of the stretches in which effects are looked for. A servo keeps a rollout on track and a
#: torque does not; in longer ones errors add up, and fits end in the nearest of many valleys.
SHORT: Mapping[CommandKind, float] = {
    CommandKind.POSITION: 2.0,
    CommandKind.VELOCITY: 2.0,
    CommandKind.EFFORT: 0.5,
}
#: Length of those on which amounts are settled, and on which errors are told: what a servo keeps
#: on track is told from first to last.
LONG: Mapping[CommandKind, float] = {
    **SHORT,
    CommandKind.POSITION: 12.0,
    CommandKind.VELOCITY: 12.0,
}
WHOLE: Mapping[CommandKind, float] = {
    **SHORT,
    CommandKind.POSITION: float("inf"),
    CommandKind.VELOCITY: float("inf"),
}
#: Share of a period within which stamps are the same, and the share of commands that have another
#: one so near unless clocks run free: by chance a fifth of them do.
NEAR_STAMP, MOSTLY = 0.1, 0.8
#: Way of an object from which on it slides, within so much time.
SLIDING_M, SLIDING_S = 2e-3, 0.1
#: Times around a stretch's first moment in which the pose of what rests is averaged, longest first.
RESTING_S = (0.5, 0.2, 0.05)
#: Places along a recording at which contacts are looked for.
CONTACT_LOOKS = 300


def make_problem(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    noise: Noise | None = None,
    *,
    given: Sequence[EffectInstance] = (),
    windows_s: Mapping[CommandKind, float] = SHORT,
    most_s: float = float("inf"),
) -> Problem:
    """Returns the problem of explaining `recordings` by the models `specs`, with `given` in them.

    Args:
        specs: The nominal model by command kind.
        recordings: What it should explain.
        noise: Of the sensors; measured where it is not given.
        given: Effects of the nominal model that `specs` cannot say.
        windows_s: Length of a rollout by kind of command, s.
        most_s: Recorded time of the stretches that are kept, see `Problem.sample`; one of each
            recording is kept in any case.

    Raises:
        ConfigError: a recording's commands are of a kind for which there is no model, or its
            joints are not those of the others.
        UnknownNameError: a model lacks a recorded joint.
    """
    problem = all_stretches(specs, recordings, noise, given=given, windows_s=windows_s)
    problem = with_state_basis(problem.subset(problem.sample(most_s, of_each=1)))
    return timed(problem, ())


def all_stretches(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    noise: Noise | None = None,
    *,
    given: Sequence[EffectInstance] = (),
    windows_s: Mapping[CommandKind, float] = SHORT,
) -> Problem:
    """Returns the problem with all stretches, and nothing yet that takes simulations to make.

    Initial states are as measured, and efforts taken before the command of the same stamp. The
    models are integrated to fourth order whatever they say themselves: a first-order step of theirs
    would show as a delay. Arguments and errors as of `make_problem`.
    """
    joints = recordings[0].joint_names
    check_recordings(specs, recordings)
    for spec in specs.values():
        check_joints(spec, joints)
    accurate = {kind: accurately_integrated(spec) for kind, spec in specs.items()}
    touch = {kind: Touch(spec, joints) for kind, spec in accurate.items()}
    for kind, spec in accurate.items():
        if not any(touch[kind].ever(r) for r in recordings if r.command_kind is kind):
            spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
            del touch[kind]
    noise = noise or measure_noise(recordings)
    segments = tuple(
        segment
        for i, recording in enumerate(recordings)
        for segment in _cut_as_it_touches(recording, i, noise, windows_s, touch)
    )
    return Problem(
        specs=accurate, joints=joints, segments=segments, noise=noise, given=tuple(given)
    )


def _cut_as_it_touches(
    recording: Trajectory,
    index: int,
    noise: Noise,
    windows_s: Mapping[CommandKind, float],
    touch: Mapping[CommandKind, Touch],
) -> list[Segment]:
    """Returns a recording's stretches; short ones where things are touched.

    Nothing is followed for long then: what is touched a little earlier is soon elsewhere.
    """
    kind = recording.command_kind
    if kind not in touch:
        return cut(recording, index, noise, windows_s[kind])
    return cut(recording, index, noise, min(windows_s[kind], SHORT[kind]), touch[kind])


def accurately_integrated(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Returns a copy that is integrated by the fourth-order Runge-Kutta method."""
    accurate = spec.copy()
    accurate.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    return accurate


class Touch:
    """Looks for contacts of the robot, as recorded."""

    def __init__(self, spec: mujoco.MjSpec, joints: Sequence[str]) -> None:
        self._plant = make_plant(spec, joints)
        model = self._plant.model
        self._data = mujoco.MjData(model)
        self._free = model.jnt_qposadr[model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE)]
        tree = model.body_treeid[model.geom_bodyid]
        self._robot = np.isin(tree, model.dof_treeid[self._plant.dof])

    def ever(self, recording: Trajectory) -> bool:
        """Returns whether the robot touches anything; looking for it at every step takes time."""
        step = max(len(recording.position) // CONTACT_LOOKS, 1)
        return any(self.at(recording, row) for row in range(0, len(recording.position), step))

    def at(self, recording: Trajectory, row: int) -> bool:
        """Returns whether it touches anything at one measurement."""
        model, data = self._plant.model, self._data
        data.qpos[self._plant.qpos] = recording.position[row]
        pose = _object_pose(recording, int(recording.stamp_ns[row]))
        if pose is not None and len(self._free) == 1:
            data.qpos[self._free[0] : self._free[0] + 7] = pose
        mujoco.mj_fwdPosition(model, data)
        return bool(self._robot[data.contact.geom[: data.ncon]].any())


def _object_pose(recording: Trajectory, stamp_ns: int) -> Array | None:
    """Returns the recorded pose of the object next to a time, shape (7,); None where none is."""
    track = recording.object_track
    if track is None or not len(track.stamp_ns):
        return None
    nearest = int(np.argmin(np.abs(track.stamp_ns - stamp_ns)))
    return np.concatenate([track.position[nearest], track.quaternion[nearest]])


def _resting_pose(recording: Trajectory, stamp_ns: int) -> Array | None:
    """Returns the mean pose around a time if the object rests there, else the one next to it.

    A tenth of a millimetre decides whether something is touched or missed.
    """
    track, pose = recording.object_track, _object_pose(recording, stamp_ns)
    if track is None or pose is None or _slides(recording, stamp_ns):
        return pose
    for reach_s in RESTING_S:
        near = np.abs(track.stamp_ns - stamp_ns) <= 1e9 * reach_s
        ends = track.position[near][[0, -1]]
        if np.linalg.norm(ends[1] - ends[0]) <= SLIDING_M:
            break
    turned = track.quaternion[near]
    turned = turned * np.sign(turned @ pose[3:])[:, None]  # q and -q are one rotation
    mean = turned.mean(axis=0)
    return np.concatenate([track.position[near].mean(axis=0), mean / np.linalg.norm(mean)])


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


def _at_ease(touch: Touch, recording: Trajectory, edges: Array) -> Array:
    """Returns edges moved to the next row at which nothing is touched and an object rests.

    One that has none before the next edge is left out; the first one stays then.
    """
    moved = [
        next((row for row in range(start, end) if _is_at_ease(touch, recording, row)), None)
        for start, end in pairwise(edges.tolist())
    ]
    kept = [row for row in moved if row is not None]
    first = [] if moved[0] is not None else [0]
    return np.array([*first, *kept, edges[-1]])


def _is_at_ease(touch: Touch, recording: Trajectory, row: int) -> bool:
    return not (_slides(recording, int(recording.stamp_ns[row])) or touch.at(recording, row))


def _slides(recording: Trajectory, stamp_ns: int) -> bool:
    """Returns whether an object moves at a time, farther than its measurement's noise lets it."""
    half_ns = int(0.5e9 * SLIDING_S)
    poses = [_object_pose(recording, stamp_ns + shift) for shift in (-half_ns, half_ns)]
    if poses[0] is None or poses[1] is None:
        return False
    return bool(np.linalg.norm(poses[1][:3] - poses[0][:3]) > SLIDING_M)


def _same_stamp_s(recording: Trajectory) -> float:
    """Returns how far apart a command and a measurement are of the same stamp, s.

    Nothing where clocks run free: there, what is near another is so by chance.
    """
    command_s, time_s = recording.command_time_s, recording.time_s
    periods = [float(np.median(np.diff(t))) for t in (command_s, time_s) if len(t) > 1]
    after = np.clip(np.searchsorted(time_s, command_s), 1, len(time_s) - 1)
    apart = np.minimum(np.abs(command_s - time_s[after]), np.abs(command_s - time_s[after - 1]))
    near_s = NEAR_STAMP * min(periods)
    return near_s if np.mean(apart <= near_s) >= MOSTLY else 0.0


def _own_effort_noise(recording: Trajectory, noise: Noise) -> Array | None:
    """Returns the noise of one recording's efforts, shape (J,): the usual one of those at rest."""
    if recording.effort is None or noise.effort is None:
        return None
    own = noise_std(recording.time_s, recording.effort)
    return np.where(np.ptp(recording.effort, axis=0) > 0.0, own, noise.effort)


def cut(
    recording: Trajectory,
    index: int,
    noise: Noise,
    window_s: float,
    touch: Touch | None = None,
) -> list[Segment]:
    """Returns the stretches of a recording that are rolled out, first to last.

    Where the robot may touch something, each begins with it in the air, if it can, and an object at
    rest: how far two things are in each other decides about their forces, and no measurement is as
    exact; nor is the speed of an object measured.

    What rests at first begins with no speed at all: where nothing holds a joint (play in a gear,
    friction that is missing in the model), a speed made of noise would carry it away.
    """
    time_s = recording.time_s
    position, velocity, _ = smooth_states(time_s, recording.position)
    count = max(int(time_s[-1] / window_s), 1)
    edges = np.searchsorted(time_s, np.arange(count + 1) * min(window_s, time_s[-1]))
    edges[-1] = len(time_s)
    if touch is not None:
        edges = _at_ease(touch, recording, edges)
    effort_noise, together_s = _own_effort_noise(recording, noise), _same_stamp_s(recording)
    gain = np.array([recording.servo_gain.get(name, 1.0) for name in recording.joint_names])
    segments = []
    for start, end in pairwise(edges):
        if end - start < 8:
            continue
        here = slice(int(start), int(end))
        resting = starts_at_rest(time_s[here], recording.position[here], noise.position)
        segments.append(
            Segment(
                time_s=time_s[here] - time_s[start],
                position=recording.position[here],
                effort=None if recording.effort is None else recording.effort[here],
                effort_noise=effort_noise,
                same_stamp_s=together_s,
                kind=recording.command_kind,
                **_commands(recording, float(time_s[start]), float(time_s[end - 1])),
                initial_position=position[start],
                initial_velocity=np.where(resting, 0.0, velocity[start]),
                servo_gain=gain,
                recording=index,
                object_pose=_resting_pose(recording, int(recording.stamp_ns[start])),
            )
        )
    return segments


def _commands(recording: Trajectory, start_s: float, end_s: float) -> dict[str, Array]:
    """Returns the commands in force between two times, and those shortly before for delays."""
    time_s = recording.command_time_s
    first = max(int(np.searchsorted(time_s, start_s - HISTORY_S, side="right")) - 1, 0)
    last = max(int(np.searchsorted(time_s, end_s, side="right")), first + 1)
    return {
        "command_time_s": time_s[first:last] - start_s,
        "command": recording.command[first:last],
    }
