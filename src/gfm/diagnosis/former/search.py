"""The whole search for what a model lacks: short stretches, long ones, a second look."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial, reduce

import numpy as np

from gfm.core import Trajectory
from gfm.diagnosis.evidence.domains import torque_share
from gfm.diagnosis.evidence.torques import torque_domain
from gfm.diagnosis.former.adequate import ADEQUATE_RATIO, enough, is_enough
from gfm.diagnosis.former.attribution import (
    Attribution,
    Round,
    attribute,
    of_stretches,
    settled_fit,
)
from gfm.diagnosis.former.cross_validation import what_holds
from gfm.diagnosis.former.lookalikes import exchanges
from gfm.diagnosis.former.stretches import look_into_stretches
from gfm.diagnosis.former.too_much import FAR, too_much
from gfm.diagnosis.former.usual import usually_missing
from gfm.diagnosis.former.witnesses import borne_out
from gfm.diagnosis.inference.fitting import (
    ROUGH,
    Fit,
    acting,
    along_valley,
    fit,
    mean_square,
    measured,
)
from gfm.diagnosis.output.claims import FAR_FROM_NOISE
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import joint_scales, places, torque_views
from gfm.diagnosis.search.naming import first_of_each, fitly_named
from gfm.diagnosis.search.nominal_parameters import with_room
from gfm.effects import effect_library

#: What amounts of long stretches leave in short ones, in units of what those of short ones leave,
#: from which they went astray.
ASTRAY = 2.0
#: Rivals of a round that are weighed again beside what stayed in the end.
MOST_RIVALS = 2


def search(
    problem: Problem,
    long: Problem,
    everything: Problem,
    recordings: Sequence[Trajectory],
    report: Callable[[str], None],
) -> tuple[Attribution, Problem]:
    """Returns what recordings support, and that to which its amounts were fitted.

    Found in short stretches, and in those that stay far off; amounts are settled in long ones.

    Args:
        problem: In short stretches.
        long: In long ones.
        everything: All short stretches there are.
        recordings: From which they were cut.
        report: Told what is happening, in words.
    """
    report("looking at torques")
    views = torque_views(problem, recordings)
    scales = joint_scales(problem, views)
    looked_for = [effect for effect in effect_library().values() if effect.twin is None]
    candidates = [
        with_room(problem, place)
        for effect in looked_for
        for place in places(effect, problem.joints, problem.driven, pushing=problem.pushing)
    ]
    always = [place for place in candidates if not place.effect.only_in_stretches]
    at_once = partial(usually_missing, scales=scales, report=report)
    in_stretches = partial(
        look_into_stretches,
        everything=everything,
        candidates=candidates,
        scales=scales,
        report=report,
    )
    share = partial(torque_share, torque_domain(problem.specs, recordings, problem.given))
    found = attribute(problem, always, scales, report, at_once, in_stretches, torque_share=share)
    short, begun_with = found.fit, long
    report("settling amounts")
    long = reduce(Problem.joined, found.stretches, long)
    long_settled, final = settled_fit(long, found.fit.effects)
    little = enough(found.nominal_cost, found.fit.effects)
    short_is_enough = is_enough(problem, found.fit, found.nominal_cost)
    if short_is_enough and final.cost > max(little, ADEQUATE_RATIO**2):
        # What keeps a rollout off slowly, initial states of short stretches make up for.
        report("looking on in long stretches")
        begun = replace(found, fit=final)
        on = attribute(long_settled, always, scales, report, begun=begun, torque_share=share)
        found = replace(on, stretches=found.stretches)
        long_settled, final = settled_fit(long, found.fit.effects)
    found = replace(found, fit=final)
    if not is_enough(long_settled, final):
        better = exchanges(long_settled, final, always, scales, views, report)
        found = _with_what_holds(long_settled, found, better, report)
    final = _borne_out(long_settled, recordings, found.fit, report)
    if short_is_enough:
        final = _not_astray(problem, short, long_settled, final)
    if len(some := acting(final.effects)) < len(final.effects):
        final = measured(long_settled, some)
    if final.cost > FAR:
        report("looking at what the model itself says")
        stretches = of_stretches(found.rounds)
        less = too_much(long_settled, begun_with, problem, recordings, final, stretches)
        if less is not None and less.accepted is not None:
            found = replace(found, rounds=(*found.rounds, less))
            final = less.accepted
    again = _played_again(long_settled, found.rounds, final)
    return replace(found, fit=fitly_named(final, problem.specs), again=again), long


def _played_again(problem: Problem, rounds: Sequence[Round], final: Fit) -> tuple[Round, ...]:
    """Returns anew the rounds whose rivals stood beside something that was taken out since.

    Beside an effect that there is not, all candidates explain little, and the right one hardly more
    than others. Where noise is left, its rivals of then are fitted in its place.
    """
    if not is_enough(problem, final):
        return ()
    stayed = {e.key for e in final.effects}
    again = []
    for this in rounds:
        if this.accepted is None or this.together:
            continue
        *beside, new = this.fits[0].effects
        if new.key not in stayed or {e.key for e in beside} <= stayed:
            continue
        (own,) = (e for e in final.effects if e.key == new.key)
        others = tuple(e for e in final.effects if e is not own)
        ranked = [f.effects[-1] for f in this.fits if f.effects[-1].key not in stayed]
        rivals = first_of_each(ranked, lambda e: e.key)[:MOST_RIVALS]
        fits = [fit(problem, (*others, rival), tolerance=ROUGH) for rival in rivals]
        best = replace(final, effects=(*others, own))
        before = mean_square(problem.residuals([others])[0])
        again.append(replace(this, before=before, fits=(best, *fits), accepted=best))
    return tuple(again)


def _not_astray(problem: Problem, short: Fit, long: Problem, final: Fit) -> Fit:
    """Returns the fit to long stretches, or what was fitted to short ones where the two disagree.

    Errors add up in long ones: a fit may end in another valley, and no longer explains short ones.

    Args:
        problem: In short stretches.
        short: The fit to them.
        long: In long stretches.
        final: The fit to those.
    """
    if [e.key for e in short.effects] != [e.key for e in final.effects]:
        return final
    before, after = np.mean(problem.residuals([short.effects, final.effects]) ** 2, axis=1)
    return final if after < ASTRAY * before else measured(long, short.effects)


def _with_what_holds(
    problem: Problem,
    found: Attribution,
    better: Sequence[Round],
    report: Callable[[str], None],
) -> Attribution:
    """Returns what was found, after exchanges, without what explains nothing elsewhere."""
    rounds = (*found.rounds, *better)
    effects = (better[-1].fits[0] if better else found.fit).effects
    hold = what_holds(problem, effects, of_stretches(rounds), report)
    return replace(
        found,
        fit=along_valley(problem, fit(problem, hold)),
        rounds=rounds,
        unsupported=tuple(e for e in effects if e not in hold),
    )


def _borne_out(
    problem: Problem,
    recordings: Sequence[Trajectory],
    fitted: Fit,
    report: Callable[[str], None],
) -> Fit:
    """Returns the fit with amounts that measured torques bear out, too, where noise is far away."""
    if fitted.cost <= FAR_FROM_NOISE**2:
        return fitted
    report("settling amounts by the measured torques, too")
    return borne_out(problem, recordings, fitted)
