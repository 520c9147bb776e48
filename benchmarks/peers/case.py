"""A case as a peer sees it, and an answer as it is scored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gfm.api.models import load_specs
from gfm.api.recordings import read_recordings
from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance, find_effect

Specs = Mapping[CommandKind, mujoco.MjSpec]


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Recordings and the nominal model.

    Attributes:
        specs: The model, by kind of command.
        training: What to learn from.
        problem: The same as rollouts.
        held_out: What errors are measured on.
    """

    specs: Specs
    training: Sequence[Trajectory]
    problem: Problem
    held_out: Sequence[Trajectory]

    @property
    def joints(self) -> tuple[str, ...]:
        """The measured joints."""
        return self.problem.joints

    def held_out_error(self, specs: Specs, effects: Sequence[EffectInstance] = ()) -> float:
        """Returns the position RMSE of open-loop rollouts of a model, rad."""
        problem = prepared(all_segments(specs, self.held_out, self.problem.noise))
        errors = np.concatenate([e.ravel() for e in problem.position_errors(effects)])
        return float(np.sqrt(np.mean(errors**2)))


def load(folder: Path) -> Case:
    """Returns the case in a folder."""
    specs = load_specs(sorted(folder.glob("*.xml")))
    training = read_recordings(sorted(folder.glob("train_*.mcap")))
    held_out = read_recordings(sorted(folder.glob("held_*.mcap")))
    problem = prepared(all_segments(specs, training))
    return Case(specs=specs, training=training, problem=problem, held_out=held_out)


@dataclass(frozen=True, kw_only=True)
class Named:
    """An effect that a peer names, with what it says of its size, and how much it explains."""

    effect: str
    joints: tuple[str, ...]
    parameters: Mapping[str, float]
    weight: float

    @property
    def instance(self) -> EffectInstance | None:
        """The effect in gfm's terms; None where the peer does not say all of it."""
        effect = find_effect(self.effect)
        whole = all(p.name in self.parameters for p in effect.parameters)
        if not whole or not effect.admissible(self.parameters):
            return None
        return EffectInstance(effect=effect, joints=self.joints, values=self.parameters)


def answer(case: Case, named: Sequence[Named], after: float) -> dict[str, Any]:
    """Returns an answer in the form of a report.

    Args:
        case: What was asked.
        named: What the peer names.
        after: Held-out error of what it made of the model, rad.
    """
    strongest = sorted(named, key=lambda one: -one.weight)
    return {
        "verdict": "–",
        "effects": [
            {
                "effect": one.effect,
                "joints": list(one.joints),
                "parameters": {
                    name: {"value": float(value), "unit": "", "ci95": None}
                    for name, value in one.parameters.items()
                },
                "confidence": 1.0,
            }
            for one in strongest
        ],
        "suspects": [],
        "error": {
            "before": case.held_out_error(case.specs),
            "after": after,
            "noise_floor": float(np.sqrt(np.mean(case.problem.noise.position**2))),
        },
    }


def rises(costs: Array, best: float) -> Array:
    """Returns by how much the cost rises when each parameter goes back to nominal, shape (P,)."""
    return np.asarray(np.nan_to_num(costs, nan=np.inf) - best)
