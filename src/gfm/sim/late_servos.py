"""Drives whose torque acts later, with all that it depends on: law(u(t-d), q(t-d), v(t-d)).

MuJoCo reads commands late and states at once. Here a drive is a plain motor to it, and what the
motor is told is the torque of its law, from where the joint was a moment ago.

Shape letters: N simulations, L late drives, K time steps, T times, S numbers of a state.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.sim.instants import states_before
from gfm.sim.plant import Plant, acts_on_servo
from gfm.sim.segment import Segment

Index: TypeAlias = NDArray[np.intp]
#: Laws of drives that are a sum: gain times command, and a bias of position and velocity.
_SUMS = (
    (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_NONE),
    (mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class LateServos:
    """Laws of the late drives of one simulation.

    Attributes:
        actuator: Which they are, shape (L,).
        qpos: Address of what each moves, its motor side where there is one, shape (L,).
        dof: The same in qvel, shape (L,).
        gear: Of each, shape (L,).
        late_s: By how much later it acts, s, shape (L,).
        gain: Of its command, shape (L,).
        bias: A constant, and of its length and speed, shape (L, 3).
        limits: Least and largest command, shape (L, 2).
    """

    actuator: Index
    qpos: Index
    dof: Index
    gear: Array
    late_s: Array
    gain: Array
    bias: Array
    limits: Array

    def torque(self, command: Array, position: Array, velocity: Array) -> Array:
        """Returns what the drives give, shape (..., L), from what they felt, of the same shape."""
        told = np.clip(command, self.limits[:, 0], self.limits[:, 1])
        felt = self.bias[:, 1] * position + self.bias[:, 2] * velocity
        return np.asarray(self.gain * told + self.bias[:, 0] + self.gear * felt)


def late_servos(plant: Plant, model: mujoco.MjModel) -> tuple[mujoco.MjModel, LateServos | None]:
    """Returns the model with late drives as plain motors, and their laws; as it is without any.

    Drives that are no sum of a gain and a bias (a DC motor) take their command late only.

    Args:
        plant: Whose drives they are.
        model: Of the plant, with the gains of its servos.
    """
    named = {name for e in plant.effects if acts_on_servo(e) for name in e.joints}
    there = [j for j, name in enumerate(plant.joints) if name in named]
    late = [j for j in there if _is_sum(model, plant, j)]
    if not late:
        return model, None
    actuator = plant.actuator[late]
    moved = model.actuator_trnid[actuator, 0]
    limited = model.actuator_ctrllimited[actuator].astype(bool)[:, None]
    servos = LateServos(
        actuator=actuator,
        qpos=model.jnt_qposadr[moved].astype(np.intp),
        dof=model.jnt_dofadr[moved].astype(np.intp),
        gear=model.actuator_gear[actuator, 0].copy(),
        late_s=plant.servo_late_s[late],
        gain=model.actuator_gainprm[actuator, 0].copy(),
        bias=model.actuator_biasprm[actuator, :3].copy(),
        limits=np.where(limited, model.actuator_ctrlrange[actuator], [-np.inf, np.inf]),
    )
    motors = copy.copy(model)
    motors.actuator_gainprm[actuator, 0] = 1.0
    motors.actuator_biasprm[actuator, :3] = 0.0
    motors.actuator_ctrllimited[actuator] = False
    return motors, servos


def _is_sum(model: mujoco.MjModel, plant: Plant, joint: int) -> bool:
    actuator = plant.actuator[joint]
    law = (int(model.actuator_gaintype[actuator]), int(model.actuator_biastype[actuator]))
    return law in [(int(gain), int(bias)) for gain, bias in _SUMS]


@final
class Feedback:
    """What late drives of N simulations feel, while these are stepped and afterwards.

    Args:
        plants: Of each simulation.
        segments: What each predicts.
        servos: Its late drives, as many in all of them.
        initial: The state in which each begins, shape (N, S).
        steps: How many are taken.
    """

    def __init__(
        self,
        plants: Sequence[Plant],
        segments: Sequence[Segment],
        servos: Sequence[LateServos],
        initial: Array,
        steps: int,
    ) -> None:
        self._servos, self._step_s = list(servos), float(plants[0].model.opt.timestep)
        self._late = np.stack([one.late_s for one in servos]) / self._step_s
        self._first = int(np.ceil(self._late.max())) + 1
        before_s = self._step_s * np.arange(-self._first, 1.0)
        shape = (len(plants), self._first + 1 + steps, self._late.shape[1])
        self._position, self._velocity = np.zeros(shape), np.zeros(shape)
        one, nq = servos[0], plants[0].model.nq
        for i, (plant, segment) in enumerate(zip(plants, segments, strict=True)):
            states = states_before(plant, segment, initial[i], before_s)
            self._position[i, : self._first + 1] = states[:, 1 + one.qpos]
            self._velocity[i, : self._first + 1] = states[:, 1 + nq + one.dof]
        # What holds for a whole step is taken from its middle; from two states that are known.
        self._behind = np.minimum(np.floor(0.5 - self._late), -1.0).astype(np.intp)
        self._share = 0.5 - self._late - self._behind

    def write(self, step: int, control: Array) -> None:
        """Writes the torques of a coming step over the commands that they come from, (N, nu)."""
        here = np.arange(len(control))[:, None], self._first + step + self._behind
        felt = self._felt(np.arange(self._late.shape[1]), here, self._share)
        for row, one, q, v in zip(control, self._servos, *felt, strict=True):
            row[one.actuator] = one.torque(row[one.actuator], q, v)

    def note(self, step: int, qpos: Array, qvel: Array) -> None:
        """Notes where a step led: positions (N, nq) and velocities (N, nv)."""
        one = self._servos[0]
        self._position[:, self._first + step + 1] = qpos[:, one.qpos]
        self._velocity[:, self._first + step + 1] = qvel[:, one.dof]

    def write_at(self, index: int, at_s: Array, control: Array) -> None:
        """Does what `write` does for times of one simulation, s, shape (T,), controls (T, nu)."""
        one = self._servos[index]
        place = self._first + at_s[:, None] / self._step_s - self._late[index]
        low = np.clip(np.floor(place).astype(np.intp), 0, self._position.shape[1] - 2)
        q, v = self._felt(np.arange(len(one.actuator)), (np.intp(index), low), place - low)
        control[:, one.actuator] = one.torque(control[:, one.actuator], q, v)

    def _felt(
        self, drives: Index, here: tuple[Index | np.intp, Index], share: Array
    ) -> tuple[Array, Array]:
        """Returns positions and velocities between two neighbours of the grid."""
        which, low = here
        speed = self._velocity[which, low, drives]
        gained = self._velocity[which, low + 1, drives] - speed
        way = share * self._step_s * (speed + 0.5 * share * gained)
        return self._position[which, low, drives] + way, speed + share * gained
