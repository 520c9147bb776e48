"""Checkpoints: everything from which learning goes on as if nothing had happened."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import torch

import gfm
from gfm.core import BadInputError, ConfigError, EnvironmentSpec, Weights
from gfm.recording.weights_file import earlier, read_arrays, read_weights, write_arrays
from gfm.rl.learner_state import (
    LearnerSettings,
    LearnerState,
    init_learner,
    load_policy_tensors,
    load_state_arrays,
    policy_tensors,
    state_arrays,
)
from gfm.service.config import differing
from gfm_learner.config import LearnerConfig

CHECKPOINT = "checkpoint.npz"
POLICY = "policy.npz"
_FORMAT = "gfm.checkpoint/2"
_GENERATOR = "generator"

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Where a learner stands, with the source of its chance.

    Attributes:
        spec: The environment learned for.
        state: Networks, targets, optimiser, duals and steps.
        generator: Of the sampled actions.
        past_life: Of the learner that came so far; its weights are not those of the next one.
    """

    spec: EnvironmentSpec
    state: LearnerState
    generator: torch.Generator
    past_life: int = 0


def begin(config: LearnerConfig, spec: EnvironmentSpec) -> Progress:
    """Returns where to begin: at the checkpoint, at given weights, or at random.

    Raises:
        BadInputError: both checkpoints, or a weights file, are damaged or for something else.
    """
    if config.checkpoint_dir and config.resume:
        newest = Path(config.checkpoint_dir) / CHECKPOINT
        paths = [path for path in (newest, earlier(newest)) if path.exists()]
        if paths:
            return _resumed(paths, config, spec)
    progress = _random_start(config, spec)
    if config.init:
        _load_initial(Path(config.init), progress)
        _log.info("started from the policy in %s", config.init)
    return progress


def _resumed(paths: Sequence[Path], config: LearnerConfig, spec: EnvironmentSpec) -> Progress:
    """Returns the progress of the first checkpoint that is not damaged."""
    path, *others = paths
    try:
        progress = load_checkpoint(path, config, _random_start(config, spec))
    except ConfigError:
        raise
    except BadInputError as error:
        if not others:
            raise
        _log.warning("%s; going on from the one before", error)
        return _resumed(others, config, spec)
    _log.info("resumed %s at step %d", path, progress.state.steps)
    return progress


def _random_start(config: LearnerConfig, spec: EnvironmentSpec) -> Progress:
    device = _device(config.device)
    generator = torch.Generator(device).manual_seed(config.seed)
    state = init_learner(spec, config.learning, config.seed, device)
    return Progress(spec=spec, state=state, generator=generator)


def _device(name: str) -> torch.device:
    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as exc:
        reason = str(exc).splitlines()[0]
        raise ConfigError(f"device {name!r} cannot be used: {reason}") from exc
    return device


def _load_initial(path: Path, progress: Progress) -> None:
    given = read_weights(path)
    own = Weights(version=0, created_ns=0, spec_digest="", tensors=policy_tensors(progress.state))
    if given.architecture != own.architecture:
        difference = _first_difference(given, own)
        raise BadInputError(f"{path}: {difference} (is it a policy for another task?)")
    load_policy_tensors(progress.state, given.tensors)


def _first_difference(given: Weights, own: Weights) -> str:
    for name in sorted(given.tensors.keys() | own.tensors.keys()):
        shapes = [
            str(weights.tensors[name].shape) if name in weights.tensors else "absent"
            for weights in (given, own)
        ]
        if shapes[0] != shapes[1]:
            return f"{name} is {shapes[0]}, expected {shapes[1]}"
    return "another architecture"


def save_checkpoint(path: Path, config: LearnerConfig, progress: Progress, life: int) -> None:
    """Writes a checkpoint of a life and keeps the one before; a crash leaves both or one, whole.

    Raises:
        OSError: it could not be written; the ones before are still there.
    """
    meta = {
        "format": _FORMAT,
        "code_version": gfm.__version__,
        "steps": progress.state.steps,
        "life": life,
        "spec": asdict(progress.spec),
        "config": msgspec.to_builtins(config),
    }
    arrays = state_arrays(progress.state)
    arrays[_GENERATOR] = progress.generator.get_state().numpy()
    write_arrays(path, meta, arrays, keep_earlier=True)


def load_checkpoint(path: Path, config: LearnerConfig, progress: Progress) -> Progress:
    """Returns the progress that a checkpoint holds, loaded into `progress`.

    Raises:
        BadInputError: the file is damaged.
        ConfigError: it was made for another environment or with other settings of learning.
    """
    meta, arrays = read_arrays(path, _FORMAT)
    _check_same(path, meta, config.learning, progress.spec)
    try:
        generator_state = torch.from_numpy(arrays.pop(_GENERATOR))
        state = load_state_arrays(progress.state, arrays, int(meta["steps"]))
        past_life = int(meta["life"])
        progress.generator.set_state(generator_state)
    except (KeyError, RuntimeError, TypeError, ValueError) as exc:
        reason = " ".join(str(exc).split())
        raise BadInputError(f"{path}: damaged checkpoint: {reason}") from exc
    return replace(progress, state=state, past_life=past_life)


def _check_same(
    path: Path, meta: Mapping[str, Any], learning: LearnerSettings, spec: EnvironmentSpec
) -> None:
    stored = {"spec": meta.get("spec", {}), "learning": meta.get("config", {}).get("learning", {})}
    wanted = {"spec": asdict(spec), "learning": json.loads(msgspec.json.encode(learning))}
    others = [
        f"{name} is {here!r} here, {there!r} there"
        for name, here, there in differing(wanted, stored)
    ]
    if others:
        raise ConfigError(
            f"{path} was made with other settings: {'; '.join(others)}. Use the same, "
            "another folder, or --no-resume to begin anew"
        )
