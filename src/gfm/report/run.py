"""What one run of the whole loop found: the diagnosis, and the models it compared on held-out data.

Shape letters: T samples of a rollout, J joints, N samples of a training curve.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

from gfm.core import ShapeError, Status
from gfm.core.checks import Array, check_shapes
from gfm.diagnosis.output.result import Diagnosis
from gfm.report.transfer import Transfer

SCHEMA = "gfm.run/1"


class ModelKind(StrEnum):
    """The models that a run compares."""

    NOMINAL = "nominal"
    IDENTIFIED = "identified"
    HYBRID = "hybrid"
    CORRECTED = "corrected"
    CORRECTED_HYBRID = "corrected_hybrid"


class CurveGroup(StrEnum):
    """Training curves of one group share a panel."""

    REWARD = "reward"
    LOSS = "loss"
    KL = "kl"
    ERROR = "error"


@dataclass(frozen=True, kw_only=True)
class HeldOutRollout:
    """One held-out recording and what each model predicts for it, in open loop.

    Attributes:
        recording: Its name.
        joints: J names; the first is the base joint.
        time_s: shape (T,).
        setpoint: Commanded position at `time_s`, rad, shape (T, J); None for other commands.
        measured: rad, shape (T, J).
        predicted: rad, shape (T, J), by model.
    """

    recording: str
    joints: tuple[str, ...]
    time_s: Array
    setpoint: Array | None
    measured: Array
    predicted: Mapping[ModelKind, Array]

    def __post_init__(self) -> None:
        shape = (len(self.time_s), len(self.joints))
        arrays = {"setpoint": self.setpoint, "measured": self.measured}
        arrays |= {f"prediction of {model}": array for model, array in self.predicted.items()}
        check_shapes(arrays, dict.fromkeys(arrays, shape))


@dataclass(frozen=True, kw_only=True)
class ModelError:
    """One model's held-out position RMSE, rad.

    Attributes:
        model: Which.
        detail: What it is, in words with figures; may be empty.
        overall: Over all joints and held-out recordings.
        joints: The same per joint, J values.
    """

    model: ModelKind
    detail: str
    overall: float
    joints: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class ComparisonLine:
    """One joint's line of the comparison: the errors are in the order of the models."""

    joint: str
    errors: tuple[float, ...]
    floor: float

    @property
    def best(self) -> float | None:
        """The smallest finite error; None where there is none."""
        return min((error for error in self.errors if math.isfinite(error)), default=None)


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Held-out error of every model, with the noise floor of the sensors; rad.

    Attributes:
        joints: J names.
        noise_floor: Of all joints together.
        joint_noise_floors: J values.
        models: In the order in which they should be read.
    """

    joints: tuple[str, ...]
    noise_floor: float
    joint_noise_floors: tuple[float, ...]
    models: tuple[ModelError, ...]

    def __post_init__(self) -> None:
        expected = (len(self.joints),)
        rows = {"joint_noise_floors": self.joint_noise_floors}
        rows |= {f"error of {row.model}": row.joints for row in self.models}
        for name, values in rows.items():
            if (len(values),) != expected:
                raise ShapeError(name, (len(values),), str(expected))

    def lines(self) -> tuple[ComparisonLine, ...]:
        """Returns the table as it is read: all joints together, then joint by joint."""
        every = ComparisonLine(
            joint="all joints",
            errors=tuple(row.overall for row in self.models),
            floor=self.noise_floor,
        )
        single = (
            ComparisonLine(
                joint=joint,
                errors=tuple(row.joints[index] for row in self.models),
                floor=self.joint_noise_floors[index],
            )
            for index, joint in enumerate(self.joints)
        )
        return (every, *single)


@dataclass(frozen=True, kw_only=True)
class TrainingCurve:
    """One quantity over the course of the GFM's fit.

    Attributes:
        label: What it is.
        group: The panel it belongs to.
        unit: Empty for a pure number.
        wall_clock_s: Since the fit began, shape (N,).
        learner_steps: shape (N,).
        value: shape (N,).
    """

    label: str
    group: CurveGroup
    unit: str
    wall_clock_s: Array
    learner_steps: Array
    value: Array

    def __post_init__(self) -> None:
        shape = (len(self.value),)
        check_shapes(vars(self), {"wall_clock_s": shape, "learner_steps": shape})


@dataclass(frozen=True, kw_only=True)
class HiddenParameter:
    """A true parameter of a simulated robot's hidden effect."""

    value: float
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class HiddenEffect:
    """An effect that the simulated robot has and its nominal model lacks, from the sealed file.

    Attributes:
        effect: Name in the effect vocabulary.
        joints: Where it acts; empty for the whole robot.
        parameters: The truth, by parameter name.
    """

    effect: str
    joints: tuple[str, ...]
    parameters: Mapping[str, HiddenParameter]


@dataclass(frozen=True, kw_only=True)
class PhaseTime:
    """How long one phase of the run took, wall-clock."""

    name: str
    seconds: float


@dataclass(frozen=True, kw_only=True)
class SystemFacts:
    """What ran, and how much went through it.

    Attributes:
        processes: The services' last answers.
        env_steps: Of all actors.
        replay_sequences: Ever inserted.
        learner_steps: Updates.
        weights_version: The newest.
        rejected_messages: Of all services; anything but 0 deserves a look.
        phases: In order.
    """

    processes: tuple[Status, ...]
    env_steps: int
    replay_sequences: int
    learner_steps: int
    weights_version: int
    rejected_messages: int
    phases: tuple[PhaseTime, ...]


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """All that a run has to say.

    Attributes:
        run_id: Name of the run's folder.
        robot: What was driven, in words.
        simulated: Whether the robot was a simulated one.
        diagnosis: Verdict, effects, evidence.
        comparison: Models against held-out error.
        rollouts: Held-out recordings to look at; the first is the joint-control figure.
        training: Curves of the GFM's fit; empty where it was skipped.
        hidden: What the simulated robot's sealed file says, read after the verdict; empty where
            nothing was hidden, None where there is no such file.
        system: Processes, counts, durations.
        task: What a policy did on a robot before and after; None where that was left out.
    """

    run_id: str
    robot: str
    simulated: bool
    diagnosis: Diagnosis
    comparison: Comparison
    rollouts: tuple[HeldOutRollout, ...]
    training: tuple[TrainingCurve, ...]
    hidden: tuple[HiddenEffect, ...] | None
    system: SystemFacts
    task: Transfer | None = None
