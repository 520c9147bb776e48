"""One instance of a batched environment behind Gymnasium's interface.

`import gfm.envs.gymnasium_env` registers `gfm/GfmFit-v0` (which takes `settings` and `assets`),
`gfm/JointTracking-v0`, `gfm/PositionMatching-v0` and `gfm/PoseMatching-v0` (which may take them)
and `gfm/PointMass-v0`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import gymnasium
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core.checks import Array32
from gfm.envs import gfm_fit, joint_tracking, point_mass
from gfm.envs.batched import BatchedEnvironment
from gfm.envs.matching_task import POSE_MATCHING, POSITION_MATCHING
from gfm.envs.registry import (
    EnvironmentAssets,
    EnvironmentSettings,
    fit_problem,
    make_environment,
)

MakeEnvironment = Callable[[int], BatchedEnvironment]


@final
class GymnasiumEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One instance. Termination is discount 0; out of time, truncation.

    What is for a critic alone is left out: algorithms behind this interface give all they see to
    the policy.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - Gymnasium's own convention

    def __init__(self, make: MakeEnvironment) -> None:
        self._make = make
        self._env = make(0)
        spec = self._env.spec
        largest = float(np.finfo(np.float32).max)  # finite, as Gymnasium's checker wants it
        self.observation_space = gymnasium.spaces.Box(
            -largest, largest, (spec.policy_size,), np.float32
        )
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (spec.action_size,), np.float32)

    @override
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array32, dict[str, Any]]:
        super().reset(seed=seed)
        if seed is not None:
            self._env = self._make(seed)
        return self._seen(self._env.reset()), {}

    @override
    def step(self, action: Array32) -> tuple[Array32, float, bool, bool, dict[str, Any]]:
        transition = self._env.step(np.asarray(action, np.float32)[None])
        terminated = bool(transition.discount[0] == 0.0)
        truncated = bool(transition.ended[0]) and not terminated
        return (
            self._seen(transition.observation),
            float(transition.reward[0]),
            terminated,
            truncated,
            {},
        )

    def _seen(self, observation: Array32) -> Array32:
        return observation[0, : self._env.spec.policy_size]


def make_gfm_fit(settings: EnvironmentSettings, assets: EnvironmentAssets) -> GymnasiumEnv:
    """Returns one instance of the fitting problem."""
    problem = fit_problem(settings, assets)
    return GymnasiumEnv(lambda seed: gfm_fit.GfmFit(problem, 1, seed=seed))


def make_point_mass(horizon: int = 20) -> GymnasiumEnv:
    """Returns one point mass."""
    return GymnasiumEnv(lambda seed: point_mass.PointMass(1, seed=seed, horizon=horizon))


def make_control(
    name: str,
    settings: EnvironmentSettings | None = None,
    assets: EnvironmentAssets | None = None,
) -> GymnasiumEnv:
    """Returns one instance of a control task; of the nominal cell where no models are given."""
    chosen = settings or EnvironmentSettings()
    return GymnasiumEnv(
        lambda seed: make_environment(name, chosen, num_envs=1, seed=seed, assets=assets)
    )


gymnasium.register(id="gfm/GfmFit-v0", entry_point="gfm.envs.gymnasium_env:make_gfm_fit")
gymnasium.register(id="gfm/PointMass-v0", entry_point="gfm.envs.gymnasium_env:make_point_mass")
for _id, _name in (
    ("gfm/JointTracking-v0", joint_tracking.NAME),
    ("gfm/PositionMatching-v0", POSITION_MATCHING.name),
    ("gfm/PoseMatching-v0", POSE_MATCHING.name),
):
    gymnasium.register(
        id=_id,
        entry_point="gfm.envs.gymnasium_env:make_control",
        kwargs={"name": _name},
    )
