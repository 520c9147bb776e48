"""Every check of recordings: of each, and of the lateness that they show together.

Lateness is told in numbers with a spread, and with what they can and cannot mean.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.quality import channels, echoes, limits
from gfm.diagnosis.data.quality.finding import EVERYWHERE, Finding
from gfm.diagnosis.data.quality.lateness import Delays, delays
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance
from gfm.sim.plant import Plant, make_plant

#: What lies so many of its errors from zero, and as many seconds, is told.
ERRORS, LEAST_S = 3.0, 1e-3

_LAG = "dead time and the lag of servo and load together: no delay as such"
_TORQUE = "transport or stamping: nothing else lies between a commanded and a measured torque"
_AT_ONCE = "within a period of the measurements, and its error: as good as at once"
_EARLY = "an effect before its cause: commands are stamped late, or by another clock"
_ALIKE = "a delay either way, an offset of clocks, a slower servo, missing friction: all look alike"
_OWN = "beyond what all joints share: this joint's own delay, or a lag that the model lacks"
_IN_TURN = "joints read one after the other under one stamp: give read_offset_s in the mapping"


def findings_of(recording: Trajectory, plant: Plant) -> tuple[Finding, ...]:
    """Returns what is doubtful, or good to know, about a recording."""
    efforts: list[Finding] = []
    if recording.effort is not None:
        view, _ = limits.views_of(recording, plant)
        efforts += limits.cut_off_efforts(recording, recording.effort, view.drive)
        efforts += limits.doubtful_efforts(recording, view)
    return (
        *channels.jitter(recording),
        *channels.gaps(recording),
        *channels.repeated(recording),
        *channels.one_stamp_a_cycle(recording),
        *channels.still(recording),
        *echoes.echoed(recording),
        *limits.cut_off_speeds(recording),
        *limits.at_range_limit(recording, plant),
        *channels.odd_velocities(recording),
        *efforts,
        *channels.rounded(recording),
    )


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


def doubts(findings: Iterable[Finding], recording: str = EVERYWHERE) -> tuple[str, ...]:
    """Returns what puts a recording in doubt, in words; by default what is said of all."""
    return tuple(f.words for f in findings if f.doubtful and f.recording == recording)


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


def timing_of(recordings: Sequence[Trajectory], *late: Delays) -> tuple[Finding, ...]:
    """Returns what is to be said about lateness, over all recordings of a robot.

    Args:
        recordings: Of one robot.
        late: By how much later it moves than the nominal model, and the corrected one if anything
            was corrected, predict. What is said of single joints is said against the last.
    """
    found: list[Finding] = []
    for kind in CommandKind:
        of_kind = [r for r in recordings if r.command_kind is kind]
        if of_kind:
            found += _after_commands(delays(of_kind), of_kind)
    for one, model in zip(late, ("the model", "the corrected model"), strict=False):
        found += _in_common(one, model)
    return (*found, *_joint_by_joint(late[-1]))


def _after_commands(late: Delays, recordings: Sequence[Trajectory]) -> Iterator[Finding]:
    kind = recordings[0].command_kind
    meaning, unknown_s = _LAG, 0.0
    if kind is CommandKind.EFFORT:  # sampled just after their commands, torques seem early
        meaning = _TORQUE
        unknown_s = 0.5 * float(np.median([one.period_s for one in recordings]))
    for j in np.flatnonzero(np.isfinite(late.seconds)):
        error_s = max(ERRORS * late.error_s[j], LEAST_S) + unknown_s
        early = bool(late.seconds[j] < -error_s)
        at_once = kind is CommandKind.EFFORT and abs(late.seconds[j]) <= error_s
        consequence = _EARLY if early else _AT_ONCE if at_once else meaning
        told = _in_ms(f"answers {kind} commands after", late.seconds[j], late.spread_s[j])
        yield replace(told, joint=late.joints[j], consequence=consequence, doubtful=early)


def _in_common(late: Delays, model: str) -> Iterator[Finding]:
    known = np.isfinite(late.seconds)
    if known.any():
        what, spread_s = f"the joints move later than {model} by", np.median(late.spread_s[known])
        yield replace(_in_ms(what, late.common_s, spread_s), consequence=_ALIKE)


def _joint_by_joint(late: Delays) -> Iterator[Finding]:
    if late.per_joint_s is not None:
        told = _in_ms("lateness changes from joint to joint by", late.per_joint_s)
        yield replace(told, consequence=_IN_TURN, doubtful=True)
        return
    for j in np.flatnonzero(np.isfinite(late.seconds)):
        if abs(late.own_s[j]) > max(ERRORS * late.error_s[j], LEAST_S):
            told = _in_ms("moves later than predicted by", late.seconds[j], late.spread_s[j])
            yield replace(told, joint=late.joints[j], consequence=_OWN)


def _in_ms(what: str, late_s: float, spread_s: float | None = None) -> Finding:
    """Returns what is good to know about all recordings; what follows from it is left open."""
    return Finding(
        what=what,
        value=1e3 * float(late_s),
        unit="ms",
        consequence="",
        doubtful=False,
        spread=None if spread_s is None else 1e3 * float(spread_s),
    )
