"""A fitted generalized force model in one file: policy, what it observes, where it acts."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gfm.core import BadInputError, ConfigError, Weights
from gfm.core.checks import Array32
from gfm.recording.weights_file import read_arrays, write_arrays
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.sim.features import Features
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import LearnedForces

_FORMAT = "gfm.forces/1"
_SCALES = ("mean", "scale", "torque_scale")


def write_forces(path: Path, model: HybridModel, features: Features, weights: Weights) -> None:
    """Writes a force model.

    Args:
        path: Where to; an .npz.
        model: What it was fitted on.
        features: What it observes.
        weights: Its policy.
    """
    policy = GaussianPolicy.from_weights(weights)
    forces = LearnedForces.of(model, features, policy)
    meta = {
        "format": _FORMAT,
        "version": weights.version,
        "joint_names": forces.joint_names,
        "forced_joints": forces.forced_joints,
        "on_object": forces.on_object,
        "control_period_s": forces.control_period_s,
        "history": features.history,
    }
    arrays = {f"policy/{name}": tensor for name, tensor in weights.tensors.items()}
    arrays |= {f"features/{name}": getattr(features, name) for name in _SCALES}
    write_arrays(path, meta, {**arrays, "force_limit": forces.force_limit})


def read_forces(path: Path) -> LearnedForces:
    """Returns the force model in a file.

    Raises:
        BadInputError: it cannot be read, is damaged, or is something else.
    """
    meta, arrays = read_arrays(path, _FORMAT)
    try:
        features = Features(
            history=int(meta["history"]), **{name: arrays[f"features/{name}"] for name in _SCALES}
        )
        return LearnedForces(
            joint_names=tuple(meta["joint_names"]),
            forced_joints=tuple(meta["forced_joints"]),
            on_object=bool(meta["on_object"]),
            force_limit=arrays["force_limit"].astype(np.float64),
            control_period_s=float(meta["control_period_s"]),
            features=features,
            policy=GaussianPolicy.from_weights(_policy(arrays)),
        )
    except ConfigError as exc:
        raise BadInputError(f"{path}: {exc}") from exc
    except (KeyError, TypeError, ValueError) as exc:
        raise BadInputError(f"{path}: damaged force model: {exc!r}") from exc


def _policy(arrays: Mapping[str, Array32]) -> dict[str, Array32]:
    prefix = "policy/"
    return {
        name.removeprefix(prefix): array
        for name, array in arrays.items()
        if name.startswith(prefix)
    }
