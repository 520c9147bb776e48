"""A damped point mass on a line, to be brought to the origin: for tests of what surrounds it.

Shape letters: N instances, n of them.
"""

from __future__ import annotations

from typing import final

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import EnvironmentSpec
from gfm.core.checks import Array, Array32
from gfm.envs.batched import BatchedEnvironment, Transition
from gfm.envs.episodes import Episodes

NAME = "point_mass"
_PERIOD_S, _MASS_KG, _DAMPING_N_S_M, _LIMIT_N = 0.05, 1.0, 0.5, 2.0


@final
class PointMass(BatchedEnvironment):
    """N masses that start at random within 1 m of the origin; reward exp(-x^2 - v^2 / 4).

    Observation: position m and velocity m/s. Action: force in units of 2 N.
    """

    def __init__(self, num_envs: int, *, seed: int = 0, horizon: int = 20) -> None:
        self.num_envs = num_envs
        self.spec = EnvironmentSpec(name=NAME, observation_size=2, action_size=1, reward_limit=1.0)
        self._rng = np.random.default_rng(seed)
        self._episodes = Episodes(num_envs, horizon)
        self._state: Array = np.zeros((num_envs, 2))

    @override
    def reset(self, ids: NDArray[np.intp] | None = None) -> Array32:
        chosen = self._episodes.start(ids)
        self._state[chosen] = self._rng.uniform(-1.0, 1.0, size=(len(chosen), 2))
        return self._state.astype(np.float32)

    @override
    def step(self, action: Array32) -> Transition:
        force = _LIMIT_N * self._episodes.checked(action, 1)[:, 0]
        x, v = self._state.T
        v = v + _PERIOD_S * (force - _DAMPING_N_S_M * v) / _MASS_KG
        x = x + _PERIOD_S * v
        self._state = np.stack([x, v], axis=1)
        return Transition(
            observation=self._state.astype(np.float32),
            reward=np.exp(-(x**2) - v**2 / 4.0).astype(np.float32),
            discount=np.ones(self.num_envs, np.float32),
            ended=self._episodes.tick(np.zeros(self.num_envs, bool)),
        )
