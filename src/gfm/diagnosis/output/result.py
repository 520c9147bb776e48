"""What a diagnosis says: values only, the contract of `report.json`.

Shape letters: J joints, S samples of a plotted series.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.diagnosis.evidence.links import EvidenceChain
from gfm.diagnosis.learned import LearnedReport
from gfm.diagnosis.output.changes import Changes
from gfm.diagnosis.output.motion import Motion
from gfm.effects import EffectInstance, Placed, find_effect
from gfm.excitation.blind_spots import BlindSpot
from gfm.signals.finding import Finding

SCHEMA = "gfm.diagnosis/1"


class Verdict(StrEnum):
    """The answer in one word."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY_EXPLAINED = "partly_explained"
    UNEXPLAINED = "unexplained"
    INSUFFICIENT_DATA = "insufficient_data"


@dataclass(frozen=True, kw_only=True)
class ParameterEstimate:
    """One parameter of an effect, as added to what the model already has.

    Attributes:
        value: In `unit`.
        unit: SI.
        ci95: Interval that covers the truth with probability 0.95, or None where it is withheld.
        spread: Where it is withheld because the model is still wrong: how far to either side the
            truth may be expected, from simulated robots whose models stayed wrong.
    """

    value: float
    unit: str
    ci95: tuple[float, float] | None
    spread: float | None = None


@dataclass(frozen=True, kw_only=True)
class NamedEffect(Placed):
    """One effect that the data support.

    Attributes:
        parameters: Estimates by parameter name.
        confidence: 0..1.
        native: Whether plain MuJoCo expresses it in `corrected.xml`.
        evidence: The figures from which its confidence comes.
        equals: Its other names here: the confidence is that one of them all is right.
    """

    parameters: Mapping[str, ParameterEstimate]
    confidence: float
    native: bool
    evidence: Mapping[str, float] = field(default_factory=dict)
    equals: tuple[Placed, ...] = ()

    def instance(self) -> EffectInstance:
        """Returns the effect with its estimated amounts, to be put into a model."""
        return EffectInstance(
            effect=find_effect(self.effect),
            joints=self.joints,
            values={name: estimate.value for name, estimate in self.parameters.items()},
        )


@dataclass(frozen=True, kw_only=True)
class Suspect(Placed):
    """A candidate that was weighed and not accepted.

    Attributes:
        reason: Why it was not accepted, in words with figures.
        decided_by: The motion that would decide, in words; empty where none is needed.
        gain: Share of the squared residual that it alone would explain, 0..1.
        confidence: Of one that was found and is not named; None for others.
        evidence: The figures from which that comes.
        amounts: In which it was found, by parameter; none of others.
        nameless: State and joint of a law without a name in its place, in words; or empty.
    """

    reason: str
    decided_by: str = ""
    gain: float = 0.0
    confidence: float | None = None
    evidence: Mapping[str, float] = field(default_factory=dict)
    amounts: Mapping[str, float] = field(default_factory=dict)
    nameless: str = ""


@dataclass(frozen=True, kw_only=True)
class ErrorSummary:
    """Open-loop rollout position error (RMSE) on the held-out recordings."""

    before: float
    after: float
    noise_floor: float
    unit: str = "rad"


@dataclass(frozen=True, kw_only=True)
class RecordingSummary:
    """One recording's line of the input table.

    Attributes:
        name: As given.
        role: "training" or "held-out".
        command: Command kind.
        duration_s: Length.
        rate_hz: Median sample rate of the joint states.
        before: Position RMSE under the nominal model, rad.
        after: Position RMSE under the corrected model, rad.
        warnings: Whatever is doubtful about it, in words.
    """

    name: str
    role: str
    command: str
    duration_s: float
    rate_hz: float
    before: float
    after: float
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Series:
    """One line or cloud of a plot: shape (S,) each, with the axis labels (unit in brackets).

    `style` is "points" or "line".
    """

    label: str
    x: Array
    y: Array
    style: str


@dataclass(frozen=True, kw_only=True)
class EvidencePlot:
    """The picture that shows an effect in the data: measured points and the fitted law over them.

    Attributes:
        title: What is seen, in words.
        effect: The effect that it belongs to; empty for general pictures.
        joint: Whose signal is shown.
        x_label: With unit.
        y_label: With unit.
        series: What is drawn.
    """

    title: str
    effect: str
    joint: str
    x_label: str
    y_label: str
    series: tuple[Series, ...]


@dataclass(frozen=True, kw_only=True)
class ModelPair:
    """A model as two files.

    Attributes:
        xml: MJCF text; plain MuJoCo loads it.
        effects: What it cannot say, to stand beside it; empty where it says everything. Of an
            effect that is native it has what MuJoCo expresses.
    """

    xml: str
    effects: tuple[NamedEffect, ...]


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The whole answer.

    Attributes:
        verdict: In one word.
        sentence: The verdict in one sentence, for people.
        effects: Accepted effects, strongest first.
        suspects: Candidates not accepted, best first.
        error: Held-out error before and after, initial states fitted.
        as_measured: The same with initial states as measured; None where that is not known.
        joints: The same of every joint, by its name.
        object_error: The same of the pushed object's position (m) and yaw (rad); empty without one.
        recordings: What went in.
        findings: What is to be known of their quality.
        blind_spots: Effects that the training recordings could not have shown.
        corrected_xml: The corrected model, MJCF text.
        corrected_effects: What it cannot say, see `ModelPair`.
        twins: The corrected models by kind of command, where there was more than one.
        chain: The evidence step by step.
        gfm: What learned forces say, where there are any.
        changes: Since earlier recordings, where there were any.
        plots: Evidence, in the order in which it should be read.
        motion: The held-out recording that shows the gap best; None where that is not known.
        notes: What a reader should know: assumptions, doubts, what to record next.
        provenance: Files, hashes, versions, seed.
    """

    verdict: Verdict
    sentence: str
    effects: tuple[NamedEffect, ...]
    suspects: tuple[Suspect, ...]
    error: ErrorSummary
    joints: Mapping[str, ErrorSummary]
    recordings: tuple[RecordingSummary, ...]
    corrected_xml: str
    corrected_effects: tuple[NamedEffect, ...] = ()
    as_measured: ErrorSummary | None = None
    object_error: Mapping[str, ErrorSummary] = field(default_factory=dict)
    twins: Mapping[CommandKind, ModelPair] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    blind_spots: tuple[BlindSpot, ...] = ()
    chain: EvidenceChain | None = None
    gfm: LearnedReport | None = None
    changes: Changes | None = None
    plots: tuple[EvidencePlot, ...] = ()
    motion: Motion | None = None
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, object] = field(default_factory=dict)
