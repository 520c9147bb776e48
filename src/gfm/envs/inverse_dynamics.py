"""Actions that lead on one model where other actions lead on another.

Christiano et al. 2016 (arXiv 1610.03518): a policy's own model says which state comes next, and the
inverse dynamics of the robot say which action leads there. They learn these from the robot's data;
here a corrected model stands for the robot, and is differentiated.

Shape letters: N instances, J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from gfm.core.checks import Array, Array32
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem
from gfm.sim.batch import HybridBatch

_ITERATIONS = 2
#: Of an action, for the derivatives: a good part of what there is, so that a joint that dry
#: friction holds is felt to move.
_STEP = 0.1
#: Of what an action of 1 does to a joint without any load, squared: what moves less than a tenth of
#: that (behind a delay, at a stop) is left as it is.
_DAMPING = 0.01


@dataclass(frozen=True, kw_only=True)
class ArmState:
    """Where simulations stand.

    Attributes:
        qpos: All positions, shape (N, nq).
        qvel: All velocities, shape (N, nv).
        action: In force until now, shape (N, J).
    """

    qpos: Array
    qvel: Array
    action: Array32


@final
class InverseDynamics:
    """Finds the actions under which a model's joints move as those of the policy's own model.

    One control period is looked ahead. Damped Gauss-Newton steps on the joint positions at its
    end, the derivatives by differences; actions stay within [-1, 1]. Where a joint cannot be moved
    within the period, its action stays as it was.

    Args:
        own: The model for which actions were chosen.
        other: The model on which they shall lead to the same place.
        num_envs: N.
        nthread: Threads of the physics.
    """

    def __init__(
        self, own: ArmProblem, other: ArmProblem, num_envs: int, *, nthread: int = 1
    ) -> None:
        self._joints = len(other.velocity_limit)
        self._own = _OnePeriod(own, num_envs, nthread)
        self._other = _OnePeriod(other, num_envs * (self._joints + 1), nthread)
        self._unit = CONTROL_PERIOD_S * other.velocity_limit
        #: By how much more the other model's encoders read.
        self._more = other.zero - own.zero
        self._angles = other.model.layout.qpos

    def __call__(self, state: ArmState, action: Array32) -> Array32:
        """Returns such actions, shape (N, J).

        Args:
            state: Where the instances stand, by the encoders of the other model.
            action: As chosen for the policy's own model, in [-1, 1], shape (N, J).
        """
        qpos = state.qpos.copy()
        qpos[:, self._angles] -= self._more
        wanted = self._own.ends(replace(state, qpos=qpos), action) + self._more
        copies = ArmState(
            **{
                name: np.repeat(array, self._joints + 1, axis=0)
                for name, array in vars(state).items()
            }
        )
        found = action.astype(float)
        for _ in range(_ITERATIONS):
            found = np.clip(found + self._correction(copies, found, wanted), -1.0, 1.0)
        return found.astype(np.float32)

    def _correction(self, copies: ArmState, action: Array, wanted: Array) -> Array:
        """Returns a step towards the wanted joint positions, shape (N, J)."""
        step = np.where(action > 0.0, -_STEP, _STEP)  # inwards: what lies outside is clipped
        tried = np.repeat(action[:, None], self._joints + 1, axis=1)
        joints = np.arange(self._joints)
        tried[:, joints + 1, joints] += step
        ends = self._other.ends(copies, tried.reshape(-1, self._joints)) / self._unit
        ends = ends.reshape(len(action), self._joints + 1, self._joints)
        missing = wanted / self._unit - ends[:, 0]
        slopes = (ends[:, 1:] - ends[:, :1]) / step[
            :, :, None
        ]  # (N, by which action, of which joint)
        square = slopes @ slopes.swapaxes(1, 2) + _DAMPING * np.eye(self._joints)
        return np.asarray(np.linalg.solve(square, slopes @ missing[:, :, None])[:, :, 0])


@final
class _OnePeriod:
    """Steps a model for one control period from given states."""

    def __init__(self, arm: ArmProblem, num_envs: int, nthread: int) -> None:
        self._arm = arm
        self._batch = HybridBatch(arm.model, num_envs, nthread=nthread)
        self._ids = np.arange(num_envs)
        self._models = [arm.nominal] * num_envs
        self._no_force = np.zeros((num_envs, len(arm.model.force_limit)))

    def ends(self, state: ArmState, action: Array | Array32) -> Array:
        """Returns the joint positions at its end, rad, shape (N, J)."""
        limit, batch = self._arm.velocity_limit, self._batch
        batch.reset(self._ids, self._models, state.qpos, state.qvel, state.action * limit)
        for _ in range(self._arm.repeats):
            batch.step(action * limit, self._no_force)
        return batch.qpos[:, self._arm.model.layout.qpos]
