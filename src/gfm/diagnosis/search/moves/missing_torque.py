"""Add the effects that the missing torque shows.

A rollout that is far off goes where the robot never was, and near the truth it says little of what
two effects do together. Along the measured motion what is missing is nearly the sum of what effects
add to it, whatever their amounts are: they are taken one by one, each beside those before it
(orthogonal matching pursuit; Pati et al. 1993). That only proposes. How many there are is told by
rollouts, and the fit and the score are of rollouts, as always.

Shape letters: N block means of all joints, K probes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import without, without_some
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.moves.add import along_its_valley, beside
from gfm.diagnosis.search.naming import describe, first_of_each
from gfm.diagnosis.search.screening import open_to
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance
from gfm.signals.torque_domain import TorqueDomain

#: Share of what is left of the missing torque of its joints from which on an effect is taken, and
#: up to which others may explain less and rival it; so many of these; effects at most.
SHOWN, NEAR, MOST = 0.1, 4, 6


def missing_torque(
    before: Hypothesis[P], search: Search[P], _best: Step | None = None
) -> Step | None:
    """Returns the step that adds the effects that the missing torque shows; None for none."""
    if search.torques is None or not search.goes_on():
        return None
    search.report(f"looking at the missing torque (misfit {before.fit.cost:.3g})")
    new = borne_out(before, shown_together(search.torques, before, search.candidates))
    if not new:
        return None
    search.report(f"fitting {describe(new[0])}" + f" and {len(new) - 1} more" * (len(new) > 1))
    tried = search.in_its_time(partial(_tried, before, new), None, step=True)
    if tried is None:
        return None
    return Step(
        move=Move.MISSING_TORQUE,
        before=before.fit.cost,
        ranked=(tried,),
        chosen=tried if tried.gain.clear else None,
    )


def borne_out(
    before: Hypothesis, shown: Sequence[Sequence[EffectInstance]]
) -> Sequence[EffectInstance]:
    """Returns the first of some sets that predicts as well as any, in rollouts with its amounts."""
    sets: list[Sequence[EffectInstance]] = [(), *shown]
    return sets[_best_in_rollouts(before, sets)]


def _tried(before: Hypothesis, new: Sequence[EffectInstance]) -> Tried:
    """Returns new effects fitted beside those that are there: the fewest that predict as well."""
    fitted = beside(before, before.fitted((*before.effects, *new)))
    tried = along_its_valley(before, [fitted])[0]
    while fewer := _fewer(before, tried):
        tried = fewer
    return tried


def _fewer(before: Hypothesis, tried: Tried) -> Tried | None:
    """Returns what predicts as well without one or two of the new effects; None where none does.

    Two at once: what each of them does, the other may take back.
    """
    here, count = replace(before, fit=tried.fit), len(before.effects)
    own = range(count, len(here.effects))
    some = [gone for size in (2, 1) if size < len(own) for gone in combinations(own, size)]
    losses = [here.over(one) for one in without_some(before.problem, tried.fit, some)]
    for loss, gone in sorted(zip(losses, some, strict=True), key=lambda pair: pair[0].errors):
        if loss.clear:
            break
        rest = [e for i, e in enumerate(here.effects) if i not in gone]
        fitted = before.fitted(rest)
        if not here.over(fitted).clear:
            return beside(before, fitted)
    return None


class _Shown(NamedTuple):
    """A candidate in the amount that explains most, how much that is, and what share of its own."""

    instance: EffectInstance
    explained: float
    share: float


def shown_together(
    domain: TorqueDomain, before: Hypothesis, candidates: Sequence[Place]
) -> list[list[EffectInstance]]:
    """Returns effects that are not there yet: the first, the first two and so on.

    Each of these sets in the amounts that explain most together. Of several that explain nearly as
    much, the one with which rollouts predict best. What is late is left to rollouts:
    smoothing and sampling move torques against commands by a millisecond or two. What being late
    would explain is taken out; where that is more than a period of measurement, nothing is shown:
    friction and inertia together look late, too.
    """
    late = [place for place in candidates if place.effect.shift is not None]
    places = [
        place
        for place in open_to(before, candidates, before.open_joints)
        if not place.effect.separates_motor and place.effect.shift is None
    ]
    known = [*before.effects, *(group[0] for place in late for group in place.probes)]
    missing = _whitened(domain, domain.missing(before.effects))
    if _late_s(domain, late, missing) > domain.period_s:
        return []
    columns = [np.zeros_like(missing), *(_column(domain, one) for one in known)]
    found, sets = list[EffectInstance](), list[list[EffectInstance]]()
    while len(found) < MOST:
        basis = orthonormal(np.stack(columns, axis=1))
        left, taken = without(missing, basis), {one.key for one in found}
        rest = [place for place in places if place.key not in taken]
        rivals = _rivals([one for place in rest for one in _of_place(domain, place, left, basis)])
        if not rivals:
            break
        bases = [[*columns, _column(domain, one)] for one in rivals]
        told = [
            _with_amounts([*found, one], own, missing)
            for one, own in zip(rivals, bases, strict=True)
        ]
        best = _best_in_rollouts(before, told) if len(told) > 1 else 0
        found.append(rivals[best])
        columns = bases[best]
        sets.append(told[best])
    return sets


def _rivals(shown: Sequence[_Shown]) -> list[EffectInstance]:
    """Returns what explains most, and others that explain nearly as much; nothing where none is."""
    clear = sorted((one for one in shown if one.share >= SHOWN), key=lambda one: -one.explained)
    near = [one for one in clear if one.explained >= (1.0 - SHOWN) * clear[0].explained]
    return first_of_each([one.instance for one in near], lambda one: one.key)[:NEAR]


def _late_s(domain: TorqueDomain, late: Sequence[Place], missing: Array) -> float:
    """Returns the largest of the delays that explain most alone, to first order, s."""
    least: list[float] = [0.0]
    for place in late:
        for (probe,) in place.probes:
            column = _column(domain, probe)
            first = place.effect.parameters[0].name
            share = float(column @ missing) / max(float(column @ column), 1e-12)
            least.append(abs(share * probe.values[first]))
    return max(least)


def _best_in_rollouts(before: Hypothesis, sets: Sequence[Sequence[EffectInstance]]) -> int:
    """Returns the number of the set that predicts best with its amounts.

    Or of one with fewer numbers that does not clearly predict worse.
    """
    residuals = before.problem.residuals([(*before.effects, *new) for new in sets])
    fits = [replace(before.fit, residual=r) for r in residuals]
    there = replace(before, fit=max(fits, key=lambda fitted: -before.over(fitted).nats))
    good = [i for i, fitted in enumerate(fits) if not there.over(fitted).clear]
    return min(good, key=lambda i: (_count(sets[i]), before.over(fits[i]).nats))


def _count(effects: Sequence[EffectInstance]) -> int:
    return sum(len(one.effect.parameters) for one in effects)


def _with_amounts(
    effects: Sequence[EffectInstance], columns: Sequence[Array], missing: Array
) -> list[EffectInstance]:
    """Returns effects, whose columns are the last ones, in the amounts that explain most."""
    factors = np.linalg.lstsq(np.stack(columns, axis=1), missing)[0][-len(effects) :].tolist()
    return [_times(x, one) for x, one in zip(factors, effects, strict=True) if x > 0.0]


def _of_place(domain: TorqueDomain, place: Place, left: Array, basis: Array) -> Iterator[_Shown]:
    """Yields a candidate in the amounts that explain most of what is left, for each of its groups.

    Args:
        domain: Of the nominal model.
        place: Where it acts.
        left: Missing torque, shape (N,).
        basis: What is known already, orthonormal, shape (N, ...).
    """
    for group in place.probes:
        columns = without(np.stack([_column(domain, one) for one in group], axis=1), basis)
        amounts = np.linalg.lstsq(columns, left, rcond=1e-6)[0]
        values = place.effect.combine([one.values for one in group], amounts.tolist())
        if values is not None:
            one = place.instance(values)
            own = left.reshape(-1, len(domain.problem.joints))[:, domain.touched(one)]
            explained = float(left @ columns @ amounts)
            yield _Shown(one, explained, explained / max(float(np.sum(own**2)), 1e-12))


def _column(domain: TorqueDomain, one: EffectInstance) -> Array:
    return _whitened(domain, domain.response(one))


def _whitened(domain: TorqueDomain, torque: Array) -> Array:
    """Returns a torque in units of what sensor noise makes of it, shape (N,)."""
    return np.asarray((torque / domain.noise).ravel())


def _times(factor: float, one: EffectInstance) -> EffectInstance:
    """Returns so many times as much of an effect."""
    first = one.effect.parameters[0].name
    return replace(one, values={**one.values, first: factor * one.values[first]})
