"""The environments by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import msgspec
import mujoco

from gfm.core import CommandKind, ConfigError, Trajectory, UnknownNameError
from gfm.envs import gfm_fit, point_mass
from gfm.envs.batched import BatchedEnvironment
from gfm.envs.fit_problem import FitProblem, make_fit_problem
from gfm.sim.hybrid import ForceLimits, HybridModel


class EnvironmentSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What an environment may be told; each takes what concerns it.

    Attributes:
        models: MJCF files of the robot by kind of command; loaded by whoever calls the registry.
        recordings: MCAP files; likewise.
        horizon: Control periods per episode.
        history: Earlier states in the observation.
        control_period_s: Between two decisions.
        forced_joints: Those that forces act on; empty for all that are measured.
        joint_nm: Limit of the generalized force on a joint.
        object_n: Limit of the generalized force on the object.
        object_nm: Limit of the generalized torque on the object.
        scale: Of the difference, per channel; measured from the recordings by default.
        exploration: See `gfm.envs.fit_problem.difference_scale`.
        nthread: Threads of the physics.
    """

    models: dict[CommandKind, str] = {}
    recordings: tuple[str, ...] = ()
    horizon: int = 20
    history: int = 5
    control_period_s: float = 0.05
    forced_joints: tuple[str, ...] = ()
    joint_nm: float = 5.0
    object_n: float = 0.03
    object_nm: float = 0.03
    scale: tuple[float, ...] | None = None
    exploration: float = 0.3
    nthread: int = 1

    def __post_init__(self) -> None:
        least = {"horizon": 1, "history": 0, "nthread": 1}
        for name, smallest in least.items():
            if (value := getattr(self, name)) < smallest:
                raise ConfigError(f"{name} is {value}, expected at least {smallest}")


@dataclass(frozen=True, kw_only=True)
class EnvironmentAssets:
    """The loaded files that the settings name.

    Attributes:
        models: By kind of command.
        trajectories: The recordings.
    """

    models: Mapping[CommandKind, mujoco.MjModel] = field(default_factory=dict)
    trajectories: Sequence[Trajectory] = ()


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
        limits=ForceLimits(
            joint_nm=settings.joint_nm, object_n=settings.object_n, object_nm=settings.object_nm
        ),
        control_period_s=settings.control_period_s,
        forced_joints=settings.forced_joints,
    )
    return make_fit_problem(
        model,
        assets.trajectories,
        horizon=settings.horizon,
        history=settings.history,
        scale=settings.scale,
        exploration=settings.exploration,
    )


def _make_gfm_fit(
    settings: EnvironmentSettings, assets: EnvironmentAssets, num_envs: int, seed: int
) -> BatchedEnvironment:
    problem = fit_problem(settings, assets)
    return gfm_fit.GfmFit(problem, num_envs, seed=seed, nthread=settings.nthread)


def _make_point_mass(
    settings: EnvironmentSettings, _assets: EnvironmentAssets, num_envs: int, seed: int
) -> BatchedEnvironment:
    return point_mass.PointMass(num_envs, seed=seed, horizon=settings.horizon)


_MAKERS: dict[
    str, Callable[[EnvironmentSettings, EnvironmentAssets, int, int], BatchedEnvironment]
] = {gfm_fit.NAME: _make_gfm_fit, point_mass.NAME: _make_point_mass}

ENVIRONMENT_NAMES = tuple(sorted(_MAKERS))


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
    if name not in _MAKERS:
        raise UnknownNameError("environment", name, _MAKERS)
    if num_envs < 1:
        raise ConfigError(f"num_envs is {num_envs}, expected at least 1")
    return _MAKERS[name](settings, assets or EnvironmentAssets(), num_envs, seed)
