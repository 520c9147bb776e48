"""Algorithms of others learn in the environments as they are."""

import gymnasium
import numpy as np
import pytest

from gfm.envs.registry import EnvironmentSettings

sb3 = pytest.importorskip(
    "stable_baselines3", reason="needs the extra `peers`: pip install 'gfm-sim2real[peers]'"
)


@pytest.mark.filterwarnings("ignore")  # of matplotlib, pandas and torch, which it brings or uses
@pytest.mark.parametrize("env_id", ["JointTracking-v0", "PositionMatching-v0", "PoseMatching-v0"])
def test_sac_trains_unchanged(env_id):
    settings = EnvironmentSettings(horizon=40)
    env = gymnasium.make(f"gfm.envs.gymnasium_env:gfm/{env_id}", settings=settings)
    model = sb3.SAC("MlpPolicy", env, learning_starts=50, seed=0, policy_kwargs={"net_arch": [32]})
    before = [p.detach().clone() for p in model.actor.parameters()]
    model.learn(total_timesteps=120)
    assert model.num_timesteps == 120
    assert any((p != q).any() for p, q in zip(before, model.actor.parameters(), strict=True))
    observation, _ = env.reset(seed=1)
    action, _ = model.predict(observation)
    assert env.action_space.contains(np.asarray(action, np.float32))
