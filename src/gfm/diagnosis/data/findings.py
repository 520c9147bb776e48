"""Every check of the recordings that a diagnosis is made of, also beside its models."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.core import Trajectory
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance
from gfm.signals.examine import findings_of, timing_of
from gfm.signals.finding import Finding
from gfm.signals.lateness import delays
from gfm.sim.plant import make_plant


def all_findings(
    problem: Problem,
    recordings: Sequence[Trajectory],
    holdout: Sequence[Trajectory],
    effects: Sequence[EffectInstance] = (),
) -> tuple[Finding, ...]:
    """Returns the findings of a diagnosis: of each recording, and of what they say together.

    Lateness is measured on what the problem is made of; held-out recordings are only examined.

    Args:
        problem: Of `recordings`, in segments as long as they can be.
        recordings: What effects are looked for in.
        holdout: What errors are measured on.
        effects: What corrects the model.
    """
    plants = {kind: make_plant(spec, problem.joints) for kind, spec in problem.specs.items()}
    each = [
        finding
        for recording in (*recordings, *holdout)
        for finding in findings_of(recording, plants[recording.command_kind])
    ]
    unseen = [
        Finding(
            joint=name,
            what="driven in the model, never recorded: taken to stand still at",
            value=position,
            unit="",
            consequence="fix the joint in the model where the robot held it",
        )
        for name, position in problem.still.items()
    ]
    parts, models = as_recordings(problem), [(), effects] if effects else [()]
    told = [problem.predictions([one])[0] for one in models]
    # What breaks off predicts nothing.
    known = [[np.where(p.diverged, np.nan, p.position) for p in one] for one in told]
    return (*unseen, *each, *timing_of(recordings, *(delays(parts, one) for one in known)))


def as_recordings(problem: Problem) -> list[Trajectory]:
    """Returns the segments of a problem as recordings."""
    return [
        Trajectory(
            name=f"segment {i}",
            joint_names=problem.joints,
            stamp_ns=np.round(1e9 * segment.time_s).astype(np.int64),
            position=segment.position,
            velocity=None,
            effort=segment.effort,
            command_kind=segment.kind,
            command_stamp_ns=np.round(1e9 * segment.command_time_s).astype(np.int64),
            command=segment.command,
            servo_gain=dict(zip(problem.joints, segment.servo_gain.tolist(), strict=True)),
        )
        for i, segment in enumerate(problem.segments)
    ]
