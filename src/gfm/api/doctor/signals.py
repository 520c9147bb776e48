"""Whether recordings can be what they claim, and what is to be known of their quality."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from gfm.api.doctor.lines import doubt, refusal, some, well
from gfm.api.objections import Objection, dead_positions, objection_to, same_measurements
from gfm.api.recordings import Files
from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.found import LEAST_RATE_HZ, LEAST_TIME_S
from gfm.report.checks import Check
from gfm.report.findings import finding_amount, gathered
from gfm.signals.examine import findings_of
from gfm.signals.finding import Finding
from gfm.sim.plant import Plant

RATES, UNITS, QUALITY, OVERLAP, TIME = (
    "rates",
    "units and signs",
    "quality",
    "same measurements",
    "recorded time",
)
#: In a recording of fewer, what lies between two measurements may be as fast as the motion, 1/s.
_FEW_HZ = 25.0


def rates(files: Files) -> Iterator[Check]:
    """Checks how often was measured and commanded."""
    runs = [run for _, run in files]
    slow = {run.name: 1.0 / run.period_s for run in runs if 1.0 / run.period_s < _FEW_HZ}
    told = f"measured {_span([1.0 / run.period_s for run in runs])} times a second"
    if all(len(run.command_stamp_ns) > 1 for run in runs):
        told += f", commanded {_span([_command_hz(run) for run in runs])}"
    if not slow:
        yield well(RATES, told)
    elif min(slow.values()) < LEAST_RATE_HZ:
        advice = f"record at {LEAST_RATE_HZ:g} Hz at least, better at 100"
        yield refusal(RATES, f"{told}: dynamics cannot be told from {some(list(slow))}", advice)
    else:
        advice = "record at 100 Hz if you can: delays, lags and play are told from fast changes"
        yield doubt(RATES, told, advice)


def _command_hz(run: Trajectory) -> float:
    return 1.0 / float(np.median(np.diff(run.command_time_s)))


def _span(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:.3g}" if f"{low:.2g}" == f"{high:.2g}" else f"{low:.3g} to {high:.3g}"


def recorded_time(training: Files, holdout: Files) -> Iterator[Check]:
    """Checks how much there is to learn from, and what errors will be measured on."""
    seconds = sum(run.duration_s for _, run in training)
    told = f"{seconds:.1f} s in {len(training)} recordings to learn from"
    if seconds < LEAST_TIME_S:
        yield refusal(TIME, told, f"record more than {LEAST_TIME_S:g} s; half a minute is good")
    elif holdout:
        held = sum(run.duration_s for _, run in holdout)
        yield well(TIME, f"{told}, {held:.1f} s in {len(holdout)} held out")
    elif len(training) == 1:
        advice = "record another motion and give it with --holdout"
        yield doubt(TIME, f"{told}; errors will be measured on its end", advice)
    else:
        last = training[-1][1].name
        advice = "name another motion with --holdout, if this one is needed to learn from"
        yield doubt(TIME, f"{told}, of which {last} will be held out", advice)


def overlap(files: Files) -> Iterator[Check]:
    """Checks that no two recordings hold the same measurements."""
    found = False
    for (path, run), (other, seen) in combinations(files, 2):
        how = same_measurements(run, seen)
        if how:
            found = True
            advice = "leave one of them out: errors on what was fitted prove nothing"
            yield refusal(OVERLAP, f"{path.name} and {other.name}: {how}", advice)
    if not found and len(files) > 1:
        yield well(OVERLAP, f"in none of {len(files)} recordings")


def units(files: Files, plants: Mapping[CommandKind, Plant]) -> Iterator[Check]:
    """Checks that signals can be in rad, rad/s, N m and s, and were measured."""
    clean = True
    dead = dead_positions([run for _, run in files])
    if dead is not None:
        clean = False
        yield _objected(files[dead[0]][0], dead[1])
    for path, run in files:
        objection = objection_to(run, plants[run.command_kind])
        if objection is not None:
            clean = False
            yield _objected(path, objection)
    if clean:
        yield well(UNITS, f"can be rad, rad/s, N m and s in {len(files)} recordings")


def _objected(path: Path, why: Objection) -> Check:
    found = f"{path.name}: {why.where} {why.problem}"
    return refusal(UNITS, found, f"expected {why.expected}")


def quality(files: Files, plants: Mapping[CommandKind, Plant]) -> Iterator[Check]:
    """Tells everything that a diagnosis would doubt: stamps, echoes, flat tops, limits."""
    found = [one for _, run in files for one in findings_of(run, plants[run.command_kind])]
    doubtful = [one for one in found if one.doubtful]
    for row in gathered(doubtful):
        where = f"{some(row.joints)}: " if row.joints else ""
        runs = some(row.recordings, 3)
        yield doubt(QUALITY, f"{where}{row.what} {finding_amount(row)} ({runs})", row.consequence)
    if not doubtful:
        yield well(QUALITY, _known(found))


def _known(found: Sequence[Finding]) -> str:
    """Returns that nothing is doubtful, and what is good to know."""
    told = [f"{row.what} {finding_amount(row)}" for row in gathered(found)]
    clean = "no jitter, gap, clock jump, echo or flat top"
    return f"{clean}; {'; '.join(told)}" if told else clean
