"""Models of many simulations whose dry friction and forces are written before every step."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import final

import mujoco
import numpy as np
from mujoco import batch as mujoco_batch

from gfm.core.checks import Array
from gfm.sim.layout import Indices
from gfm.sim.step_laws import LawsAtWork, StepLaws


@final
class LevelledModels:
    """A copy of the model for each simulation of a batch, with its own levels of dry friction."""

    def __init__(
        self, batch: mujoco_batch.Batch, laws: StepLaws, models: Sequence[mujoco.MjModel]
    ) -> None:
        self._batch = batch
        self._at_work = LawsAtWork(batch, laws, models[0].opt.timestep)
        self._origin = list(models)
        self._own = [copy.copy(model) for model in models]
        self._constant: Array = np.stack([model.dof_frictionloss for model in models])

    def take(self, ids: Indices, models: Sequence[mujoco.MjModel]) -> None:
        """Lets the simulations `ids` begin anew on other models."""
        self._at_work.begin_anew(ids)
        for index, model in zip(ids, models, strict=True):
            if self._origin[index] is not model:
                self._origin[index] = model
                self._own[index] = copy.copy(model)
                self._constant[index] = model.dof_frictionloss
        self._batch.set_models(self._own)

    def write(self, force: Array) -> None:
        """Gives every simulation the levels and forces of its coming step.

        Args:
            force: What else acts, shape (N, nv).
        """
        levels = self._constant + self._at_work.apply(force).friction
        for model, level in zip(self._own, levels, strict=True):
            model.dof_frictionloss[:] = level
        self._batch.set_models(self._own)
