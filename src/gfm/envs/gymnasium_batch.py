"""Environments of others: N instances of one that is registered with Gymnasium, stepped together.

Shape letters: N instances, O observation size, A action size.
"""

from __future__ import annotations

from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import ConfigError, EnvironmentSpec
from gfm.core.checks import Array32
from gfm.envs.batched import BatchedEnvironment, Transition
from gfm.envs.episodes import Episodes


def steps_of(name: str) -> int:
    """Returns after how many steps an episode of `name` is cut.

    Raises:
        ConfigError: Gymnasium does not know it, or it has no limit.
    """
    steps = _registered(name).max_episode_steps
    if steps is None:
        raise ConfigError(f"{name} has no limit of steps, expected one")
    return int(steps)


@final
class GymnasiumBatch(BatchedEnvironment):
    """N instances. Actions in [-1, 1] stand for the range of the environment's own."""

    def __init__(self, name: str, num_envs: int, *, seed: int = 0, horizon: int) -> None:
        """Makes instances of `name`, as Gymnasium calls it.

        Raises:
            ConfigError: Gymnasium does not know it, it cannot be made, or what it observes or takes
                is not a vector of bounded numbers.
        """
        _registered(name)
        self.num_envs = num_envs
        self._envs = _make(name, num_envs, horizon)
        observed = _vectors(name, "observes", self._envs.single_observation_space)
        taken = _vectors(name, "takes", self._envs.single_action_space)
        if not taken.is_bounded():
            raise ConfigError(f"{name} takes {taken}, expected bounded actions")
        self.spec = EnvironmentSpec(
            name=name, observation_size=observed.shape[0], action_size=taken.shape[0]
        )
        self._middle = (taken.high + taken.low) / 2.0
        self._half_range = (taken.high - taken.low) / 2.0
        self._episodes = Episodes(num_envs, horizon)
        self._seed: int | None = seed

    @override
    def reset(self, ids: NDArray[np.intp] | None = None) -> Array32:
        chosen = np.zeros(self.num_envs, bool)
        first, self._seed = self._seed, None
        if first is not None:  # Gymnasium wants all of them at the first time
            ids = None
        chosen[self._episodes.start(ids)] = True
        observation, _ = self._envs.reset(seed=first, options={"reset_mask": chosen})
        return np.asarray(observation, np.float32)

    @override
    def step(self, action: Array32) -> Transition:
        wanted = self._episodes.checked(action, self.spec.action_size)
        observation, reward, terminated, _, _ = self._envs.step(
            self._middle + self._half_range * wanted
        )
        return Transition(
            observation=np.asarray(observation, np.float32),
            reward=reward.astype(np.float32),
            discount=np.where(terminated, 0.0, 1.0).astype(np.float32),
            ended=self._episodes.tick(terminated),
        )


def _registered(name: str) -> EnvSpec:
    try:
        return gymnasium.spec(name)
    except gymnasium.error.Error as exc:
        reason = " ".join(str(exc).split())
        raise ConfigError(f"{name}: Gymnasium does not know it: {reason}") from exc


def _make(name: str, num_envs: int, horizon: int) -> VectorEnv[Any, Any, Any]:
    try:
        return gymnasium.make_vec(
            name,
            num_envs=num_envs,
            vectorization_mode="sync",
            vector_kwargs={"autoreset_mode": AutoresetMode.DISABLED},
            max_episode_steps=horizon,
        )
    except (gymnasium.error.Error, ImportError) as exc:
        raise ConfigError(f"{name} cannot be made: {exc}") from exc


def _vectors(name: str, verb: str, space: gymnasium.Space[Any]) -> Box:
    if not isinstance(space, Box) or len(space.shape) != 1:
        raise ConfigError(f"{name} {verb} {space}, expected vectors of numbers")
    return space
