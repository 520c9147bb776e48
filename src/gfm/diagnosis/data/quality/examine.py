"""Every check of a recording, in one place."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from gfm.core import Trajectory
from gfm.diagnosis.data.quality import channels, efforts, limits, stamps, units
from gfm.diagnosis.data.quality.finding import Finding, Objection
from gfm.diagnosis.data.quality.overlap import shared_share, shared_stamps
from gfm.diagnosis.data.quality.timing import (
    EVERYWHERE,
    as_recordings,
    predicted_positions,
    timing_of,
)
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance
from gfm.sim.plant import Plant, make_plant

#: Torques are judged on so many measurements at most: enough to know a sign by.
MOST_ROWS = 4000
#: A recording is another one's copy when it shares so much of its motion ...
COPY = 0.5
#: ... or overlaps it when so many measurements are the same, stamp and all.
OVERLAP = 10


def objection_to(recording: Trajectory, plant: Plant) -> Objection | None:
    """Returns why a recording cannot be used with a model, or None.

    Stamps come first: with them wrong, all speeds are; efforts last: they need all else right.
    """
    objection = (
        stamps.absurd_rate(recording)
        or channels.stuck_position(recording)
        or channels.stuck_effort(recording)
        or units.velocity_ratio(recording)
        or units.command_ratio(recording)
        or units.beyond_range(recording, plant)
        or units.wound_up(recording, plant)
    )
    if objection is not None:
        return objection
    head = _head(recording)
    energy = units.surplus_energy(head, plant)
    if energy is not None or recording.effort is None:
        return energy
    return efforts.wrong_effort(head, efforts.views_of(head, plant))


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
        *units.odd_velocities(recording),
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
    unseen = [_unrecorded(name, position) for name, position in problem.still.items()]
    nominal = predicted_positions(problem)
    corrected = predicted_positions(problem, effects) if effects else None
    return (*unseen, *each, *timing_of(recordings, nominal, corrected, as_recordings(problem)))


def _unrecorded(name: str, position: float) -> Finding:
    return Finding(
        recording=EVERYWHERE,
        joint=name,
        what="driven in the model, never recorded: taken to stand still at",
        value=position,
        unit="",
        consequence="fix the joint in the model where the robot held it",
    )


def doubts(findings: Iterable[Finding], recording: str = EVERYWHERE) -> tuple[str, ...]:
    """Returns what puts a recording in doubt, in words; by default what is said of all."""
    return tuple(f.words for f in findings if f.doubtful and f.recording == recording)


def same_measurements(one: Trajectory, other: Trajectory) -> str:
    """Returns in which way two recordings are the same, or an empty text."""
    share = shared_share(one, other)
    if share > COPY:
        return f"{100 * share:.0f} % of the motion is the same to the last digit"
    count = shared_stamps(one, other)
    if count > OVERLAP:
        return f"{count} measurements of the motion have the same stamps and values"
    return ""


def _head(recording: Trajectory) -> Trajectory:
    rows = slice(MOST_ROWS)
    return replace(
        recording,
        stamp_ns=recording.stamp_ns[rows],
        position=recording.position[rows],
        velocity=None if recording.velocity is None else recording.velocity[rows],
        effort=None if recording.effort is None else recording.effort[rows],
    )
