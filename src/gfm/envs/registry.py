"""The environments by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from types import ModuleType

import msgspec
import mujoco

from gfm.core import CommandKind, ConfigError, Trajectory, UnknownNameError
from gfm.effects import EffectInstance
from gfm.envs import gfm_fit, joint_tracking, point_mass
from gfm.envs.arm import CONTROL_PERIOD_S, ArmProblem, common_period_s
from gfm.envs.batched import BatchedEnvironment
from gfm.envs.control_settings import ControlSettings
from gfm.envs.fit_problem import FitProblem, make_fit_problem
from gfm.envs.matching import Matching
from gfm.envs.matching_task import TASKS
from gfm.sim.cell import furnish
from gfm.sim.hybrid import ForceLimits, HybridModel
from gfm.sim.learned import LearnedForces
from gfm.sim.ranges import DrawnModels
from gfm.sim.sawyer import sawyer_spec


class EnvironmentSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What an environment may be told; each takes what concerns it.

    Attributes:
        models: MJCF files of the robot by kind of command; loaded by whoever calls the registry.
        recordings: MCAP files; likewise.
        horizon: Control periods per episode; by default the environment's own.
        history: Earlier states in the observation of `gfm_fit`.
        control_period_s: Between two decisions about forces.
        forced_joints: Those that forces act on; empty for all that are measured.
        joint_nm: Limit of the generalized force on a joint.
        object_n: Limit of the generalized force on the object.
        object_nm: Limit of the generalized torque on the object.
        scale: Of the difference, per channel; measured from the recordings by default.
        exploration: See `gfm.envs.fit_problem.difference_scale`.
        nthread: Threads of the physics.
        control: Gain and disturbances of the control tasks.
    """

    models: dict[CommandKind, str] = {}
    recordings: tuple[str, ...] = ()
    horizon: int | None = None
    history: int = 5
    control_period_s: float = 0.05
    forced_joints: tuple[str, ...] = ()
    joint_nm: float = 5.0
    object_n: float = 0.03
    object_nm: float = 0.03
    scale: tuple[float, ...] | None = None
    exploration: float = 0.3
    nthread: int = 1
    control: ControlSettings = ControlSettings()

    def __post_init__(self) -> None:
        least = {"horizon": 1, "history": 0, "nthread": 1}
        for name, smallest in least.items():
            value = getattr(self, name)
            if value is not None and value < smallest:
                raise ConfigError(f"{name} is {value}, expected at least {smallest}")


@dataclass(frozen=True, kw_only=True)
class EnvironmentAssets:
    """The loaded files that the settings name.

    Attributes:
        models: By kind of command.
        effects: What stands beside them: the robot's effects that MuJoCo cannot express.
        trajectories: The recordings.
        ensemble: Generalized force models for the control tasks.
        drawn: Models for velocity commands with amounts drawn from ranges, for the same.
    """

    models: Mapping[CommandKind, mujoco.MjModel] = field(default_factory=dict)
    effects: tuple[EffectInstance, ...] = ()
    trajectories: Sequence[Trajectory] = ()
    ensemble: tuple[LearnedForces, ...] = ()
    drawn: DrawnModels | None = None


def fit_problem(settings: EnvironmentSettings, assets: EnvironmentAssets) -> FitProblem:
    """Returns what instances of `gfm_fit` share.

    Raises:
        BadInputError: models, recordings and settings do not go together.
    """
    if not assets.trajectories:
        raise ConfigError("gfm_fit needs at least one recording, got none")
    model = HybridModel(
        models=assets.models,
        joint_names=assets.trajectories[0].joint_names,
        limits=force_limits(settings),
        control_period_s=settings.control_period_s,
        forced_joints=settings.forced_joints,
        effects=assets.effects,
    )
    return make_fit_problem(
        model,
        assets.trajectories,
        horizon=episode_steps(gfm_fit.NAME, settings),
        history=settings.history,
        scale=settings.scale,
        exploration=settings.exploration,
    )


def force_limits(settings: EnvironmentSettings) -> ForceLimits:
    """Returns the limits of the generalized forces."""
    return ForceLimits(
        joint_nm=settings.joint_nm, object_n=settings.object_n, object_nm=settings.object_nm
    )


def _make_gfm_fit(
    settings: EnvironmentSettings, assets: EnvironmentAssets, num_envs: int, seed: int
) -> BatchedEnvironment:
    problem = fit_problem(settings, assets)
    return gfm_fit.GfmFit(problem, num_envs, seed=seed, nthread=settings.nthread)


def _make_point_mass(
    settings: EnvironmentSettings, _assets: EnvironmentAssets, num_envs: int, seed: int
) -> BatchedEnvironment:
    steps = episode_steps(point_mass.NAME, settings)
    return point_mass.PointMass(num_envs, seed=seed, horizon=steps)


def arm_problem(name: str, settings: EnvironmentSettings, assets: EnvironmentAssets) -> ArmProblem:
    """Returns what instances of the control task `name` share.

    Without a model it is the nominal cell; a model is taken as it is (see `furnished`).

    Raises:
        BadInputError: models and settings do not go together.
    """
    models = assets.models or {CommandKind.VELOCITY: nominal_cell(name).compile()}
    timestep_s = float(next(iter(models.values())).opt.timestep)
    periods_s = [CONTROL_PERIOD_S, *(one.control_period_s for one in assets.ensemble)]
    model = HybridModel(
        models=models,
        limits=force_limits(settings),
        control_period_s=common_period_s(periods_s, timestep_s),
        forced_joints=settings.forced_joints,
        effects=assets.effects,
    )
    return ArmProblem(
        model=model, settings=settings.control, ensemble=assets.ensemble, drawn=assets.drawn
    )


