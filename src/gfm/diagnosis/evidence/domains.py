"""Two independent witnesses for every effect: open-loop rollouts, and the missing torque.

Rollouts decide; they integrate a model over seconds. The missing torque needs no integration and no
fit of states: there an effect is a column of numbers, and its amount a linear regression. Errors
that fool one of them (a clock, a wrong initial state, noise of accelerations) hardly fool the other
in the same way, so that a name on which both agree is worth more than either.

Shape letters: B blocks, J joints, E effects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.search.naming import describe, first_of_each, twins
from gfm.diagnosis.search.trace import SearchResult
from gfm.effects import EffectInstance, Key, Placed
from gfm.signals.torque_domain import TorqueDomain, regressed

#: Share of the missing torque from which on a regression on it says anything: below, it is made of
#: noise and of what else is missing.
HEARD = 0.1
#: Amounts by torque, as a multiple of those by rollouts, that are the same: smoothed velocities and
#: accelerations are wrong by some ten percent where a motion is fast or noise is large.
SAME_AMOUNT = (0.7, 1.4)
#: By so much more of the missing torque must another candidate explain to be preferred by it.
CLEARLY_MORE = 0.1
#: Candidates that were not accepted and are looked at, and what they have to explain by rollouts:
#: of a fit that failed only the shape is left.
MOST_SUSPECTS, LEAST_SHARE = 8, 0.01


class Agreement(StrEnum):
    """What the missing torque says of a name that rollouts found."""

    AGREES = "agrees"
    OTHER_AMOUNT = "other amount"
    OTHER_EFFECT = "other effect"
    SILENT = "silent"


@dataclass(frozen=True, kw_only=True)
class TwoDomains(Placed):
    """One candidate before both witnesses.

    Attributes:
        named: Whether it is part of the verdict.
        rollout_share: Of the squared position residual that effects found before it leave, the
            share that it explains on training recordings; None where it was not weighed by itself.
        torque_share: The same of the missing torque on its joints, held out, while they move.
        amount: Of a named effect: by torque, as a multiple of that by rollouts; None where the
            torque says nothing.
        agreement: Of a named effect; None for others.
        rival: The candidate that the torque prefers, where it does, in words.
    """

    named: bool
    rollout_share: float | None
    torque_share: float
    amount: float | None
    agreement: Agreement | None = None
    rival: str | None = None


@dataclass(frozen=True, kw_only=True)
class _Candidate:
    """An effect in the step in which it did best, what was accepted before, and its share."""

    instance: EffectInstance
    step: int
    base: tuple[Key, ...]
    share: float | None


def two_domains(
    domain: TorqueDomain, found: SearchResult, named: Sequence[EffectInstance]
) -> tuple[TwoDomains, ...]:
    """Returns named effects, and the best that were not, before both witnesses."""
    fitted = _fitted(found)
    taken = {e.key for e in (*named, *twins(*named))}
    mine = [_as_found(instance, fitted, named) for instance in named]
    rest = [c for c in fitted if c.instance.key not in taken and (c.share or 0.0) >= LEAST_SHARE]
    others = rest[:MOST_SUSPECTS]
    moving = domain.moving()
    told = {c.instance.key: moving * domain.response(c.instance) for c in (*mine, *others)}
    missing = moving * domain.missing()
    keys = [e.key for e in named]
    rows = [_row(c, domain, missing, told, keys) for c in mine]
    beside = [(c, _row(c, domain, missing, told, ())) for c in others]
    judged = (_judged(c, row, beside) for c, row in zip(mine, rows, strict=True))
    return (*judged, *(row for _, row in beside))


def _fitted(found: SearchResult) -> list[_Candidate]:
    """Returns every candidate in the step in which it explained most, best first."""
    tried = [
        _Candidate(
            instance=one.new[0],
            step=number,
            base=tuple(e.key for e in one.fit.effects if e.key != one.new[0].key),
            share=float(np.clip(1.0 - one.fit.cost / step.before, 0.0, 1.0)),
        )
        for number, step in enumerate(found.steps)
        for one in step.ranked
        if len(one.new) == 1
    ]
    ranked = sorted(tried, key=lambda one: -(one.share or 0.0))
    return first_of_each(ranked, lambda one: one.instance.key)


def _as_found(
    instance: EffectInstance, fitted: Sequence[_Candidate], named: Sequence[EffectInstance]
) -> _Candidate:
    """Returns a named effect with its settled amounts; it may have been found by another name.

    One that was only found together with others is weighed beside all of them.
    """
    for key in (e.key for e in (instance, *twins(instance))):
        for one in fitted:
            if one.instance.key == key:
                return replace(one, instance=instance)
    others = tuple(e.key for e in named if e is not instance)
    return _Candidate(instance=instance, step=-1, base=others, share=None)


def _row(
    candidate: _Candidate,
    domain: TorqueDomain,
    missing: Array,
    told: Mapping[Key, Array],
    named: Sequence[Key],
) -> TwoDomains:
    instance = candidate.instance
    joints, is_named = domain.touched(instance), instance.key in named
    columns = {key: torque[:, joints].ravel() for key, torque in told.items()}
    torque, own = missing[:, joints].ravel(), columns[instance.key]
    base = [columns[k] for k in candidate.base if k in columns]
    share, factor = regressed(torque, own, base)
    _, amount = regressed(torque, own, [columns[k] for k in named if k != instance.key])
    return TwoDomains(
        *instance.key,
        named=is_named,
        rollout_share=candidate.share,
        torque_share=share if factor > 0.0 else 0.0,
        amount=amount if factor > 0.0 and share >= HEARD and is_named else None,
    )


def _judged(
    candidate: _Candidate, row: TwoDomains, others: Sequence[tuple[_Candidate, TwoDomains]]
) -> TwoDomains:
    """Returns a named effect's row with what the missing torque says of it."""
    if row.amount is None:
        return replace(row, agreement=Agreement.SILENT)
    rivals = [
        (other.torque_share, one.instance)
        for one, other in others
        if one.step == candidate.step and set(other.joints) & set(row.joints)
    ]
    share, rival = max(rivals, key=lambda pair: pair[0], default=(0.0, candidate.instance))
    if share > row.torque_share + CLEARLY_MORE:
        return replace(row, agreement=Agreement.OTHER_EFFECT, rival=describe(rival))
    same = SAME_AMOUNT[0] <= row.amount <= SAME_AMOUNT[1]
    return replace(row, agreement=Agreement.AGREES if same else Agreement.OTHER_AMOUNT)
