"""Fitted generalized force models apart from the model they were fitted on, and ensembles of them.

Shape letters: N instances, n of them, J joints of a force model, A generalized forces of the model
that they act on, F forces of a force model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import ConfigError
from gfm.core.checks import Array, Array32
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.sim.drive import drive_law, drive_torque
from gfm.sim.features import Features
from gfm.sim.hybrid import HybridModel
from gfm.sim.layout import Layout, make_layout


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnedForces:
    """One fitted force model.

    Attributes:
        joint_names: The joints that it observes.
        forced_joints: Those that it acts on.
        on_object: Whether it observes a free object and acts on it.
        force_limit: N m on the forced joints; N, then N m, on the object; shape (F,).
        control_period_s: Between two decisions.
        features: What it observes.
        policy: From that to forces in units of their limits.
    """

    joint_names: tuple[str, ...]
    forced_joints: tuple[str, ...]
    on_object: bool
    force_limit: Array
    control_period_s: float
    features: Features
    policy: GaussianPolicy

    def __post_init__(self) -> None:
        expected = len(self.forced_joints) + (6 if self.on_object else 0)
        sizes = {
            "policy observes": (self.policy.observation_size, self.features.size),
            "policy gives": (self.policy.action_size, expected),
            "force limits": (len(self.force_limit), expected),
        }
        for what, (got, wanted) in sizes.items():
            if got != wanted:
                raise ConfigError(f"force model: {what} {got} numbers, expected {wanted}")

    @classmethod
    def of(cls, model: HybridModel, features: Features, policy: GaussianPolicy) -> LearnedForces:
        """Returns what was fitted on `model`."""
        names = model.layout.joint_names
        return cls(
            joint_names=names,
            forced_joints=tuple(names[i] for i in model.forced),
            on_object=model.layout.has_object,
            force_limit=model.force_limit,
            control_period_s=model.control_period_s,
            features=features,
            policy=policy,
        )

    def layout_in(self, model: mujoco.MjModel) -> Layout:
        """Returns where the model has what this observes.

        Raises:
            UnknownNameError: it lacks a joint.
            ConfigError: it lacks the object.
        """
        layout = make_layout(model, self.joint_names)
        if not self.on_object:
            return replace(layout, object_qpos=slice(0, 0), object_dof=slice(0, 0))
        if not layout.has_object:
            raise ConfigError("force model: it acts on an object, the model has none")
        return layout


@final
class ForceEnsemble:
    """Several force models for N instances; each episode has one of them.

    A force model decides as often as it did when it was fitted; in between its forces are held.
    """

    def __init__(self, members: Sequence[LearnedForces], model: HybridModel, num_envs: int) -> None:
        """Prepares instances.

        Args:
            members: At least one.
            model: What the forces act on; its period fits into those of all members.
            num_envs: N.

        Raises:
            BadInputError: a member does not go with the model.
        """
        self._members = [_Member(one, model, num_envs) for one in members]
        self._every = [round(one.control_period_s / model.control_period_s) for one in members]
        self._member: NDArray[np.intp] = np.zeros(num_envs, np.intp)
        self._held: Array = np.zeros((num_envs, len(model.force_limit)))
        self._calls = 0

    def reset(
        self,
        ids: NDArray[np.intp],
        models: Sequence[mujoco.MjModel],
        qpos: Array,
        qvel: Array,
        rng: np.random.Generator,
    ) -> None:
        """Draws a force model for each of the instances `ids`, which have rested where they are.

        Args:
            ids: shape (n,).
            models: What each of them runs on.
            qpos: shape (n, nq).
            qvel: shape (n, nv).
            rng: Where chance comes from.
        """
        self._held[ids] = 0.0
        self._member[ids] = rng.integers(len(self._members), size=len(ids))
        for number, member in enumerate(self._members):
            mine = np.flatnonzero(self._member[ids] == number)
            if len(mine):
                member.begin(ids[mine], [models[int(i)] for i in mine], qpos[mine], qvel[mine])

    def forces(self, qpos: Array, qvel: Array, command: Array) -> Array:
        """Returns the forces until the model was stepped once, N m and N, shape (N, A).

        Args:
            qpos: shape (N, nq).
            qvel: shape (N, nv).
            command: In force from now on, of the model's joints, shape (N, J).
        """
        for number, member in enumerate(self._members):
            ids = np.flatnonzero(self._member == number)
            if len(ids) and self._calls % self._every[number] == 0:
                member.decide(ids, qpos[ids], qvel[ids], command[ids], self._held)
        self._calls += 1
        return self._held.copy()


@final
class _Member:
    """One force model and what it has observed of each instance."""

    def __init__(self, forces: LearnedForces, model: HybridModel, num_envs: int) -> None:
        self._forces, self._model = forces, model
        self._layout = forces.layout_in(model.any_model)
        self._observation: Array32 = np.zeros((num_envs, forces.features.size), np.float32)
        self._law = np.zeros((num_envs, *drive_law(model.any_model, self._layout).shape))
        self._fresh = np.zeros(num_envs, bool)
        self._columns = self._own_joints()
        self._targets = self._own_forces()

    def begin(
        self,
        ids: NDArray[np.intp],
        models: Sequence[mujoco.MjModel],
        qpos: Array,
        qvel: Array,
    ) -> None:
        """Forgets the instances `ids`: as far as is known, they have always been there."""
        for index, model in zip(ids, models, strict=True):
            self._law[index] = drive_law(model, self._layout)
        features = self._forces.features
        state = features.state(self._layout, qpos, qvel)
        rows = self._observation[ids]
        features.fill(rows, np.repeat(state[:, None], features.history + 1, axis=1))
        self._observation[ids] = rows
        self._fresh[ids] = True

    def decide(
        self, ids: NDArray[np.intp], qpos: Array, qvel: Array, command: Array, forces: Array
    ) -> None:
        """Writes the forces on the instances `ids` into `forces`, shape (N, A)."""
        layout, features = self._layout, self._forces.features
        rows, fresh = self._observation[ids], self._fresh[ids]
        pushed = rows.copy()
        features.push(pushed, features.state(layout, qpos, qvel))
        rows = np.where(fresh[:, None], rows, pushed)
        told = command[:, self._columns]
        q, v = qpos[:, layout.qpos], qvel[:, layout.dof]
        features.put_torque(rows, drive_torque(self._law[ids], told, q, v))
        self._observation[ids], self._fresh[ids] = rows, False
        action = self._forces.policy.mean_action(rows)
        forces[np.ix_(ids, self._targets)] = action * self._forces.force_limit

    def _own_joints(self) -> NDArray[np.intp]:
        """Where this one's joints are among the model's, shape (J,)."""
        names = self._model.layout.joint_names
        return np.array([names.index(name) for name in self._forces.joint_names], np.intp)

    def _own_forces(self) -> NDArray[np.intp]:
        """Which of the model's forces this one's are, shape (F,)."""
        names = self._model.layout.joint_names
        forced = [names[i] for i in self._model.forced]
        missing = [name for name in self._forces.forced_joints if name not in forced]
        if missing:
            raise ConfigError(
                f"force model: it acts on {', '.join(missing)}; forces are allowed on "
                f"{', '.join(forced)}"
            )
        joints = [forced.index(name) for name in self._forces.forced_joints]
        on_object = list(range(len(forced), len(self._model.force_limit)))
        return np.array(joints + (on_object if self._forces.on_object else []), np.intp)
