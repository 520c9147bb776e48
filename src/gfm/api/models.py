"""Models that are given: one robot's, by the kind of command that their actuators take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np

from gfm.core import CommandKind, ConfigError
from gfm.diagnosis.output.correction import model_pair
from gfm.effects import EffectInstance
from gfm.report.files import model_texts, write_texts
from gfm.service.actuators import FORMS, ActuatorRule
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
        about: What was found beside MJCF files, and done to what was given, in lines.
        made: Kinds whose model is in no file as it is used.
    """

    specs: Mapping[CommandKind, mujoco.MjSpec]
    paths: Mapping[CommandKind, Path]
    effects: tuple[EffectInstance, ...]
    files: tuple[Path, ...]
    about: tuple[str, ...]
    made: tuple[CommandKind, ...] = ()


#: What a user may name as a robot's model: one, or one for each kind of command.
Given: TypeAlias = str | Path | mujoco.MjSpec
Model: TypeAlias = Given | Sequence[Given] | NominalModel


def load_nominal(given: Model, actuators: str | None = None) -> NominalModel:
    """Returns what was named as the model of a robot, with the effects in files beside MJCF.

    Args:
        given: Paths of MJCF or URDF, "robot_descriptions:NAME", or specs, which stay as they are.
        actuators: What joints without an actuator get: "position:kp=50,kv=1", "velocity:kv=5" or
            "torque"; kp in N m/rad, kv in N m s/rad.

    Raises:
        BadInputError: a file is missing or damaged, its actuators take no one kind of command, or
            its robot floats.
        ConfigError: two models are of the same kind, or of different robots.
    """
    if isinstance(given, NominalModel):
        return given
    rule = ActuatorRule.read(actuators) if actuators else None
    files: dict[CommandKind, ModelFile] = {}
    for one in given if isinstance(given, list | tuple) else [given]:
        file = _taken(one, rule)
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
        made=tuple(kind for kind, file in files.items() if file.made or file.path is None),
    )


def made_texts(nominal: NominalModel) -> dict[str, str]:
    """Returns the models that are in no file as they are used, as files by name.

    In the words of MuJoCo, as corrected models are: the two can be laid side by side.
    """
    several = len(nominal.specs) > 1
    pairs = {kind: model_pair(nominal.specs[kind], nominal.effects) for kind in nominal.made}
    return {
        name: text
        for kind, pair in pairs.items()
        for name, text in model_texts(_stem(kind, several=several), pair).items()
    }


def model_paths(nominal: NominalModel, folder: Path) -> dict[CommandKind, Path]:
    """Returns where every kind's model is as it is used; writes those to `folder` that are not."""
    write_texts(folder, made_texts(nominal))
    several = len(nominal.specs) > 1
    made = {kind: folder / f"{_stem(kind, several=several)}.xml" for kind in nominal.made}
    return {**nominal.paths, **made}


def _stem(kind: CommandKind, *, several: bool) -> str:
    return f"nominal_{kind}" if several else "nominal"


def _taken(given: object, actuators: ActuatorRule | None) -> ModelFile:
    match given:
        case str() | Path():
            return read_model(given, actuators)
        case mujoco.MjSpec():
            return model_of(given, actuators)
    raise ConfigError(
        f"model is a {type(given).__name__}, expected the path of MJCF or URDF, or an MjSpec "
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
            f"model {where}: no actuator drives a joint; expected one per commanded joint "
            f"(--actuators {FORMS} adds them)"
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
