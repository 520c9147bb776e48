"""The learner through its services against Stable-Baselines3's SAC, on problems everybody knows.

    pip install -e '.[all,peers]'
    python benchmarks/known_control.py --out runs/known_control

Per environment and seed: SAC with its defaults for a fixed number of steps, in one torch thread
(two are no faster with networks this small); then `gfm train` on the file in `configs/`, with the
start of all services in its time. Both policies then act without noise in the same 100 episodes.
What is there already is not repeated.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from effects_10_seeds import commit
from numpy.typing import NDArray
from stable_baselines3 import SAC

from gfm.recording.weights_file import read_weights
from gfm.rl.policy_numpy import GaussianPolicy

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "results" / "known_control.md"
#: Environment: our configuration, and the steps that SAC is given.
PROBLEMS = {"Pendulum-v1": ("pendulum.toml", 20_000), "Reacher-v5": ("reacher.toml", 20_000)}
EPISODES, FIRST_SEED = 100, 10_000

Act = Callable[[NDArray[Any]], NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Result:
    """What one training led to.

    Attributes:
        mean: Return of the evaluation's episodes.
        error: Standard error of that mean.
        wall_s: Of the training.
    """

    mean: float
    error: float
    wall_s: float


def evaluate(env_id: str, act: Act) -> tuple[float, float]:
    """Returns mean and standard error of the return over the same episodes for everybody."""
    env, returns = gymnasium.make(env_id), []
    for episode in range(EPISODES):
        observation, _ = env.reset(seed=FIRST_SEED + episode)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(act(observation))
            total, over = total + float(reward), terminated or truncated
        returns.append(total)
    return float(np.mean(returns)), float(np.std(returns) / np.sqrt(EPISODES))


def train_sac(env_id: str, steps: int, seed: int) -> Result:
    """Returns what SAC comes to."""
    torch.set_num_threads(1)
    began_s = time.monotonic()
    model = SAC("MlpPolicy", gymnasium.make(env_id), seed=seed)
    model.learn(steps)
    wall_s = time.monotonic() - began_s
    mean, error = evaluate(env_id, lambda seen: model.predict(seen, deterministic=True)[0])
    return Result(mean=mean, error=error, wall_s=wall_s)


def train_gfm(env_id: str, config: Path, seed: int, folder: Path) -> Result:
    """Returns what our learner comes to, with all services as processes."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    text = config.read_text(encoding="utf-8")
    told = folder.parent / f"{folder.name}.toml"
    told.write_text(f"seed = {seed}\n{text}", encoding="utf-8")
    words = (sys.executable, "-m", "gfm.cli", "train", "--config", told, "--out", folder)
    began_s = time.monotonic()
    subprocess.run([str(word) for word in words], check=True, stdout=subprocess.DEVNULL)
    wall_s = time.monotonic() - began_s
    policy = GaussianPolicy.from_weights(read_weights(folder / "checkpoints" / "policy.npz"))
    space = gymnasium.make(env_id).action_space
    assert isinstance(space, gymnasium.spaces.Box)
    middle, half = (space.high + space.low) / 2.0, (space.high - space.low) / 2.0

    def act(seen: NDArray[Any]) -> NDArray[Any]:
        mean = policy.mean_action(np.asarray(seen, np.float32)[None])[0]
        return np.asarray(middle + half * np.clip(mean, -1.0, 1.0))

    mean, error = evaluate(env_id, act)
    return Result(mean=mean, error=error, wall_s=wall_s)


def kept(path: Path, make: Callable[[], Result]) -> Result:
    """Returns what the file holds; makes it where it is not there."""
    if not path.exists():
        result = make()
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(asdict(result)), encoding="utf-8")
        print(f"{path}: {result}", flush=True)
    return Result(**json.loads(path.read_text(encoding="utf-8")))


def rows(out: Path, seeds: int) -> list[str]:
    """Returns the table's rows; trains what is missing."""
    cases = [(env_id, seed) for env_id in PROBLEMS for seed in range(seeds)]
    both = [(sac(*case, out), ours(*case, out)) for case in cases]
    return [
        f"| {env_id} | {seed} | {theirs.mean:.2f} ± {theirs.error:.2f} | "
        f"{mine.mean:.2f} ± {mine.error:.2f} | {theirs.wall_s:.0f} s | {mine.wall_s:.0f} s "
        f"| {mine.wall_s / theirs.wall_s:.2f} |"
        for (env_id, seed), (theirs, mine) in zip(cases, both, strict=True)
    ]


def sac(env_id: str, seed: int, out: Path) -> Result:
    """Returns what SAC came to, now or before."""
    path = out / env_id / str(seed) / "sac.json"
    return kept(path, lambda: train_sac(env_id, PROBLEMS[env_id][1], seed))


def ours(env_id: str, seed: int, out: Path) -> Result:
    """Returns what our learner came to, now or before."""
    folder, config = out / env_id / str(seed), ROOT / "configs" / PROBLEMS[env_id][0]
    return kept(folder / "gfm.json", lambda: train_gfm(env_id, config, seed, folder / "gfm"))


def page(table: list[str], command: str) -> str:
    """Returns the page."""
    steps = ", ".join(f"{env_id} {steps:,}" for env_id, (_, steps) in PROBLEMS.items())
    head = (
        "# The learner on problems that everybody knows",
        "",
        f"    {command}",
        "",
        f"Return of {EPISODES} episodes without noise, the same ones for both (mean and its "
        f"standard error). SAC: Stable-Baselines3 {version('stable-baselines3')} with its "
        f"defaults, steps: {steps}. Ours: `gfm train` on the file in `configs/`, all services as "
        "processes; its time holds their start. Hyper-parameters of ours were chosen on seed 0 of "
        "Pendulum-v1.",
        "",
        f"Commit {commit()}, Python {platform.python_version()}, torch {version('torch')}, "
        f"{platform.machine()}, both cores.",
        "",
        "| environment | seed | SAC | ours | time SAC | time ours | ratio |",
        "|---|---|---|---|---|---|---|",
    )
    return "\n".join((*head, *table, ""))


def main() -> None:
    """Trains, tests and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "runs" / "known_control", metavar="DIR")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE")
    parser.add_argument("--sac-only", action="store_true", help="train SAC alone, for now")
    asked = parser.parse_args()
    if asked.sac_only:
        for env_id in PROBLEMS:
            for seed in range(asked.seeds):
                sac(env_id, seed, asked.out)
        return
    table = rows(asked.out, asked.seeds)
    command = f"python benchmarks/known_control.py --seeds {asked.seeds}"
    asked.page.write_text(page(table, command), encoding="utf-8")


if __name__ == "__main__":
    main()
