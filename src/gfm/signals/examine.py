"""Every check of recordings: of each, and of the lateness that they show together.

Lateness is told in numbers with a spread, and with what they can and cannot mean.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.signals import channels, echoes, limits
from gfm.signals.finding import EVERYWHERE, Finding
from gfm.signals.lateness import Delays, delays
from gfm.sim.plant import Plant

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


def doubts(findings: Iterable[Finding], recording: str = EVERYWHERE) -> tuple[str, ...]:
    """Returns what puts a recording in doubt, in words; by default what is said of all."""
    return tuple(f.words for f in findings if f.doubtful and f.recording == recording)


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
