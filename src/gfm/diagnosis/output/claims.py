"""What may be claimed of what was found, and how surely.

Nothing is claimed on the recordings that effects were fitted to: errors are of held-out ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence

import mujoco
import numpy as np

from gfm.diagnosis.former.adequate import ADEQUATE_RATIO, RULED_OUT, ruled_out
from gfm.diagnosis.former.attribution import Attribution, Round, price
from gfm.diagnosis.inference.fitting import Fit, free_parameters
from gfm.diagnosis.inference.intervals import half_widths
from gfm.diagnosis.output.result import (
    ErrorSummary,
    NamedEffect,
    ParameterEstimate,
    Suspect,
    Verdict,
)
from gfm.diagnosis.search.naming import describe, twins
from gfm.diagnosis.search.nominal_parameters import slight
from gfm.effects import Effect, EffectInstance, Scope, effect_library

#: Held-out RMSE, in units of the sensor noise, up to which a corrected model is adequate, and what
#: is claimed of one effect, where it acts; and the share of the gap that abrupt laws, which are not
#: quite exact, and others, which nearly are, may leave: what leaves more stands, perhaps, for what
#: no known effect describes.
CREDIBLE_RATIO, INEXACT_SHARE, EXACT_SHARE = 1.5, 3e-3, 1e-4
#: More noise floors than this are left by something else than inexact laws.
FAR_FROM_NOISE = 10.0
#: Where one joint has more laws of its own than this, they must leave noise: a few of them together
#: come close to whatever has no name.
MOST_ON_A_JOINT = 2
#: Width of an amount's spread where the model stays wrong, in units of how far other recordings of
#: the same kind would put it: a wrong model is wrong in all of them alike. And how often so wide a
#: spread held the truth on simulated robots that lack something without a name
#: (docs/results/spreads.md).
WRONG_ALIKE, SPREADS_HELD, SPREADS_ASKED = 2.5, 28, 29
#: Confidence beyond which a name is claimed.
CLAIMED = 0.5
#: Two candidates are equal when the runner-up leaves so little more of what the best explains.
EQUAL, CLEAR = 0.01, 0.10
#: How sure one may be, by the ratio of the runner-up's cost to that of a best that leaves noise.
WORSE = ((1.0, 1.02, 1.1, RULED_OUT), (0.5, 0.6, 0.9, 0.99))


def closed_share(error: ErrorSummary) -> float:
    """Returns the share of the held-out gap (squared error above the noise) that was closed."""
    gap = error.before**2 - error.noise_floor**2
    return 0.0 if gap <= 0.0 else (error.before**2 - error.after**2) / gap


def verdict_on(error: ErrorSummary, named: Sequence[NamedEffect]) -> Verdict:
    """Returns the verdict where the data say enough, by the held-out error of everything.

    What is described to within the noise by names none of which is claimed is not explained.
    """
    if not named:
        adequate = error.before <= ADEQUATE_RATIO * error.noise_floor
        return Verdict.NO_GAP if adequate else Verdict.UNEXPLAINED
    laws = [(effect_library()[one.effect], one.joints) for one in named]
    may_leave = 0.0 if _crowded(laws) else _inexact(laws)
    claimed = any(one.confidence > CLAIMED for one in named)
    if claimed and credible([error], may_leave=may_leave):
        return Verdict.EXPLAINED
    return Verdict.PARTLY_EXPLAINED


def verdict_on_both(robot: Verdict, thing: Verdict) -> Verdict:
    """Returns the verdict on the robot and the object together."""
    if robot in (thing, Verdict.INSUFFICIENT_DATA) or thing is Verdict.NO_GAP:
        return robot
    return thing if robot is Verdict.NO_GAP else Verdict.PARTLY_EXPLAINED


def named_effects(
    blocks: Sequence[slice],
    found: Attribution,
    instances: Sequence[EffectInstance],
    error: ErrorSummary,
    by_joint: Mapping[str, ErrorSummary] | None = None,
    specs: Collection[mujoco.MjSpec] = (),
) -> tuple[NamedEffect, ...]:
    """Returns the accepted effects with intervals, in the order in which they were found.

    Args:
        blocks: Rows of the fit's residual that belong together.
        found: What was accepted, and when.
        instances: The same with their amounts.
        error: Held-out, of everything together.
        by_joint: The same of every joint.
        specs: The nominal models.
    """
    if not instances:
        return ()
    fitted = found.fit
    free = free_parameters(instances)
    values = np.array([instances[i].values[name] for i, name in free])
    widths = half_widths(values, fitted.jacobian, fitted.residual, blocks)
    by_place = dict(zip(free, widths, strict=True))
    laws = [(instance.effect, instance.joints) for instance in instances]
    inexact, crowded = _inexact(laws), _crowded(laws)
    named = []
    for i, instance in enumerate(instances):
        parameters = {}
        here = [error, *_where_it_acts(instance, by_joint or {})]
        adequate = credible(here)
        may_leave = 0.0 if crowded & {*instance.joints} else inexact
        sure = credible(here, may_leave=may_leave) and _seen(here[1:] or here)
        for p in instance.effect.parameters:
            value, width = instance.values[p.name], float(by_place.get((i, p.name), np.inf))
            holds = adequate and not instance.effect.only_in_stretches
            parameters[p.name] = _estimate(value, p.unit, width, holds=holds)
        named.append(
            NamedEffect(
                effect=instance.effect.name,
                joints=instance.joints,
                parameters=parameters,
                confidence=_confidence(
                    _found_in(instance, (*found.again, *found.rounds)),
                    error,
                    adequate=sure and not slight(specs, instance),
                ),
                native=instance.effect.native,
            )
        )
    return tuple(named)


def _estimate(value: float, unit: str, width: float, *, holds: bool) -> ParameterEstimate:
    """Returns a value with its interval, or with its spread where no interval would hold."""
    if not np.isfinite(width):
        return ParameterEstimate(value=value, unit=unit, ci95=None)
    if not holds:
        return ParameterEstimate(value=value, unit=unit, ci95=None, spread=WRONG_ALIKE * width)
    return ParameterEstimate(value=value, unit=unit, ci95=(value - width, value + width))


def _where_it_acts(
    instance: EffectInstance, by_joint: Mapping[str, ErrorSummary]
) -> list[ErrorSummary]:
    """Returns the errors of the joints on which an effect acts: all, unless it is of some."""
    local = instance.effect.scope in (Scope.JOINT, Scope.PAIR)
    return [one for joint, one in by_joint.items() if not local or joint in instance.joints]


def credible(errors: Sequence[ErrorSummary], *, may_leave: float = 0.0) -> bool:
    """Returns whether noise is left, by all of `errors`, or little of the gap.

    Args:
        errors: Held-out.
        may_leave: Share of the gap that what was named may leave, not far from noise.
    """
    return all(
        one.after <= CREDIBLE_RATIO * one.noise_floor
        or (closed_share(one) >= 1.0 - may_leave and one.after <= FAR_FROM_NOISE * one.noise_floor)
        for one in errors
    )


def _inexact(laws: Sequence[tuple[Effect, tuple[str, ...]]]) -> float:
    """Returns the share of a gap that laws may leave by not being quite exact."""
    return INEXACT_SHARE if any(law.abrupt for law, _ in laws) else EXACT_SHARE


def _crowded(laws: Sequence[tuple[Effect, tuple[str, ...]]]) -> set[str]:
    """Returns the joints that have more laws of their own than describe one thing or two.

    An excess and the level that comes with it are one.
    """
    own = Counter(
        joints for law, joints in laws if law.scope is Scope.JOINT and law.excess_of is None
    )
    return {joint for (joint,), count in own.items() if count > MOST_ON_A_JOINT}


def _seen(errors: Sequence[ErrorSummary]) -> bool:
    """Returns whether more than the noise was taken off some error: less, time steps differ by."""
    return any(one.before**2 - one.after**2 > one.noise_floor**2 for one in errors)


def clearness(fits: Sequence[Fit], before: float, *, adequate: bool) -> float:
    """Returns how clearly the first of `fits` is better than its runner-up, 0.5..0.99.

    By the share of what was missing that only the best explains. Where what is left in the end is
    noise, a runner-up that leaves more than the best is worse, however small that share is. What
    explains as much with more parameters (a spring far from its rest, instead of a constant torque)
    is no rival.

    Args:
        fits: The best first.
        before: Cost without any of them.
        adequate: Whether what is left in the end is noise.
    """
    best = fits[0]
    costs = [
        f.cost
        for f in fits
        if f.effects[-1].key != best.effects[-1].key and price(f) <= price(best)
    ]
    if not costs:
        return 0.99
    share = (min(costs) - best.cost) / max(before - best.cost, 1e-9)
    clear = float(np.interp(share, [0.0, EQUAL, CLEAR, 1.0], [0.5, 0.6, 0.95, 0.99]))
    worse = float(np.interp(min(costs) / best.cost, *WORSE))
    return max(clear, worse) if adequate else clear


def _found_in(instance: EffectInstance, rounds: Sequence[Round]) -> Round:
    """Returns the round in which an effect was accepted, there or first on another joint.

    A level came with its excess.
    """
    names = {instance.effect.name, *(twin.effect.name for twin, _ in twins([instance]))}
    names |= {e.name for e in effect_library().values() if e.excess_of == instance.effect.name}
    won = [r for r in rounds if r.accepted is not None]
    alike = [(r, e) for r in won for e in r.new if e.effect.name in names]
    here = [r for r, e in alike if e.joints == instance.joints]
    return (here or [r for r, _ in alike])[0]


def _confidence(this: Round, error: ErrorSummary, *, adequate: bool) -> float:
    """Returns 0..1: high where the runner-up explains clearly less and only noise is left.

    Half where the runner-up explains as much. Half at most where more than noise is left, less than
    noise was taken off, or what the model says of a joint was changed slightly: what is named may
    then stand for what no known effect describes.
    """
    clear = clearness(this.fits, this.before, adequate=adequate)
    closed = np.clip(closed_share(error), 0.0, 1.0)
    return round(float(clear * (1.0 if adequate else 0.5 * closed)), 3)


def suspects_of(found: Attribution, instances: Sequence[EffectInstance]) -> tuple[Suspect, ...]:
    """Returns the candidates that were fitted and lost, by the round in which they did best."""
    taken = {instance.key for instance in instances} | {t.key for t, _ in twins(instances)}
    best: dict[tuple[str, tuple[str, ...]], Suspect] = {}
    for this in found.rounds:
        for fitted in this.fits:
            instance = fitted.effects[-1]
            gain = 1.0 - fitted.cost / this.before
            if instance.key in taken or gain < 0.01 or instance.key in best:
                continue
            best[instance.key] = Suspect(
                effect=instance.effect.name,
                joints=instance.joints,
                reason=found.why_taken_out(instance) or _reason(fitted, this),
                decided_by=instance.effect.shown_by,
                gain=float(np.clip(gain, 0.0, 1.0)),
            )
    equal = [
        Suspect(
            effect=twin.effect.name,
            joints=twin.joints,
            reason=f"equal to {describe(instance)}: the same torque under another name",
            decided_by=twin.effect.shown_by,
            gain=_gain_of(twin, instance, found),
        )
        for twin, instance in twins(instances)
    ]
    return (*equal, *sorted(best.values(), key=lambda s: -s.gain))


def _gain_of(twin: EffectInstance, instance: EffectInstance, found: Attribution) -> float:
    """Returns the share of the squared residual that an effect explained when it was accepted."""
    keys = (twin.key, instance.key)
    gains = [
        1.0 - this.fits[0].cost / this.before
        for this in found.rounds
        if this.fits and this.fits[0].effects[-1].key in keys
    ]
    return float(np.clip(max(gains, default=0.0), 0.0, 1.0))


def _reason(fitted: Fit, this: Round) -> str:
    winner, share = this.fits[0], 100.0 * (1.0 - fitted.cost / this.before)
    if winner is fitted or this.accepted is None:
        return f"explains only {share:.1f} % of the squared residual"
    gap = (fitted.cost - winner.cost) / max(this.before - winner.cost, 1e-9)
    rival = "several effects together" if this.together else describe(winner.effects[-1])
    explains = "explain" if this.together else "explains"
    best = 100.0 * (1.0 - winner.cost / this.before)
    if gap < -EQUAL:
        return (
            f"explains {share:.1f} % of the squared residual, {rival} only {best:.1f} %: that "
            "holds on other recordings, or explains more of the missing torque"
        )
    if gap < EQUAL and not ruled_out(fitted, winner):
        return f"equal to {rival}: both explain {share:.1f} % of the squared residual"
    return f"explains {share:.1f} % of the squared residual; {rival} {explains} {best:.1f} %"
