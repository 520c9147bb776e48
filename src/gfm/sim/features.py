"""What a generalized force model sees: the newest states and what the drives are told to do.

The paper's GFM observes the current state and the five before it. Ours sees, in addition, the
torque that the nominal drives give at this moment for the command in force: the servo's input is
known wherever the model is used, and effects on the command's side (a wrong gain, saturation,
friction that grows with load) are no function of the state alone.

Shape letters: N instances, J joints, X state size, H earlier states, O observation size, W states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array, Array32
from gfm.sim.drive import drive_law, drive_torque
from gfm.sim.layout import Layout
from gfm.sim.replay import Replay

#: Least scales: what stands still in the recordings must not be blown up. rad or m, rad/s or m/s,
#: N m.
_LEAST_POSITION, _LEAST_VELOCITY, _LEAST_TORQUE = 0.02, 0.02, 0.1


@dataclass(frozen=True, kw_only=True)
class Features:
    """Fixed scales, and the observation made with them. Newest state first, drive torques last.

    Attributes:
        history: H, earlier states in the observation.
        mean: Of the recorded states: joints' positions and velocities, then the object's position,
            quaternion and velocity, shape (X,).
        scale: Their standard deviations, not below a floor, shape (X,).
        torque_scale: Root mean square drive torque of the recordings, N m, shape (J,).
    """

    history: int
    mean: Array
    scale: Array
    torque_scale: Array

    @property
    def state_size(self) -> int:
        """X."""
        return len(self.mean)

    @property
    def size(self) -> int:
        """O."""
        return (self.history + 1) * self.state_size + len(self.torque_scale)

    def state(self, layout: Layout, qpos: Array, qvel: Array) -> Array32:
        """Returns scaled states, shape (..., X), of qpos (..., nq) and qvel (..., nv)."""
        state = _raw_state(layout, qpos, qvel)
        if layout.has_object:  # q and -q are one rotation: take the one near the recorded ones
            quaternion = _quaternion_columns(layout)
            side = (state[..., quaternion] * self.mean[quaternion]).sum(axis=-1, keepdims=True)
            state[..., quaternion] *= np.where(side < 0.0, -1.0, 1.0)
        return ((state - self.mean) / self.scale).astype(np.float32)

    def of_joint(self, joint: int) -> NDArray[np.bool_]:
        """Returns which inputs are about one joint: its states and its drive's torque, (O,)."""
        joints = len(self.torque_scale)
        state = np.isin(np.arange(self.state_size), [joint, joints + joint])
        return np.concatenate([np.tile(state, self.history + 1), np.arange(joints) == joint])

    def of_object(self) -> NDArray[np.bool_]:
        """Returns which inputs are about the object's states, (O,); none where there is none."""
        joints = len(self.torque_scale)
        state = np.arange(self.state_size) >= 2 * joints
        return np.concatenate([np.tile(state, self.history + 1), np.zeros(joints, bool)])

    def of_now(self) -> NDArray[np.bool_]:
        """Returns which inputs are the newest state and the drives' torques, (O,)."""
        index = np.arange(self.size)
        return (index < self.state_size) | (index >= self.size - len(self.torque_scale))

    def fill(self, observation: Array32, states: Array32) -> None:
        """Writes the history, oldest state first, shape (n, H + 1, X), into (n, O)."""
        observation[:, : -len(self.torque_scale)] = states[:, ::-1].reshape(len(states), -1)

    def push(self, observation: Array32, state: Array32) -> None:
        """Moves every state of (N, O) one place back and puts `state`, shape (N, X), in front."""
        size, end = self.state_size, (self.history + 1) * self.state_size
        observation[:, size:end] = observation[:, : end - size].copy()
        observation[:, :size] = state

    def put_torque(self, observation: Array32, torque: Array) -> None:
        """Writes drive torques, N m, shape (N, J)."""
        observation[:, -len(self.torque_scale) :] = torque / self.torque_scale


def make_features(layout: Layout, replays: Sequence[Replay], history: int = 5) -> Features:
    """Returns the features with scales from the recordings."""
    states = np.concatenate([_raw_state(layout, r.qpos, r.qvel) for r in replays])
    torques = np.concatenate([_recorded_torque(layout, replay) for replay in replays])
    joints, objects = len(layout.joint_names), 6 if layout.has_object else 0
    floor = np.full(states.shape[1], _LEAST_POSITION)
    floor[joints : 2 * joints] = _LEAST_VELOCITY
    floor[len(floor) - objects :] = _LEAST_VELOCITY
    rms: Array = np.sqrt((torques**2).mean(axis=0))
    return Features(
        history=history,
        mean=states.mean(axis=0),
        scale=np.maximum(states.std(axis=0), floor),
        torque_scale=np.maximum(rms, _LEAST_TORQUE),
    )


def _recorded_torque(layout: Layout, replay: Replay) -> Array:
    law = drive_law(replay.model, layout)
    command = replay.command[: replay.periods, 0]
    return drive_torque(law, command, replay.qpos[:-1, layout.qpos], replay.qvel[:-1, layout.dof])


def _raw_state(layout: Layout, qpos: Array, qvel: Array) -> Array:
    parts = [qpos[..., layout.qpos], qvel[..., layout.dof]]
    if layout.has_object:
        parts += [qpos[..., layout.object_qpos], qvel[..., layout.object_dof]]
    return np.concatenate(parts, axis=-1)


def _quaternion_columns(layout: Layout) -> slice:
    start = 2 * len(layout.joint_names) + 3
    return slice(start, start + 4)
