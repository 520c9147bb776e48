"""What one set of recordings says of a robot by itself."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

from gfm.core import CommandKind, Trajectory
from gfm.diagnosis.data.segmentation import LONG, SHORT, airborne, all_segments, prepared
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.output.claims import credible, named_effects
from gfm.diagnosis.output.result import NamedEffect
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.hypothesis import Hypothesis, P, in_turn
from gfm.diagnosis.search.loop import search, search_object
from gfm.diagnosis.search.moves.reduce import gains_of_each
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
        lack: Why nothing can be said about dynamics; empty where something can.
        results: What searches found: of the robot, and of what it feels of an object that it
            pushes. None where something lacks.
    """

    recordings: Sequence[Trajectory]
    short: Problem
    long: Problem
    lack: str = ""
    results: tuple[SearchResult[Problem], ...] = ()

    @property
    def result(self) -> SearchResult[Problem] | None:
        """What was found of the robot by itself."""
        return self.results[0] if self.results else None

    @property
    def every(self) -> tuple[EffectInstance, ...]:
        """What was found, suspects among it, with amounts fitted together."""
        return tuple(e for one in self.results for e in one.fit.effects)

    def named(self, *, keep_suspects: bool) -> tuple[NamedEffect, ...]:
        """Returns the effects that are named, with amounts fitted without the others."""
        return tuple(e for one in self.results for e in _named(one, keep_suspects=keep_suspects))


def _named(result: SearchResult, *, keep_suspects: bool) -> tuple[NamedEffect, ...]:
    effects = list(result.fit.effects) if keep_suspects else credible(result)
    if len(effects) < len(result.fit.effects):
        problem, fitted = _by_themselves(result.problem, effects)
        result = replace(result, problem=problem, fit=fitted)
    return named_effects(result, result.fit.effects)


def _by_themselves(problem: P, effects: Sequence[EffectInstance]) -> tuple[P, Fit]:
    """Returns effects fitted without suspects, but for those without which they predict better.

    What holds beside a suspect may ruin a model without it: a servo that is late needs damping.
    """
    settled, fitted = in_turn(problem, effects)
    here = Hypothesis(problem=settled, fit=fitted, nominal=settled.joint_costs(fitted.residual))
    ruins = [(gain.errors, e.key) for gain, e in gains_of_each(here) if (-gain).clear]
    if not ruins:
        return settled, fitted
    return _by_themselves(problem, [e for e in effects if e.key != min(ruins)[1]])


def find_by_itself(
    recordings: Sequence[Trajectory],
    specs: Mapping[CommandKind, mujoco.MjSpec],
    given: Sequence[EffectInstance],
    report: Callable[[str], None],
    time_left: Callable[[], float],
    known: Sequence[EffectInstance] = (),
) -> Found:
    """Returns what the model `specs`, beside which `given` stands, lacks of the robot by itself.

    Where that says that the robot was elsewhere than it reports, and so touched something where it
    seemed to be in the air, recordings are cut anew, and the search goes on from there.

    Args:
        recordings: What effects are looked for in and fitted to.
        specs: The model by the kind of command.
        given: Effects of it that they cannot say.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
        known: Effects with which recordings are cut and the search begins.
    """
    report("measuring the nominal model")
    cutting = partial(all_segments, specs, recordings, given=given, placed=known)
    everything = cutting()
    long = short = prepared(everything, SEARCHED_S)
    if any(LONG[kind] > SHORT[kind] for kind in specs):
        long = prepared(cutting(short.noise, windows_s=LONG), SETTLED_S)
    if lack := _lacking(recordings):
        return Found(recordings=recordings, short=short, long=long, lack=lack)
    # What pushes back at the robot is no torque that the model lacks.
    free = airborne(recordings, everything)
    result = search(short, long, everything, recordings, report, time_left, known, free)
    found = credible(result)
    displaced = short.air and not known and any(one.effect.displaces for one in found)
    if displaced and cutting(short.noise, placed=found).air != everything.air:
        report("cutting anew: the robot was elsewhere than it reports")
        return find_by_itself(recordings, specs, given, report, time_left, found)
    return Found(recordings=recordings, short=short, long=result.problem, results=(result,))


def with_felt(
    found: Found,
    specs: Mapping[CommandKind, mujoco.MjSpec],
    unseen: Collection[str],
    report: Callable[[str], None],
    time_left: Callable[[], float],
) -> Found:
    """Returns what was found, and what the robot feels of an object where it pushes one.

    Of what the object's poses show they say more: contacts, which are rough, decide more of what
    pushes back.

    Args:
        found: Of the robot by itself.
        specs: The model, with what it lacks of the object by the recorded poses.
        unseen: Effects of the object that its poses do not show, by name.
        report: Told what is happening, in words.
        time_left: The share of the time for searching that is left.
    """
    if found.result is None or not unseen:
        return found
    recordings, noise = found.recordings, found.short.noise
    beside = (*found.short.given, *credible(found.result))
    pushing = all_segments(specs, recordings, noise, given=beside, touching=True)
    if not pushing.pushing:
        return found
    report("looking at what the robot feels of the object")
    felt = search_object(prepared(pushing, SEARCHED_S), recordings, unseen, report, time_left)
    return replace(found, results=(found.result, felt))


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
