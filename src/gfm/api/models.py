"""Models that are given: one robot's, by the kind of command that their actuators take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError
from gfm.effects import EffectInstance
from gfm.service.model_files import (
    ModelFile,
    effects_path,
    model_of,
    read_model,
    shared_effects,
)
from gfm.sim.drive_names import driven_joints

_FREE = int(mujoco.mjtJoint.mjJNT_FREE)
_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_NO_BIAS, _AFFINE = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)
_SERVO_DYNAMICS = (
    int(mujoco.mjtDyn.mjDYN_NONE),
    int(mujoco.mjtDyn.mjDYN_FILTER),
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT),
)


@dataclass(frozen=True, kw_only=True)
class NominalModel:
    """One robot's models, and what stands beside them.

    Attributes:
        specs: By the kind of command that their actuators take.
        paths: Where they are; without those that are in no file.
        effects: What the specs cannot say; the same for all of them.
        files: Everything that was read.
        about: What was found beside MJCF files, in lines.
    """

    specs: Mapping[CommandKind, mujoco.MjSpec]
    paths: Mapping[CommandKind, Path]
    effects: tuple[EffectInstance, ...]
    files: tuple[Path, ...]
    about: tuple[str, ...]


#: What a user may name as a robot's model: one, or one for each kind of command.
Given: TypeAlias = str | Path | mujoco.MjSpec
Model: TypeAlias = Given | Sequence[Given] | NominalModel


def load_nominal(given: Model) -> NominalModel:
    """Returns what was named as the model of a robot, with the effects in files beside MJCF.

    Args:
        given: Paths of MJCF, or specs, which stay as they are.

    Raises:
        BadInputError: a file is missing or damaged, its actuators take no one kind of command, or
            its robot floats.
        ConfigError: two models are of the same kind, or of different robots.
    """
    if isinstance(given, NominalModel):
        return given
    files: dict[CommandKind, ModelFile] = {}
    for one in given if isinstance(given, list | tuple) else [given]:
        file = _taken(one)
        model = file.spec.copy().compile()
        _check_base(model, file.where)
        kind = command_kind(model, file.where)
        if kind in files:
            raise ConfigError(
                f"{files[kind].where} and {file.where}: both have {kind} actuators; "
                "expected one model per kind of command"
            )
        files[kind] = file
    read = {kind: file.path for kind, file in files.items() if file.path is not None}
    beside = [effects_path(file.path) for file in files.values() if file.path and file.effects]
    return NominalModel(
        specs={kind: file.spec for kind, file in files.items()},
        paths=read,
        effects=shared_effects(files.values()),
        files=(*read.values(), *beside),
        about=tuple(line for file in files.values() for line in file.about),
    )


def _taken(given: object) -> ModelFile:
    match given:
        case str() | Path():
            return read_model(Path(given))
        case mujoco.MjSpec():
            return model_of(given)
    raise ConfigError(
        f"model is a {type(given).__name__}, expected the path of MJCF, or an MjSpec "
        "(mujoco.MjSpec.from_file): a model that can still be changed"
    )


def load_specs(given: Model) -> dict[CommandKind, mujoco.MjSpec]:
    """Returns the MJCF of `load_nominal` alone, for what asks for no more than shape and limits."""
    return dict(load_nominal(given).specs)


def _check_base(model: mujoco.MjModel, where: str) -> None:
    """Refuses a robot that floats: recordings of its joints do not tell where its base is."""
    for name in driven_joints(model):
        root = model.body_rootid[model.jnt_bodyid[model.joint(name).id]]
        free = model.body_jntadr[root] >= 0 and model.jnt_type[model.body_jntadr[root]] == _FREE
        if free:
            raise ConfigError(
                f"model {where}: {model.body(root).name}, which carries {name}, floats freely; "
                "expected a fixed base (take its free joint out where the robot stood or hung)"
            )


def command_kind(model: mujoco.MjModel, where: str) -> CommandKind:
    """Returns the kind of command that the drives of a model's joints take.

    Other actuators (a gripper's, that pulls at a tendon) stay as they are without a command.

    Raises:
        ConfigError: there are none, or they take different kinds.
    """
    kinds = {n: _actuator_kind(model, model.actuator(n).id) for n in driven_joints(model)}
    if not kinds:
        raise ConfigError(
            f"model {where}: no actuator drives a joint; expected one per commanded joint"
        )
    strange = [name for name, kind in kinds.items() if kind is None]
    if strange:
        raise ConfigError(
            f"model {where}: actuator {', '.join(strange)} is no position servo, velocity servo or "
            "motor"
        )
    first = next(iter(kinds.values()))
    if first is None or set(kinds.values()) != {first}:
        listed = ", ".join(f"{name} ({kind})" for name, kind in kinds.items())
        raise ConfigError(f"model {where}: actuators {listed}; expected one kind of command")
    return first


def _actuator_kind(model: mujoco.MjModel, index: int) -> CommandKind | None:
    """Returns what an actuator takes; None where that is neither of the three."""
    gain, bias = float(model.actuator_gainprm[index, 0]), model.actuator_biasprm[index, :3]
    fixed = model.actuator_gaintype[index] == _FIXED
    if not fixed or model.actuator_dyntype[index] not in _SERVO_DYNAMICS:
        return None
    if model.actuator_biastype[index] == _NO_BIAS:
        return CommandKind.EFFORT
    if model.actuator_biastype[index] != _AFFINE:
        return None
    if bias[1] != 0.0:
        return CommandKind.POSITION if np.isclose(gain, -bias[1]) else None
    return CommandKind.VELOCITY if bias[2] != 0.0 and np.isclose(gain, -bias[2]) else None
