"""Trains Stable-Baselines3's SAC on a control task, unchanged, and says how its return goes.

    pip install -e '.[peers]'
    python benchmarks/sb3_training.py --env gfm/PositionMatching-v0 --steps 20000 --gain 6

What our own learner is compared with, and proof that the Gymnasium face is complete.
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import numpy as np
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor

from gfm.envs.control_settings import ControlSettings, Curriculum
from gfm.envs.registry import EnvironmentSettings


class Progress(BaseCallback):
    """Prints the mean return of the last episodes every so many steps."""

    def __init__(self, every: int) -> None:
        super().__init__()
        self._every = every
        self._began_s = time.monotonic()

    def _on_step(self) -> bool:
        if self.num_timesteps % self._every == 0 and self.model.ep_info_buffer:
            returns = [episode["r"] for episode in self.model.ep_info_buffer]
            minutes = (time.monotonic() - self._began_s) / 60.0
            print(f"{minutes:6.1f} min  {self.num_timesteps:8d} steps  {np.mean(returns):8.2f}")
        return True


def main() -> None:
    """Trains once."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--env", default="gfm/PositionMatching-v0")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--gain", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    control = ControlSettings(curriculum=Curriculum(gains=(arguments.gain,)))
    settings = EnvironmentSettings(control=control)
    env = gymnasium.make(f"gfm.envs.gymnasium_env:{arguments.env}", settings=settings)
    model = SAC("MlpPolicy", Monitor(env), gamma=0.99, seed=arguments.seed)
    model.learn(arguments.steps, callback=Progress(every=1000))


if __name__ == "__main__":
    main()
