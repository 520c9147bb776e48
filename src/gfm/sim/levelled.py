"""Models of many simulations whose dry friction is written before every step.

Shape letters: N simulations, M sensor data.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from mujoco import batch as mujoco_batch

from gfm.core.checks import Array
from gfm.sim.step_laws import StepLaws


@final
class LevelledModels:
    """A copy of the model for each of N simulations: theirs is the one field that changes."""

    def __init__(self, laws: StepLaws, models: Sequence[mujoco.MjModel]) -> None:
        self._laws = laws
        self._origin = list(models)
        self._own = [copy.copy(model) for model in models]
        self._constant: Array = np.stack([model.dof_frictionloss for model in models])

    def take(self, index: int, model: mujoco.MjModel) -> None:
        """Lets a simulation run on another model from now."""
        if self._origin[index] is not model:
            self._origin[index] = model
            self._own[index] = copy.copy(model)
            self._constant[index] = model.dof_frictionloss

    def hand_over(self, batch: mujoco_batch.Batch) -> None:
        """Lets the batch run on the copies as they are."""
        batch.set_models(self._own)

    def write(self, batch: mujoco_batch.Batch, qvel: Array, sensordata: Array) -> None:
        """Gives the batch the levels of its coming step.

        Args:
            batch: Of N simulations.
            qvel: rad/s, shape (N, nv).
            sensordata: shape (N, M).
        """
        levels = self._laws.levels(self._constant, qvel, sensordata)
        for model, level in zip(self._own, levels, strict=True):
            model.dof_frictionloss[:] = level
        self.hand_over(batch)
