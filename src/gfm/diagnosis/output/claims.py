"""What is claimed of what was found, and how surely.

Names come from the training recordings alone. Held-out recordings only judge: the verdict says how
much of their error the named effects take away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.special import expit

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import amounts, free_parameters
from gfm.diagnosis.inference.constants import (
    ADEQUATE_RATIO,
    ADEQUATE_SHARE,
    CONFIDENCE,
    LEAST_CONFIDENCE,
)
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.intervals import half_widths
from gfm.diagnosis.output.result import (
    ErrorSummary,
    NamedEffect,
    ParameterEstimate,
    Suspect,
    Verdict,
)
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.diagnosis.search.naming import describe, first_of_each
from gfm.diagnosis.search.trace import Evidence, SearchResult, Step, Tried
from gfm.effects import EffectInstance, Placed

#: Width of an amount's spread where the model stays wrong, in units of how far other recordings of
#: the same kind would put it: a wrong model is wrong in all of them alike. And how often so wide a
#: spread held the truth where something without a name is missing (docs/results/spreads.md).
SPREAD_WIDTH, SPREADS_HELD, SPREADS_ASKED = 2.5, 28, 29
#: More noise floors than this are left by something else than inexact laws.
FAR_FROM_NOISE = 10.0
#: Share of itself by which an effect may differ between parts before that speaks against it, and
#: most that counts of what a bent law explains, so that a confidence stays finite.
APART, MOST_BENT = 0.1, 0.99
#: Share of the squared residual from which on a candidate that lost is told.
LEAST_GAIN = 0.01


def closed_share(error: ErrorSummary) -> float:
    """Returns the share of the held-out gap (squared error above the noise) that was closed."""
    gap = error.before**2 - error.noise_floor**2
    return 0.0 if gap <= 0.0 else (error.before**2 - error.after**2) / gap


def verdict_on(error: ErrorSummary, named: Sequence[NamedEffect]) -> Verdict:
    """Returns the verdict where the data say enough, by the held-out error of everything."""
    if not named:
        adequate = error.before <= ADEQUATE_RATIO * error.noise_floor
        return Verdict.NO_GAP if adequate else Verdict.UNEXPLAINED
    near = error.after <= FAR_FROM_NOISE * error.noise_floor
    inexact = near and closed_share(error) >= 1.0 - ADEQUATE_SHARE
    if error.after <= ADEQUATE_RATIO * error.noise_floor or inexact:
        return Verdict.EXPLAINED
    return Verdict.PARTLY_EXPLAINED if error.after < error.before else Verdict.UNEXPLAINED


def verdict_on_both(robot: Verdict, thing: Verdict) -> Verdict:
    """Returns the verdict on the robot and the object together."""
    if robot in (thing, Verdict.INSUFFICIENT_DATA) or thing is Verdict.NO_GAP:
        return robot
    return thing if robot is Verdict.NO_GAP else Verdict.PARTLY_EXPLAINED


def confidence(evidence: Evidence) -> float:
    """Returns the chance that a name, on its joints, is right, 0..1.

    That nothing else says it as well, times the chance that its law holds: both are logistic
    functions of what speaks for it, calibrated on robots whose truth is known.
    """
    predicts, differs, holds, bent, unlike = CONFIDENCE
    errors, apart, bends, disagrees = features(evidence)
    law = expit(holds + bent * bends + unlike * disagrees)
    return float(expit(predicts * errors + differs * apart) * law)


def features(evidence: Evidence) -> np.ndarray:
    """Returns the figures on which a confidence depends, shape (4,)."""
    return np.array(
        [
            np.log1p(max(evidence.over_rival.errors, 0.0)),
            np.log1p(evidence.apart / APART),
            np.arctanh(np.sqrt(min(evidence.bends, MOST_BENT))),
            evidence.disagrees,
        ]
    )


def credible(found: SearchResult) -> list[EffectInstance]:
    """Returns the effects that are more likely right than not: others are suspects."""
    told = found.evidence
    weighed = [e for e in found.fit.effects if e.key in told]
    return [e for e in weighed if confidence(told[e.key]) >= LEAST_CONFIDENCE]


def named_effects(
    found: SearchResult, instances: Sequence[EffectInstance]
) -> tuple[NamedEffect, ...]:
    """Returns those effects of a search that are named, with what is told of them, best first."""
    if not instances:
        return ()
    fitted, problem = found.fit, found.problem
    widths, holds = widths_of(fitted, problem)
    free = [(fitted.effects[i].key, name) for i, name in free_parameters(fitted.effects)]
    by_place = dict(zip(free, widths.tolist(), strict=True))
    named = [
        NamedEffect(
            *instance.key,
            parameters={
                p.name: _estimate(
                    instance.values[p.name],
                    p.unit,
                    by_place.get((instance.key, p.name), np.inf),
                    holds=holds and not instance.effect.intermittent,
                )
                for p in instance.effect.parameters
            },
            confidence=round(confidence(found.evidence[instance.key]), 3),
            native=instance.effect.native,
            evidence=_figures(found.evidence[instance.key]),
            equals=tuple(Placed(*other.key) for other in found.names_of(instance)[1:]),
        )
        for instance in instances
    ]
    return tuple(sorted(named, key=lambda one: -one.evidence["nats"]))


def widths_of(fitted: Fit, problem: SegmentedProblem) -> tuple[Array, bool]:
    """Returns half the width of each amount's 95 % interval, (P,), and whether one would hold."""
    told = partial(half_widths, amounts(fitted.effects), fitted.jacobian, fitted.residual)
    widths = told(problem.slices(), whole=problem.errs_to_the_end)
    holds = fitted.cost <= ADEQUATE_RATIO**2
    if not holds:  # what stays wrong may be wrong alike all along a recording (Liang, Zeger 1986)
        widths = np.maximum(widths, told(problem.by_recording(), blocks=1))
    return widths, holds