def nominal_cell(name: str, command: CommandKind = CommandKind.VELOCITY) -> mujoco.MjSpec:
    """Returns the published arm, furnished for the control task `name`.

    Args:
        name: Of the task.
        command: What its actuators take.
    """
    if name not in TASKS:
        return sawyer_spec(command=command)
    task = TASKS[name]
    return sawyer_spec(
        command=command,
        end_effector=task.end_effector,
        free_object=task.free_object,
    )


def as_trained(corrected: mujoco.MjSpec, name: str) -> mujoco.MjSpec:
    """Returns a corrected model under the integrator of the nominal one.

    Amounts are fitted with a method of fourth order, whose steps cost training four times as much;
    what a cheaper one errs, a policy does not feel.

    Args:
        corrected: Of the arm or the cell; it stays as it is.
        name: Of the control task.
    """
    spec = corrected.copy()
    spec.option.integrator = nominal_cell(name).option.integrator
    return spec


def furnished(name: str, spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Returns the model of a robot with what the environment `name` needs around it, in place.

    Raises:
        ConfigError: there is nothing to mount a tool on.
    """
    if name in TASKS:
        furnish(spec, TASKS[name].end_effector, TASKS[name].free_object)
    return spec


def _make_joint_tracking(
    settings: EnvironmentSettings, assets: EnvironmentAssets, num_envs: int, seed: int
) -> BatchedEnvironment:
    return joint_tracking.JointTracking(
        arm_problem(joint_tracking.NAME, settings, assets),
        num_envs,
        seed=seed,
        nthread=settings.nthread,
        horizon=settings.horizon,
    )


def _make_matching(
    name: str,
    settings: EnvironmentSettings,
    assets: EnvironmentAssets,
    num_envs: int,
    seed: int,
) -> BatchedEnvironment:
    return Matching(
        TASKS[name],
        arm_problem(name, settings, assets),
        num_envs,
        seed=seed,
        nthread=settings.nthread,
        horizon=settings.horizon,
    )


_Maker = Callable[[EnvironmentSettings, EnvironmentAssets, int, int], BatchedEnvironment]
_MAKERS: dict[str, _Maker] = {
    gfm_fit.NAME: _make_gfm_fit,
    joint_tracking.NAME: _make_joint_tracking,
    point_mass.NAME: _make_point_mass,
    **{name: partial(_make_matching, name) for name in TASKS},
}

ENVIRONMENT_NAMES = tuple(sorted(_MAKERS))
#: Before the name of an environment that is registered with Gymnasium.
GYMNASIUM = "gymnasium:"
_DEFAULT_STEPS = 20
_STEPS = {joint_tracking.NAME: joint_tracking.STEPS, **{t.name: t.steps for t in TASKS.values()}}


def check_name(name: str) -> None:
    """Raises UnknownNameError where there is no environment `name`; lets Gymnasium's all pass."""
    if name not in _MAKERS and not name.startswith(GYMNASIUM):
        raise UnknownNameError("environment", name, (*_MAKERS, f"{GYMNASIUM}NAME"))


def episode_steps(name: str, settings: EnvironmentSettings) -> int:
    """Returns the control periods per episode of the environment `name`."""
    if settings.horizon is None and name.startswith(GYMNASIUM):
        return int(_gymnasium_batch().steps_of(name.removeprefix(GYMNASIUM)))
    return settings.horizon or _STEPS.get(name, _DEFAULT_STEPS)


def make_environment(
    name: str,
    settings: EnvironmentSettings,
    *,
    num_envs: int,
    seed: int,
    assets: EnvironmentAssets | None = None,
) -> BatchedEnvironment:
    """Returns `num_envs` instances of the environment `name`.

    Raises:
        UnknownNameError: there is no such environment.
        BadInputError: the settings and assets do not make one.
    """
    check_name(name)
    if num_envs < 1:
        raise ConfigError(f"num_envs is {num_envs}, expected at least 1")
    if name.startswith(GYMNASIUM):
        return _make_gymnasium(name, settings, num_envs, seed)
    return _MAKERS[name](settings, assets or EnvironmentAssets(), num_envs, seed)


def _make_gymnasium(
    name: str, settings: EnvironmentSettings, num_envs: int, seed: int
) -> BatchedEnvironment:
    own, steps = name.removeprefix(GYMNASIUM), episode_steps(name, settings)
    made: BatchedEnvironment = _gymnasium_batch().GymnasiumBatch(
        own, num_envs, seed=seed, horizon=steps
    )
    return made


def _gymnasium_batch() -> ModuleType:
    """Returns the module, which only those need who have Gymnasium."""
    try:
        return importlib.import_module("gfm.envs.gymnasium_batch")
    except ImportError as exc:
        raise ConfigError(
            f"environments of Gymnasium need the extra 'gymnasium' (or what they ask for): {exc}"
        ) from exc
