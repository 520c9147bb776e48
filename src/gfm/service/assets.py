"""Environments from files: what actors, learner and commands need to build one.

Apart from the rest of this package because it needs mujoco, which the replay service does without.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from gfm.core import BadInputError, CommandKind, ConfigError
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
from gfm.service.model_files import ModelFile, check_there, read_robot, shared_effects
from gfm.service.ranges_file import read_ranges
from gfm.sim.plant import stepping_spec
from gfm.sim.ranges import drawn_models, with_usual

#: Every actor draws the same models.
_DRAWN_SEED = 0
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
    if settings.control.ranges:
        return _drawn_assets(settings, files, complete)
    return EnvironmentAssets(
        models={kind: _compiled(file, complete) for kind, file in files.items()},
        effects=shared_effects(files.values()),
        trajectories=tuple(read_recording(Path(path)) for path in settings.recordings),
        ensemble=tuple(read_forces(forces_path(path)) for path in settings.control.ensemble),
    )


def _drawn_assets(
    settings: EnvironmentSettings,
    files: Mapping[CommandKind, ModelFile],
    complete: Complete | None,
) -> EnvironmentAssets:
    """Returns the same for a control task whose models have amounts drawn from ranges.

    Whoever builds the environment gets the same ones.
    """
    control, kind = settings.control, CommandKind.VELOCITY
    if kind not in files:
        raise ConfigError(
            f"ranges {control.ranges}: expected beside it the model that was diagnosed "
            "(models.velocity)"
        )
    file, ranges = files[kind], read_ranges(Path(control.ranges))
    check_there(file.spec, [one.usual for one in ranges], f"ranges {control.ranges}", file.where)
    effects = with_usual(ranges, file.effects)
    rng = np.random.default_rng(_DRAWN_SEED)
    try:
        spec = complete(file.spec) if complete else file.spec
        drawn = drawn_models(spec, ranges, effects, control.variants, rng)
    except ValueError as exc:
        raise _refused(file, exc) from exc
    return EnvironmentAssets(
        models={kind: drawn.variants[0]},
        effects=effects,
        ensemble=tuple(read_forces(forces_path(path)) for path in control.ensemble),
        drawn=drawn,
    )


def _refused(file: ModelFile, exc: ValueError) -> BadInputError:
    reason = " ".join(str(exc).split())
    return BadInputError(f"model {file.where}: {reason}; expected a robot's model")


def _compiled(file: ModelFile, complete: Complete | None) -> mujoco.MjModel:
    try:
        spec = complete(file.spec) if complete else file.spec
        return stepping_spec(spec, file.effects).compile()
    except ValueError as exc:
        raise _refused(file, exc) from exc
