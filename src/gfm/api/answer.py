"""The answer of a diagnosis, for programs and notebooks: to read, look at, save and go on with."""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass, replace
from io import StringIO
from pathlib import Path
from typing import final

import mujoco
import plotly.graph_objects as go
from rich.console import Console

from gfm.api.films.overlay import film_of
from gfm.api.films.renderer import NoFilmError
from gfm.api.films.rerun_file import write_rrd
from gfm.api.folders import check_folder
from gfm.api.models import NominalModel, load_nominal, made_texts
from gfm.core import ConfigError, GfmError, UnknownNameError
from gfm.diagnosis.output import result
from gfm.diagnosis.output.motion import Motion
from gfm.diagnosis.output.result import ErrorSummary, NamedEffect, Suspect, Verdict
from gfm.effects import EffectInstance
from gfm.report import diagnosis_snippet, print_diagnosis, words, write_diagnosis
from gfm.report.document import error_picture, evidence
from gfm.report.figures import SERIES_POINTS
from gfm.report.files import forget_effects, write_texts
from gfm.report.film import Film

#: Characters of a line where a diagnosis is printed into a string.
_COLUMNS = 100


@final
@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Diagnosis:
    """What a model lacks to explain recordings of its robot; shown as a table where it ends a cell.

    Attributes:
        answer: All of it, as `report.json` has it, and the motion that is shown.
        nominal: The model that was diagnosed.
    """

    answer: result.Diagnosis
    nominal: NominalModel

    @property
    def verdict(self) -> Verdict:
        """The answer in one word; equals its text ("explained")."""
        return self.answer.verdict

    @property
    def sentence(self) -> str:
        """The answer in one sentence."""
        return self.answer.sentence

    @property
    def effects(self) -> tuple[NamedEffect, ...]:
        """What the model lacks, strongest first: effect, joints, parameters, confidence."""
        return self.answer.effects

    @property
    def suspects(self) -> tuple[Suspect, ...]:
        """What was weighed and not accepted, best first: effect, joints, reason, decided_by."""
        return self.answer.suspects

    @property
    def error(self) -> ErrorSummary:
        """Held-out open-loop position RMSE before and after, and the noise floor, rad."""
        return self.answer.error

    @property
    def corrected(self) -> mujoco.MjSpec:
        """The corrected model, new at every call; of several kinds of command that of the first."""
        return mujoco.MjSpec.from_string(self.answer.corrected_xml)

    @property
    def corrected_model(self) -> NominalModel:
        """The corrected model with what MJCF cannot say of it, wherever a model is taken."""
        first = result.ModelPair(
            xml=self.answer.corrected_xml, effects=self.answer.corrected_effects
        )
        pairs = self.answer.twins or {next(iter(self.nominal.specs)): first}
        specs = {kind: mujoco.MjSpec.from_string(pair.xml) for kind, pair in pairs.items()}
        beside = next(iter(pairs.values())).effects
        return replace(
            load_nominal(list(specs.values())),
            effects=tuple(map(_beside, beside)),
        )

    def table(self) -> list[dict[str, object]]:
        """Returns a row for every amount, with its interval: `pandas.DataFrame(d.table())`."""
        return [
            {
                "effect": one.effect,
                "joints": ", ".join(one.joints),
                "parameter": name,
                "value": estimate.value,
                "low": estimate.ci95 and estimate.ci95[0],
                "high": estimate.ci95 and estimate.ci95[1],
                "unit": estimate.unit,
                "confidence": one.confidence,
                "native": one.native,
            }
            for one in self.effects
            for name, estimate in one.parameters.items()
        ]

    def plot(self, effect: str | None = None) -> go.Figure:
        """Returns a picture: held-out errors by joint, or an effect's evidence.

        Args:
            effect: Name of one of the effects, or None for the errors.

        Raises:
            UnknownNameError: there is no evidence of that effect; names those of which there is.
            ConfigError: no joint could be compared.
        """
        if effect is None:
            picture = error_picture(self.answer)
            if picture is None:
                raise ConfigError(f"{self.verdict}: no joint could be compared; nothing to plot")
        else:
            plots = [one for one in self.answer.plots if one.effect == effect]
            shown = evidence(replace(self.answer, plots=tuple(plots)), SERIES_POINTS)
            if not shown:
                there = {one.effect for one in self.answer.plots if one.effect}
                raise UnknownNameError("effect", effect, there)
            picture = shown[0]
        return picture.figure.update_layout(title_text=picture.title, margin_t=72)

    def motion(self) -> Motion:
        """Returns joint positions as measured and by both models, on the worst held-out recording.

        Raises:
            ConfigError: errors were measured on no recording.
        """
        if self.answer.motion is None:
            raise ConfigError("no held-out recording; nothing moves")
        return self.answer.motion

    def film(self) -> Film:
        """Returns a film of `motion`; or why there is none. Takes up to half a minute.

        It needs the extra `video` and a renderer (EGL or OSMesa). Where it ends a cell, a notebook
        shows it.
        """
        try:
            motion = self.motion()
            spec = self.nominal.specs[motion.kind]
            return film_of(motion, spec, enlarge=self.verdict is not Verdict.NO_GAP)
        except NoFilmError as error:
            return Film(missing=str(error))
        except GfmError as error:
            return Film(missing=f"no film: {error}")

    def save_motion(self, path: str | Path) -> Path:
        """Writes `motion` as a file for Rerun: curves, residuals, and robots of sticks.

        Raises:
            ConfigError: the extra `rerun` is not installed, or nothing moves.
        """
        motion = self.motion()
        write_rrd(Path(path), motion, self.nominal.specs[motion.kind].copy().compile())
        return Path(path)

    def save(self, folder: str | Path, *, film: Film | None = None) -> tuple[Path, ...]:
        """Writes report.json, report.html, corrected.xml and what else there is; returns the paths.

        A nominal model that is in no file as it was used becomes nominal.xml beside them. All are
        written beside `folder` first, then moved there: none is ever half there.

        Args:
            folder: Where to; made where it is missing.
            film: To be shown in the page.

        Raises:
            BadInputError: a file is in the way of the folder.
        """
        out = Path(folder)
        check_folder(out)
        out.absolute().parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=f".{out.name}.", dir=out.absolute().parent))
        try:
            made = write_texts(part, made_texts(self.nominal))
            written = (*write_diagnosis(part, self.answer, film), *made)
            out.mkdir(exist_ok=True)
            for path in written:
                forget_effects(out / path.name)
            return tuple(path.replace(out / path.name) for path in written)
        finally:
            shutil.rmtree(part)

    def __repr__(self) -> str:
        named = ", ".join(map(words.named, self.effects)) or "nothing named"
        return f"<Diagnosis {self.verdict}: {named}>"

    def __str__(self) -> str:
        console = Console(file=StringIO(), width=_COLUMNS)
        with console.capture() as captured:
            print_diagnosis(console, self.answer)
        return captured.get()

    def _repr_html_(self) -> str:
        return diagnosis_snippet(self.answer)


def _beside(effect: NamedEffect) -> EffectInstance:
    """Returns an effect that stands beside a corrected model, as one that is read there."""
    instance = effect.instance()
    return replace(instance, in_model=effect.native and instance.effect.native)
