"""How far an object is from where it was recorded, where the robot moves as it was measured.

A rollout begins where the object still rests, for its pose there is a mean over many looks of a
camera. In the midst of a push it is as wrong as one look, and contacts make five millimetres of
that within a second: that would hide what forces are worth. The robot's part is no question here.

Shape letters: P pushes, K control periods, S integration steps in each, J joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array, Array32
from gfm.envs.difference import state_difference
from gfm.sim.batch import HybridBatch
from gfm.sim.drive import drive_law, drive_torque
from gfm.sim.features import Features
from gfm.sim.hybrid import HybridModel
from gfm.sim.replay import Replay, make_replay
from gfm.sim.rollout import ForcePolicy

#: How far the object moves in a push, m.
MOVES_M = 0.005
#: Of a push, s: how long the object rests before it at least, how long before that way a rollout
#: begins, and the longest that it is followed.
_REST_S, _BEFORE_S, _LONGEST_S = 0.1, 0.16, 2.0

#: The object's six generalized forces, (P, 6), in a control period, from qpos and qvel.
ObjectForces = Callable[[int, Array, Array], Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class Pushes:
    """Pushes from rest, each as long as the longest: `live` says how far it was recorded.

    Attributes:
        models: With each recording's servo gains, P of them.
        recording: Which recording each push is of, shape (P,).
        begin_qpos: The object at rest, shape (P, nq).
        begin_qvel: shape (P, nv).
        command: In force, shape (P, K, S, J).
        joints: Where the robot was after every integration step, rad, shape (P, K, S, J).
        speeds: How fast it was there, rad/s, the same shape.
        qpos: Recorded after every period, shape (P, K, nq).
        qvel: The same, shape (P, K, nv).
        live: Whether the period was recorded, shape (P, K).
    """

    models: tuple[mujoco.MjModel, ...]
    recording: NDArray[np.intp]
    begin_qpos: Array
    begin_qvel: Array
    command: Array
    joints: Array
    speeds: Array
    qpos: Array
    qvel: Array
    live: NDArray[np.bool_]

    def __len__(self) -> int:
        """P."""
        return len(self.models)

    def of(self, recordings: Sequence[int]) -> Pushes:
        """Returns those of some recordings."""
        chosen = np.flatnonzero(np.isin(self.recording, recordings))
        models = tuple(self.models[i] for i in chosen)
        rows = {name: getattr(self, name)[chosen] for name in vars(self) if name != "models"}
        return Pushes(models=models, **rows)


@dataclass(frozen=True, kw_only=True)
class ObjectErrors:
    """Where the object is in pushes.

    Attributes:
        pushes: Their number.
        place_m: Root mean square distance in the plane, m.
        yaw_rad: Root mean square of the yaw, rad.
    """

    pushes: int
    place_m: float
    yaw_rad: float


def make_pushes(model: HybridModel, recordings: Sequence[Trajectory]) -> Pushes:
    """Returns every push from rest in some recordings; there may be none.

    Raises:
        RecordingError: a recording has no object, or other joints than the model's.
    """
    longest = round(_LONGEST_S / model.control_period_s)
    found, of = [], []
    for i, recording in enumerate(recordings):
        replay = make_replay(model, recording)
        for rest, begin in _beginnings(model, replay, longest):
            found.append(_push(model, replay, rest, begin, longest))
            of.append(i)
    models = tuple(model for model, _ in found)
    names = ("begin_qpos", "begin_qvel", "command", "joints", "speeds", "qpos", "qvel", "live")
    rows = {name: np.array([push[name] for _, push in found]) for name in names}
    return _cut(Pushes(models=models, recording=np.array(of, np.intp), **rows))


def _cut(pushes: Pushes) -> Pushes:
    """Returns pushes without the periods that none of them has."""
    if not pushes:
        return pushes
    count = int(pushes.live.sum(axis=1).max())
    names = ("command", "joints", "speeds", "qpos", "qvel", "live")
    return replace(pushes, **{name: getattr(pushes, name)[:, :count] for name in names})


def _beginnings(model: HybridModel, replay: Replay, longest: int) -> Iterator[tuple[int, int]]:
    """Yields from where on the object rests, and where its rollout begins, of every push."""
    place = replay.qpos[:, model.layout.object_qpos][:, :2]
    rest, before = (max(1, round(s / model.control_period_s)) for s in (_REST_S, _BEFORE_S))
    first = 0
    while first < replay.periods:
        way = place[first:] - place[first : first + rest].mean(axis=0)
        away = np.flatnonzero(np.linalg.norm(way, axis=1) > MOVES_M)
        if not len(away):
            return
        begin = first + int(away[0]) - before
        if begin - first < rest:
            first += rest
            continue
        yield first, begin
        first = begin + longest


def _push(
    model: HybridModel, replay: Replay, rest: int, begin: int, longest: int
) -> tuple[mujoco.MjModel, dict[str, Array]]:
    """Returns the model of a push, and its rows of `Pushes`."""
    layout, substeps = model.layout, model.substeps
    count = min(longest, replay.periods - begin)
    period = begin + np.minimum(np.arange(longest), count - 1)
    offset = model.timestep_s * np.arange(1, substeps + 1)
    time_s = replay.start_s + model.control_period_s * period[:, None] + offset
    qpos, qvel = replay.qpos[begin].copy(), replay.qvel[begin].copy()
    pose = replay.qpos[rest : begin + 1, layout.object_qpos].mean(axis=0)
    qpos[layout.object_qpos] = np.concatenate([pose[:3], pose[3:] / np.linalg.norm(pose[3:])])
    qvel[layout.object_dof] = 0.0
    shape = (longest, substeps, len(layout.joint_names))
    return replay.model, {
        "begin_qpos": qpos,
        "begin_qvel": qvel,
        "command": replay.command[period],
        "joints": replay.motion.joints(time_s.ravel()).reshape(shape),
        "speeds": replay.motion.joints(time_s.ravel(), nu=1).reshape(shape),
        "qpos": replay.qpos[period + 1],
        "qvel": replay.qvel[period + 1],
        "live": np.arange(longest) < count,
    }


def object_differences(
    model: HybridModel, pushes: Pushes, forces: ObjectForces | None = None
) -> Array:
    """Returns how far the object is from where it was recorded, shape (P, K, 6), m and rad.

    Args:
        model: Whose limits bound the forces.
        pushes: Some.
        forces: On the object; None for none.
    """
    batch = HybridBatch(model, len(pushes))
    begin = (pushes.begin_qpos, pushes.begin_qvel, pushes.command[:, 0, 0])
    batch.reset(np.arange(len(pushes)), pushes.models, *begin)
    acting = np.zeros((len(pushes), len(model.force_limit)))
    found = np.zeros((*pushes.live.shape, 6))
    for period in range(pushes.live.shape[1]):
        if forces is not None:
            acting[:, -6:] = forces(period, batch.qpos, batch.qvel)
        batch.carry(acting, pushes.joints[:, period], pushes.speeds[:, period])
        then = (pushes.qpos[:, period], pushes.qvel[:, period])
        difference = state_difference(model.layout, batch.qpos, batch.qvel, *then)
        found[:, period] = difference[:, -6:]
    return found


def object_errors(
    model: HybridModel, pushes: Pushes, forces: ObjectForces | None = None
) -> ObjectErrors:
    """Returns how far the object is from the recordings; of at least one push."""
    difference = object_differences(model, pushes, forces)[pushes.live]
    return ObjectErrors(
        pushes=len(pushes),
        place_m=float(np.sqrt(np.square(difference[:, :2]).sum(axis=1).mean())),
        yaw_rad=float(np.sqrt(np.square(difference[:, 5]).mean())),
    )


def forces_of(
    policy: ForcePolicy, features: Features, model: HybridModel, pushes: Pushes
) -> ObjectForces:
    """Returns the forces on the object of a policy, one rollout of each push, from its beginning.

    Args:
        policy: Generalized forces in units of their limits, from what is observed.
        features: What that is.
        model: Whose limits they are.
        pushes: To be rolled out.
    """
    layout = model.layout
    law = np.stack([drive_law(one, layout) for one in pushes.models])
    seen: Array32 = np.zeros((len(pushes), features.size), np.float32)

    def forces(period: int, qpos: Array, qvel: Array) -> Array:
        state = features.state(layout, qpos, qvel)
        if period == 0:
            features.fill(seen, np.repeat(state[:, None], features.history + 1, axis=1))
        else:
            features.push(seen, state)
        q, v = qpos[:, layout.qpos], qvel[:, layout.dof]
        features.put_torque(seen, drive_torque(law, pushes.command[:, period, 0], q, v))
        return np.asarray(policy(seen.copy())[:, -6:] * model.force_limit[-6:])

    return forces


def errors_under(
    policy: ForcePolicy, features: Features, model: HybridModel, pushes: Pushes
) -> ObjectErrors:
    """Returns how far the object is from the recordings under a policy: see `forces_of`."""
    return object_errors(model, pushes, forces_of(policy, features, model, pushes))
