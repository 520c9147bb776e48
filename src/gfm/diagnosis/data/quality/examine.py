"""Every check of a recording, in one place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gfm.core import Trajectory
from gfm.diagnosis.data.quality import channels, efforts, limits, stamps
from gfm.diagnosis.data.quality.finding import EVERYWHERE, Finding
from gfm.diagnosis.data.quality.timing import as_recordings, predicted_positions, timing_of
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance
from gfm.sim.plant import Plant, make_plant


def findings_of(recording: Trajectory, plant: Plant) -> tuple[Finding, ...]:
    """Returns what is doubtful, or good to know, about a recording."""
    return (
        *stamps.jitter(recording),
        *stamps.gaps(recording),
        *stamps.repeated(recording),
        *stamps.one_stamp_a_cycle(recording),
        *channels.still(recording),
        *channels.echoed(recording),
        *limits.cut_off_speeds(recording),
        *limits.at_range_limit(recording, plant),
        *channels.odd_velocities(recording),
        *_of_efforts(recording, plant),
        *channels.rounded(recording),
    )


def _of_efforts(recording: Trajectory, plant: Plant) -> list[Finding]:
    if recording.effort is None:
        return []
    views = efforts.views_of(recording, plant)
    return [
        *limits.cut_off_efforts(recording, recording.effort, views.drive),
        *efforts.doubtful_efforts(recording, views),
    ]


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
    nominal = predicted_positions(problem)
    corrected = predicted_positions(problem, effects) if effects else None
    return (*unseen, *each, *timing_of(recordings, nominal, corrected, as_recordings(problem)))


def doubts(findings: Iterable[Finding], recording: str = EVERYWHERE) -> tuple[str, ...]:
    """Returns what puts a recording in doubt, in words; by default what is said of all."""
    return tuple(f.words for f in findings if f.doubtful and f.recording == recording)
