"""Many hybrid simulations, stepped natively: no Python per physics step.

With one exception: an effect whose dry friction depends on the state (Stribeck, load), or whose
force MuJoCo cannot express, is evaluated in Python before every step, for all instances at once.

Shape letters: N instances, n of them, J joints, A generalized forces, S integration steps per
control period.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import final

import mujoco
import numpy as np
from mujoco import batch as mujoco_batch
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.sim.hybrid import HybridModel
from gfm.sim.layout import Indices
from gfm.sim.levelled import LevelledModels

_UNSTABLE = [
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
]
_COUNT = 1  # column of b.warning


@final
class HybridBatch:
    """N simulations of a hybrid model on MuJoCo's thread pool.

    Every instance starts with the first of the models; `reset` may give it another one.

    Attributes:
        qpos: Live positions, shape (N, nq).
        qvel: Live velocities, shape (N, nv).
    """

    def __init__(self, model: HybridModel, num_envs: int, *, nthread: int = 1) -> None:
        _count_warnings_silently()
        self.model = model
        self.num_envs = num_envs
        self._batch = mujoco_batch.Batch(model.any_model, num_envs, nthread)
        self._models = [model.any_model] * num_envs
        self.qpos: Array = self._batch.bind("qpos")
        self.qvel: Array = self._batch.bind("qvel")
        self._ctrl: Array = self._batch.bind("ctrl")
        self._force: Array = self._batch.bind("qfrc_applied")
        self._act: Array = self._batch.bind("act")
        self._history: Array = self._batch.bind("history")
        self._driven = model.layout.driven
        self._actuator = model.layout.actuator[self._driven]
        self._compensation = model.erring_compensation()
        laws = model.step_laws(num_envs)
        self._levelled = None if laws is None else LevelledModels(self._batch, laws, self._models)

    def reset(
        self,
        ids: Indices,
        models: Sequence[mujoco.MjModel],
        qpos: Array,
        qvel: Array,
        command: Array | None = None,
    ) -> None:
        """Starts the instances `ids` anew.

        Args:
            ids: Which, shape (n,).
            models: What each of them runs on from now.
            qpos: shape (n, nq).
            qvel: shape (n, nv).
            command: The one in force until now, for models that delay or filter commands,
                shape (n, J).
        """
        for index, model in zip(ids, models, strict=True):
            self._models[index] = model
        if self._levelled is None:
            self._batch.set_models(self._models)
        else:
            self._levelled.take(ids, models)
        self._batch.reset(ids, stage=int(mujoco.mjtStage.mjSTAGE_NONE))
        self.qpos[ids] = qpos
        self.qvel[ids] = qvel
        if command is not None:
            self._settle(ids, command)
        if self._levelled is not None:
            self._tell_drives(ids, command)

    def step(self, command: Array, force: Array) -> NDArray[np.bool_]:
        """Advances every instance by one control period under constant generalized forces.

        An instance that diverges is put back to where it was before.

        Args:
            command: Held over the period, shape (N, J), or one per integration step, (N, S, J).
            force: Clipped to its limits, shape (N, A).

        Returns:
            Which instances diverged, shape (N,).
        """
        return self._guarded(command, force, record=())[0]

    def step_recorded(self, command: Array, force: Array) -> tuple[NDArray[np.bool_], Array, Array]:
        """Does what `step` does with commands per integration step, and records each of these.

        Returns:
            Which instances diverged, positions (N, S, nq) and velocities (N, S, nv) after each
            integration step. What diverged repeats the state before the period.
        """
        diverged, record = self._guarded(command, force, record=("qpos", "qvel"))
        record["qpos"][diverged] = self.qpos[diverged, None]
        record["qvel"][diverged] = self.qvel[diverged, None]
        return diverged, record["qpos"], record["qvel"]

    def carry(self, force: Array, joints: Array, speeds: Array) -> NDArray[np.bool_]:
        """Advances every instance by one control period in which the robot moves as it is told.

        Its joints are set after every integration step, whatever its drives do; what it touches
        feels their speed. For the rest as `step`.

        Args:
            force: Clipped to its limits, shape (N, A).
            joints: rad, after every integration step, shape (N, S, J).
            speeds: rad/s, the same shape.
        """
        layout, count = self.model.layout, joints.shape[1]

        def advance() -> NDArray[np.bool_]:
            failed = np.zeros(self.num_envs, bool)
            for k in range(count):
                failed |= self._failing(self._batch.step)
                self.qpos[:, layout.qpos], self.qvel[:, layout.dof] = joints[:, k], speeds[:, k]
            return failed

        return self._kept(advance, force)

    def _guarded(
        self, command: Array, force: Array, record: tuple[str, ...]
    ) -> tuple[NDArray[np.bool_], dict[str, Array]]:
        records = self._records(command, record)
        return self._kept(lambda: self._advance(command, records), force), records

    def _kept(self, advance: Callable[[], NDArray[np.bool_]], force: Array) -> NDArray[np.bool_]:
        """Advances under forces, puts back what diverges, and returns that, shape (N,)."""
        before = self.qpos.copy(), self.qvel.copy()
        limit = self.model.force_limit
        self._force[:] = self._compensation_force()
        self._force[:, self.model.force_dof] += np.clip(force, -limit, limit)
        unstable = self._batch.warning[:, _UNSTABLE, _COUNT].sum(axis=1)
        diverged = advance()
        diverged |= self._batch.warning[:, _UNSTABLE, _COUNT].sum(axis=1) > unstable
        if diverged.any():
            self.qpos[diverged], self.qvel[diverged] = before[0][diverged], before[1][diverged]
        return diverged

    def _compensation_force(self) -> Array | float:
        """Returns what the robot's gravity compensation does wrong, at the middle of the period.

        It varies slowly with the position, which goes on as it goes now.
        """
        if self._compensation is None:
            return 0.0
        qpos = self.qpos.copy()
        dof, half_s = self.model.layout.dof, 0.5 * self.model.control_period_s
        qpos[:, self.model.layout.qpos] += half_s * self.qvel[:, dof]
        return self._compensation.at(qpos).force

    def _records(self, command: Array, names: tuple[str, ...]) -> dict[str, Array]:
        """Returns room for what a rollout records."""
        sizes = {"qpos": self.qpos.shape[1], "qvel": self.qvel.shape[1]}
        return {name: np.zeros((*command.shape[:2], sizes[name])) for name in names}

    def _advance(self, command: Array, records: dict[str, Array]) -> NDArray[np.bool_]:
        """Steps over one control period; returns in which instances MuJoCo gave up, shape (N,)."""
        driven = command[..., self._driven]
        if self._levelled is not None:
            return self._advance_levelled(self._levelled, driven, records)
        if driven.ndim == 2:
            self._ctrl[:, self._actuator] = driven
            return self._failing(lambda: self._batch.step(nstep=self.model.substeps))
        control = np.zeros((*driven.shape[:2], self._ctrl.shape[1]))
        control[..., self._actuator] = driven
        names, count = tuple(records), driven.shape[1]
        return self._failing(lambda: self._batch.rollout(count, control, record=names, out=records))

    def _advance_levelled(
        self, levelled: LevelledModels, driven: Array, records: dict[str, Array]
    ) -> NDArray[np.bool_]:
        """Does what `_advance` does, with friction and forces written before every step."""
        failed, force = np.zeros(self.num_envs, bool), self._force.copy()
        for k in range(driven.shape[1] if driven.ndim == 3 else self.model.substeps):
            self._ctrl[:, self._actuator] = driven if driven.ndim == 2 else driven[:, k]
            levelled.write(force)
            failed |= self._failing(self._batch.step)
            for name, record in records.items():
                record[:, k] = getattr(self, name)
        return failed

    def _failing(self, advance: Callable[[], object]) -> NDArray[np.bool_]:
        """Returns for which instances MuJoCo raised an error, shape (N,)."""
        failed = np.zeros(self.num_envs, bool)
        try:
            advance()
        except mujoco_batch.SimulationError as error:
            failed[error.ids] = True
        return failed

    def _tell_drives(self, ids: Indices, command: Array | None) -> None:
        """Computes the drives' torques in new states: the first levels depend on them."""
        if command is not None:
            self._ctrl[np.ix_(ids, self._actuator)] = command[:, self._driven]
        self._batch.forward(ids)

    def _settle(self, ids: Indices, command: Array) -> None:
        """Writes delays and filters as if `command` had always been in force (MuJoCo: zero)."""
        for index, row in zip(ids, command, strict=True):
            model = self._models[index]
            if model.na:
                self._act[index] = initial_activation(model, self.model.layout.actuator, row)
            if model.nhistory:
                self._history[index] = self._initial_history(model, row)

    def _initial_history(self, model: mujoco.MjModel, command: Array) -> Array:
        data = mujoco.MjData(model)
        for actuator, value in zip(self._actuator, command[self._driven], strict=True):
            if samples := int(model.actuator_history[actuator, 0]):
                values = np.full((samples, 1), value)
                mujoco.mj_initCtrlHistory(model, data, int(actuator), None, values)
        return np.array(data.history)


def initial_activation(model: mujoco.MjModel, actuators: Indices, command: Array) -> Array:
    """Returns activations, filters settled at the command in force, the rest zero, shape (na,).

    Args:
        model: Of the robot.
        actuators: Of each joint, -1 where it has none, shape (J,).
        command: Of each joint, shape (J,).
    """
    filters = (int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT))
    activation = np.zeros(model.na)
    for actuator, value in zip(actuators, command, strict=True):
        if actuator >= 0 and int(model.actuator_dyntype[actuator]) in filters:
            activation[model.actuator_actadr[actuator]] = value
    return activation


def _count_warnings_silently() -> None:
    """Keeps MuJoCo from writing MUJOCO_LOG.TXT into the current folder, unless told otherwise.

    Nothing is lost: `step` counts the warnings of every instance and returns who diverged.
    """
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_ignore)


def _ignore(_message: str) -> None:
    """Drops a warning that has been counted."""
