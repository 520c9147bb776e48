"""What one set of recordings says of a robot by itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import LONG, SHORT, all_segments, make_problem, prepared
from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.output.claims import credible, named_effects
from gfm.diagnosis.output.result import NamedEffect
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.loop import search, search_object
from gfm.diagnosis.search.trace import SearchResult
from gfm.effects import EffectInstance

#: Less motion or time than this says nothing about dynamics.
LEAST_MOTION_RAD, LEAST_TIME_S, LEAST_RATE_HZ = 0.01, 1.5, 10.0
#: Recorded time in which effects are looked for, and on which amounts are settled, s.
SEARCHED_S, SETTLED_S = 24.0, 36.0


@dataclass(frozen=True, kw_only=True)
class Found:
    """What was found in a set of recordings.

    Attributes:
        recordings: The set.
        short: What effects were looked for in.
        long: What amounts were settled on.
        result: The search; None where nothing can be said about dynamics.
        lack: Why not; empty where something can.
        pushed: What the robot feels of an object, and in what; None where it pushes none.
    """

    recordings: Sequence[Trajectory]
    short: Problem
    long: Problem
    result: SearchResult | None
    lack: str
    pushed: tuple[SearchResult, Problem] | None = None

    @property
    def results(self) -> tuple[SearchResult, ...]:
        """What searches found: of the robot, and of what it feels of an object."""
        felt = [] if self.pushed is None else [self.pushed[0]]
        return () if self.result is None else (self.result, *felt)

    def named(self, *, keep_suspects: bool) -> tuple[NamedEffect, ...]:
        """Returns the effects that are named, with amounts fitted without the others."""
        if self.result is None:
            return ()
        parts = [(self.result, self.long), *([self.pushed] if self.pushed else [])]
        return tuple(one for part in parts for one in _named(*part, keep_suspects=keep_suspects))


def _named(
    result: SearchResult, problem: Problem, *, keep_suspects: bool
) -> tuple[NamedEffect, ...]:
    effects = list(result.fit.effects) if keep_suspects else credible(result)
    if len(effects) < len(result.fit.effects):
        result = replace(result, fit=fit(problem, effects))
    return named_effects(problem.slices(), result, result.fit.effects)


def find_in(
    recordings: Sequence[Trajectory],
    specs: Mapping[CommandKind, mujoco.MjSpec],
    given: Sequence[EffectInstance],
    report: Callable[[str], None],
    time_left: Callable[[], float],
) -> Found:
    """Returns which effects the model `specs` lacks, beside which `given` stands.

    Args:
        recordings: What effects are looked for in and fitted to.
        specs: The model by the kind of command.
        given: Effects of it that they cannot say.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
    """
    report("measuring the nominal model")
    short = make_problem(specs, recordings, given=given, most_s=SEARCHED_S)
    long, lack = short, _lacking(recordings)
    if any(LONG[kind] > SHORT[kind] for kind in specs):
        long = make_problem(
            specs, recordings, short.noise, given=given, windows_s=LONG, most_s=SETTLED_S
        )
    if lack:
        return Found(recordings=recordings, short=short, long=long, result=None, lack=lack)
    everything = all_segments(specs, recordings, short.noise, given=given)
    result, long = search(short, long, everything, recordings, report, time_left)
    beside, pushed = (*given, *credible(result)), None
    pushing = all_segments(specs, recordings, short.noise, given=beside, touching=True)
    if pushing.pushing:
        report("looking at what the robot feels of the object")
        pushed = search_object(prepared(pushing, SEARCHED_S), recordings, report, time_left)
    return Found(
        recordings=recordings, short=short, long=long, result=result, lack="", pushed=pushed
    )


def _lacking(recordings: Sequence[Trajectory]) -> str:
    """Returns why nothing can be said about dynamics, or an empty text."""
    moved = max(float(np.ptp(r.position, axis=0).max()) for r in recordings)
    time_s = sum(r.duration_s for r in recordings)
    rate_hz = min(1.0 / r.period_s for r in recordings)
    if moved < LEAST_MOTION_RAD:
        return f"no joint moves by more than {moved:.4f} rad"
    if time_s < LEAST_TIME_S:
        return f"only {time_s:.2f} s were recorded"
    if rate_hz < LEAST_RATE_HZ:
        return f"{rate_hz:.1f} measurements per second are too few"
    return ""
