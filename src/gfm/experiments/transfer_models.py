"""The cells of a campaign, each in a file of its folder: as it is believed, corrected, told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco

from gfm.api.models import load_nominal
from gfm.core import CommandKind
from gfm.diagnosis.output.correction import model_pair
from gfm.effects import EffectInstance
from gfm.envs.registry import as_trained, nominal_cell
from gfm.experiments.payload import bearing_payload
from gfm.experiments.policy_flags import CORRECTED, TOLD
from gfm.report.files import model_texts, write_texts


@dataclass(frozen=True, kw_only=True)
class TransferModels:
    """Writes each of them when it is asked for; the last two once.

    Attributes:
        task: Name of the environment.
        folder: Of the campaign; what was named stands in `diagnosis/`.
    """

    task: str
    folder: Path

    def nominal(self) -> Path:
        """Returns the file of the nominal cell."""
        return self._written("nominal", nominal_cell(self.task), ())

    def by_positions(self) -> Path:
        """Returns the file of the nominal cell whose joints are told positions."""
        spec = nominal_cell(self.task, CommandKind.POSITION)
        return self._written("nominal_position", spec, ())

    def corrected(self) -> Path:
        """Returns the file of the corrected cell as a policy is trained on it."""
        there = self.folder / f"{CORRECTED}.xml"
        if there.is_file():
            return there
        found = load_nominal([self._found()])
        spec = as_trained(found.specs[CommandKind.VELOCITY], self.task)
        return self._written(CORRECTED, spec, found.effects)

    def told(self) -> Path:
        """Returns the file of the corrected cell whose robot bears its payload."""
        there = self.folder / f"{TOLD}.xml"
        if there.is_file():
            return there
        found = load_nominal([self.corrected()])
        spec = bearing_payload(found.specs[CommandKind.VELOCITY])
        return self._written(TOLD, spec, found.effects)

    def _found(self) -> Path:
        """Returns the corrected model for commands of speeds, as the diagnosis left it."""
        folder = self.folder / "diagnosis"
        own = folder / f"corrected_{CommandKind.VELOCITY}.xml"  # of several kinds of command
        return own if own.is_file() else folder / "corrected.xml"

    def _written(self, stem: str, spec: mujoco.MjSpec, effects: Sequence[EffectInstance]) -> Path:
        write_texts(self.folder, model_texts(stem, model_pair(spec, effects)))
        return self.folder / f"{stem}.xml"
