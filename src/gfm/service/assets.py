"""Environments from files: what actors, learner and commands need to build one.

Apart from the rest of this package because it needs mujoco, which the replay service does without.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mujoco

from gfm.core import BadInputError
from gfm.envs.batched import BatchedEnvironment
from gfm.envs.registry import (
    EnvironmentAssets,
    EnvironmentSettings,
    furnished,
    make_environment,
)
from gfm.policies import forces_path
from gfm.recording import read_recording
from gfm.service.force_files import read_forces
from gfm.service.model_files import ModelFile, read_robot, shared_effects
from gfm.sim.plant import stepping_spec

_log = logging.getLogger(__name__)

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
    """Returns what environment settings name: recordings, models, and what stands beside these.

    Args:
        settings: Name the files.
        complete: Adds what a model lacks before it is compiled.

    Raises:
        BadInputError: a file is missing or damaged, or files do not belong together.
    """
    files = read_robot(settings.models, partial(_log.info, "%s"))
    return EnvironmentAssets(
        models={kind: _compiled(file, complete) for kind, file in files.items()},
        effects=shared_effects(files.values()),
        trajectories=tuple(read_recording(Path(path)) for path in settings.recordings),
        ensemble=tuple(read_forces(forces_path(path)) for path in settings.control.ensemble),
    )


def _compiled(file: ModelFile, complete: Complete | None) -> mujoco.MjModel:
    try:
        spec = complete(file.spec) if complete else file.spec
        return stepping_spec(spec, file.effects).compile()
    except ValueError as exc:
        reason = " ".join(str(exc).split())
        raise BadInputError(f"model {file.path}: {reason}; expected a robot's model") from exc
