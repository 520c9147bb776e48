"""Environments from files: what actors, learner and commands need to build one.

Apart from the rest of this package because it needs mujoco, which the replay service does without.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import mujoco

from gfm.core import BadInputError, CommandKind
from gfm.envs.batched import BatchedEnvironment
from gfm.envs.registry import (
    EnvironmentAssets,
    EnvironmentSettings,
    furnished,
    make_environment,
)
from gfm.recording import read_recording

Complete = Callable[[mujoco.MjSpec], mujoco.MjSpec]


def load_environment(
    name: str, settings: EnvironmentSettings, *, num_envs: int, seed: int
) -> BatchedEnvironment:
    """Returns instances of an environment, from the files that its settings name.

    Raises:
        BadInputError: a file cannot be read, or settings and files do not go together.
    """
    assets = load_assets(settings, partial(furnished, name))
    return make_environment(name, settings, num_envs=num_envs, seed=seed, assets=assets)


def load_assets(
    settings: EnvironmentSettings, complete: Complete | None = None
) -> EnvironmentAssets:
    """Returns the models, completed, and recordings that environment settings name."""
    return EnvironmentAssets(
        models=load_models(settings.models, complete),
        trajectories=tuple(read_recording(Path(path)) for path in settings.recordings),
    )


def load_models(
    paths: Mapping[CommandKind, str], complete: Complete | None = None
) -> dict[CommandKind, mujoco.MjModel]:
    """Returns compiled models by kind of command.

    Args:
        paths: Of MJCF files.
        complete: Adds what a file lacks before it is compiled.

    Raises:
        BadInputError: a file is missing or no valid MJCF.
    """
    return {kind: _load_model(Path(path), complete) for kind, path in paths.items()}


def _load_model(path: Path, complete: Complete | None) -> mujoco.MjModel:
    if not path.is_file():
        raise BadInputError(f"model {path}: no such file, expected MJCF")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        return (complete(spec) if complete else spec).compile()
    except ValueError as exc:
        reason = " ".join(str(exc).split())
        raise BadInputError(f"model {path}: {reason}; expected MJCF that MuJoCo loads") from exc
