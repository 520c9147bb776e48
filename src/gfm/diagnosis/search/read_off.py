"""Amounts read off the torque that is missing along the measured motion.

Far from the truth a rollout goes where the robot never was: to first order it says little of a law
that changes within a small angle. Along the measured motion, what is missing is nearly the sum of
what effects add to it, however large their amounts are: a linear regression. It is less exact than
a rollout, for it needs accelerations; so it only proposes.

Shape letters: N block means of all joints, K probes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import amounts, bounds_of, with_amounts
from gfm.diagnosis.inference.fitting import times_each, without
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.effects import EffectInstance
from gfm.signals.torque_domain import TorqueDomain

#: Share of the torque of an effect that another explains where the two are nearly the same.
ALIKE = 0.9


class Shown(NamedTuple):
    """A candidate in the amount that explains most, how much that is, and what share of its own."""

    instance: EffectInstance
    explained: float
    share: float


def read_off(domain: TorqueDomain, place: Place, left: Array, basis: Array) -> Iterator[Shown]:
    """Yields a candidate in the amounts that explain most, for each group of its probes.

    Args:
        domain: Recordings as torques.
        place: Where the candidate acts.
        left: Torque that is to be explained, see `whitened`, shape (N,).
        basis: What is known already, orthonormal, shape (N, ...).
    """
    for group in place.probes:
        columns = without(np.stack([column(domain, one) for one in group], axis=1), basis)
        amounts = times_each(columns, left)
        values = place.effect.combine([one.values for one in group], amounts.tolist())
        if values is not None:
            one = place.instance(values)
            own = left.reshape(-1, len(domain.problem.joints))[:, domain.touched(one)]
            explained = float(left @ columns @ amounts)
            yield Shown(one, explained, explained / max(float(np.sum(own**2)), 1e-12))


def looks_like(
    domain: TorqueDomain, place: Place, instance: EffectInstance, others: Sequence[EffectInstance]
) -> bool:
    """Returns whether a candidate adds nearly what an effect does, beside what others add."""
    basis = basis_of(domain, others)
    own = without(column(domain, instance), basis)
    return any(one.share > ALIKE for one in read_off(domain, place, own, basis))


def most_together(
    effects: Sequence[EffectInstance], columns: Sequence[Array], missing: Array
) -> list[EffectInstance]:
    """Returns effects, whose columns are the last ones, in the amounts that explain most."""
    factors = np.linalg.lstsq(np.stack(columns, axis=1), missing)[0][-len(effects) :].tolist()
    return [_times(x, one) for x, one in zip(factors, effects, strict=True) if x > 0.0]


def told_together(
    domain: TorqueDomain, effects: Sequence[EffectInstance]
) -> tuple[EffectInstance, ...]:
    """Returns effects in the amounts that explain most of the missing torque, none below nothing.

    Within their bounds. One of which the missing torque tells nothing is as it was, and so is one
    of which no amount is none.
    """
    columns = np.stack([column(domain, one) for one in effects], axis=1)
    factors = nnls(columns, whitened(domain, domain.missing()))[0].tolist()
    pairs = zip(factors, effects, strict=True)
    told = [_times(x, one) if x > 0.0 and one.effect.how_much else one for x, one in pairs]
    return with_amounts(told, np.clip(amounts(told), *bounds_of(told)))


def _times(factor: float, one: EffectInstance) -> EffectInstance:
    """Returns so many times as much of an effect."""
    names = one.effect.how_much or (one.effect.parameters[0].name,)
    return replace(one, values={**one.values, **{n: factor * one.values[n] for n in names}})


def basis_of(domain: TorqueDomain, effects: Sequence[EffectInstance]) -> Array:
    """Returns what some effects can add to the missing torque, orthonormal, shape (N, ...)."""
    nothing = np.zeros(domain.missing().size)  # where there are none
    return orthonormal(np.stack([nothing, *(column(domain, one) for one in effects)], axis=1))


def column(domain: TorqueDomain, one: EffectInstance) -> Array:
    """Returns what an effect adds to the missing torque, whitened, shape (N,)."""
    return whitened(domain, domain.response(one))


def whitened(domain: TorqueDomain, torque: Array) -> Array:
    """Returns a torque in units of what sensor noise makes of it, shape (N,)."""
    return np.asarray((torque / domain.noise).ravel())
