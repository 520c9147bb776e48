"""The hybrid model: MuJoCo plus bounded generalized forces (Jeong et al. 2019, eq. 4).

Shape letters: J joints, F of them with forces, A generalized forces (F, and 6 more with a free
object).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError, Trajectory
from gfm.core.checks import Array
from gfm.effects import EffectInstance
from gfm.sim.compensation import ErringCompensation
from gfm.sim.layout import Indices, Layout, make_layout
from gfm.sim.plant import (
    compensations,
    drive_dofs,
    drive_matrix,
    with_servo_gain,
)
from gfm.sim.step_laws import StepLaws, acts_at_every_step, step_laws


@dataclass(frozen=True, kw_only=True)
class ForceLimits:
    """How large the learned forces may get; the defaults are the paper's."""

    joint_nm: float = 5.0
    object_n: float = 0.03
    object_nm: float = 0.03

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0.0:
                raise ConfigError(f"{name} is {value}, expected more than 0")


@dataclass(frozen=True, kw_only=True)
class HybridModel:
    """One robot, a model per kind of command, and the limits of the forces added to them.

    Attributes:
        models: The same robot, by what its actuators take. They may differ in any parameter, not
            in MjData's layout.
        joint_names: The measured joints; by default every hinge and slide that is no motor side.
        limits: Of the generalized forces.
        control_period_s: Between two decisions; a whole number of time steps.
        forced_joints: The joints that forces act on; by default all measured ones.
        effects: What else the robot has, whatever the commands. Of these the models contain what
            MuJoCo expresses (`gfm.sim.plant.stepping_spec`); the rest is added in stepping.
    """

    models: Mapping[CommandKind, mujoco.MjModel]
    joint_names: tuple[str, ...] = ()
    limits: ForceLimits = field(default_factory=ForceLimits)
    control_period_s: float = 0.05
    forced_joints: tuple[str, ...] = ()
    effects: tuple[EffectInstance, ...] = ()

    def __post_init__(self) -> None:
        if not self.models:
            raise ConfigError("a hybrid model needs a model of at least one kind of command")
        expected = _sizes(self.any_model)
        for kind, model in self.models.items():
            if (sizes := _sizes(model)) != expected:
                raise ConfigError(f"the {kind} model has {sizes}, another one {expected}")
        steps = self.control_period_s / self.timestep_s
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            raise ConfigError(
                f"control_period_s is {self.control_period_s}, expected a multiple of the models' "
                f"time step {self.timestep_s}"
            )
        unknown = [name for name in self.forced_joints if name not in self.layout.joint_names]
        if unknown:
            known = ", ".join(self.layout.joint_names)
            raise ConfigError(f"forced joints {', '.join(unknown)}: the measured ones are {known}")

    @cached_property
    def any_model(self) -> mujoco.MjModel:
        """One of the models, for what they share."""
        return next(iter(self.models.values()))

    @cached_property
    def layout(self) -> Layout:
        """Where everything is, in all of the models."""
        return make_layout(self.any_model, self.joint_names)

    @property
    def timestep_s(self) -> float:
        """The integration step."""
        return float(self.any_model.opt.timestep)

    @property
    def substeps(self) -> int:
        """Integration steps per control period."""
        return round(self.control_period_s / self.timestep_s)

    @cached_property
    def forced(self) -> Indices:
        """Which of the measured joints forces act on, in the order of these, shape (F,)."""
        names = self.layout.joint_names
        chosen = [i for i, name in enumerate(names) if name in (self.forced_joints or names)]
        return np.array(chosen, np.intp)

    @cached_property
    def force_dof(self) -> Indices:
        """Where the forces act in qvel: forced joints, then the object's six, shape (A,)."""
        objects = np.arange(self.layout.object_dof.start, self.layout.object_dof.stop)
        return np.concatenate([self.layout.dof[self.forced], objects.astype(np.intp)])

    @cached_property
    def force_limit(self) -> Array:
        """N m on forced joints; N, then N m, on the object; shape (A,)."""
        on_object = [self.limits.object_n] * 3 + [self.limits.object_nm] * 3
        on_joints = [self.limits.joint_nm] * len(self.forced)
        return np.array(on_joints + (on_object if self.layout.has_object else []))

    def step_laws(self, count: int) -> StepLaws | None:
        """Returns the laws to be evaluated at every step of so many simulations, if any.

        Raises:
            UnknownNameError: an effect acts on a joint that is not measured.
        """
        if not any(acts_at_every_step(effect) for effect in self.effects):
            return None
        joints = self.layout.joint_names
        drive = drive_matrix(self.any_model, joints)
        if not drive.any():
            raise ConfigError("the models do not tell their drives' torques; see `stepping_spec`")
        places = (self.layout.qpos, self.layout.dof, drive_dofs(self.any_model, joints))
        return step_laws([self.effects] * count, joints, places, drive)

    def erring_compensation(self) -> ErringCompensation | None:
        """Returns what the robot's gravity compensation does wrong under the effects, if any."""
        model = self.any_model
        if not model.body_gravcomp.any():
            return None
        told = compensations(model, self.effects)
        return ErringCompensation(model, told) if told else None

    def model_for(self, trajectory: Trajectory) -> mujoco.MjModel:
        """Returns the model for a recording: its kind of command, its servo gains.

        Raises:
            ConfigError: there is no model for that kind of command.
        """
        kind = trajectory.command_kind
        if kind not in self.models:
            known = ", ".join(sorted(self.models))
            raise ConfigError(
                f"{trajectory.name} has {kind} commands; there are models for {known}"
            )
        model, gains = self.models[kind], trajectory.servo_gain
        servos = np.array([model.actuator(name).id for name in gains], dtype=np.intp)
        return with_servo_gain(model, servos, kind, np.array(list(gains.values())))


def _sizes(model: mujoco.MjModel) -> dict[str, int | float]:
    """Returns what models must share to be stepped in one batch."""
    names = ("nq", "nv", "na", "nu", "nbody", "njnt", "nsensordata", "nhistory")
    sizes: dict[str, int | float] = {name: int(getattr(model, name)) for name in names}
    return sizes | {"timestep": float(model.opt.timestep)}