def _figures(evidence: Evidence) -> dict[str, float]:
    """Returns what speaks for a name, as numbers."""
    told = {
        "nats": evidence.without.nats,
        "z_without": evidence.without.errors,
        "apart": evidence.apart,
        "bends": evidence.bends,
        "disagrees": evidence.disagrees,
    }
    if evidence.over_rival is not evidence.without:
        told["z_rival"] = evidence.over_rival.errors
    return told


def _estimate(value: float, unit: str, width: float, *, holds: bool) -> ParameterEstimate:
    """Returns a value with its interval, or with its spread where no interval would hold."""
    told = np.isfinite(width)
    ci95 = (value - width, value + width) if told and holds else None
    spread = SPREAD_WIDTH * width if told and not holds else None
    return ParameterEstimate(value=value, unit=unit, ci95=ci95, spread=spread)


def suspects_of(found: SearchResult, named: Sequence[EffectInstance]) -> tuple[Suspect, ...]:
    """Returns what was weighed and is not named: equals, doubtful names, and what lost."""
    taken = {other.key for instance in named for other in found.names_of(instance)}
    doubtful = [_doubtful(e, found) for e in found.fit.effects if e.key not in taken]
    equal = [
        _suspect(
            other,
            f"equal to {describe(instance)}: the recordings do not tell them apart",
            _explained(instance, found),
        )
        for instance in named
        for other in found.names_of(instance)[1:]
    ]
    every = (*equal, *doubtful, *_rivals(found), *_lost(found))
    keys = {instance.key for instance in named}
    return tuple(one for one in first_of_each(every, lambda one: one.key) if one.key not in keys)


def _suspect(instance: EffectInstance, reason: str, gain: float) -> Suspect:
    return Suspect(
        *instance.key,
        reason=reason,
        decided_by=instance.effect.shown_by,
        gain=float(np.clip(gain, 0.0, 1.0)),
    )


def _doubtful(instance: EffectInstance, found: SearchResult) -> Suspect:
    evidence = found.evidence[instance.key]
    sure = confidence(evidence)
    reason = f"more likely wrong than right (confidence {sure:.2f}): {_speaks_for(evidence)}"
    if sure >= LEAST_CONFIDENCE:
        reason = "without the suspects beside it, the model predicts worse with it than without it"
    told, there = _suspect(instance, reason, _explained(instance, found)), evidence.nameless
    law = f"{there.state} of {there.joint}" if there else ""
    told = replace(told, amounts=instance.values, nameless=law)
    return replace(told, confidence=round(sure, 3), evidence=_figures(evidence))


def _speaks_for(evidence: Evidence) -> str:
    """Returns the figures that a confidence is made of, in words."""
    other = "without it" if evidence.rival is None else "with its best rival"
    if evidence.nameless is not None:
        over, state, joint = evidence.nameless
        law = f"a law of the {state} of {joint} without a name"
        return f"{law} predicts better by {-over.nats:.0f} ± {over.error:.0f} nats"
    return (
        f"predicts better than {other} by {evidence.over_rival.errors:.1f} standard errors; its "
        f"amount may differ by {evidence.apart:.0%} between parts of the data; "
        f"{evidence.bends:.0%} of what is left is as if its amount changed with the state of the "
        f"joint; by the missing torque its amount is another by {evidence.disagrees:.2f}"
    )


def _rivals(found: SearchResult) -> Iterator[Suspect]:
    """Yields what predicts as well in the place of an effect that was found, or nearly."""
    for instance in found.fit.effects:
        evidence = found.evidence.get(instance.key)
        if evidence is None or evidence.rival is None or evidence.by is None:
            continue
        errors = evidence.rival.errors
        if not evidence.rival.clear:
            how = "equal to" if errors < 1.0 else "close to"
            reason = f"{how} {describe(instance)}: {max(errors, 0.0):.1f} standard errors apart"
            yield _suspect(evidence.by, reason, _explained(instance, found))


def _lost(found: SearchResult) -> list[Suspect]:
    """Returns the candidates that were fitted and lost, best first."""
    lost = [
        _suspect(tried.new[0], _reason(tried, step), 1.0 - tried.fit.cost / step.before)
        for step in found.steps
        for tried in step.ranked
        if len(tried.new) == 1 and tried is not step.chosen
    ]
    told = [one for one in lost if one.gain >= LEAST_GAIN]
    return sorted(first_of_each(told, lambda one: one.key), key=lambda one: -one.gain)


def _reason(tried: Tried, step: Step) -> str:
    gain = f"predicts better by {tried.gain.nats:.0f} ± {tried.gain.error:.0f} nats"
    if step.chosen is None:
        return f"{gain}: not clearly"
    what = describe(step.chosen.new[0])
    best = what if len(step.chosen.new) == 1 else f"{what} and its like"
    return f"{gain}; {best} by {step.chosen.gain.nats:.0f}"


def _explained(instance: EffectInstance, found: SearchResult) -> float:
    """Returns the share of the squared residual that an effect explained when it was found."""
    keys = {other.key for other in found.names_of(instance)}
    shares = [
        1.0 - step.chosen.fit.cost / step.before
        for step in found.steps
        if step.chosen is not None and keys & {e.key for e in step.chosen.new}
    ]
    return max(shares, default=0.0)
