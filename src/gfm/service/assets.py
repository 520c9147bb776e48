"""Environments from files: what actors, learner and commands need to build one.

Apart from the rest of this package because it needs mujoco, which the replay service does without.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco

from gfm.core import BadInputError, CommandKind
from gfm.envs.batched import BatchedEnvironment
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, make_environment
from gfm.recording import read_recording


def load_environment(
    name: str, settings: EnvironmentSettings, *, num_envs: int, seed: int
) -> BatchedEnvironment:
    """Returns instances of an environment, from the files that its settings name.

    Raises:
        BadInputError: a file cannot be read, or settings and files do not go together.
    """
    assets = load_assets(settings)
    return make_environment(name, settings, num_envs=num_envs, seed=seed, assets=assets)


def load_assets(settings: EnvironmentSettings) -> EnvironmentAssets:
    """Returns the models and recordings that environment settings name."""
    return EnvironmentAssets(
        models=load_models(settings.models),
        trajectories=tuple(read_recording(Path(path)) for path in settings.recordings),
    )


def load_models(paths: Mapping[CommandKind, str]) -> dict[CommandKind, mujoco.MjModel]:
    """Returns compiled models by kind of command.

    Raises:
        BadInputError: a file is missing or no valid MJCF.
    """
    return {kind: _load_model(Path(path)) for kind, path in paths.items()}


def _load_model(path: Path) -> mujoco.MjModel:
    if not path.is_file():
        raise BadInputError(f"model {path}: no such file, expected MJCF")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except ValueError as exc:
        reason = " ".join(str(exc).split())
        raise BadInputError(f"model {path}: {reason}; expected MJCF that MuJoCo loads") from exc
