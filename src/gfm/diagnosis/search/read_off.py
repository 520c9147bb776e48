"""Amounts read off the torque that is missing along the measured motion.

Far from the truth a rollout goes where the robot never was: to first order it says little of a law
that changes within a small angle. Along the measured motion, what is missing is nearly the sum of
what effects add to it, however large their amounts are: a linear regression. It is less exact than
a rollout, for it needs accelerations; so it only proposes.

Shape letters: N block means of all joints, K probes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.effects import EffectInstance, Key
from gfm.signals.torque_domain import TorqueDomain

#: Share of the torque of an effect that another explains where the two are nearly the same.
ALIKE = 0.9
#: Factor by which two amounts differ at most that are compared: what is farther says no more.
FARTHEST = 10.0


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
        amounts = np.linalg.lstsq(columns, left, rcond=1e-6)[0]
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


def disagreement(domain: TorqueDomain, effects: Sequence[EffectInstance]) -> dict[Key, float]:
    """Returns by how much amounts of effects are not those that the missing torque tells.

    The logarithm of the factor between the two, times the share of the torque that the effect
    explains beside the others, while its joints move: what explains little says little.
    """
    moving = domain.moving()
    missing = moving * domain.missing()
    told = {one.key: moving * domain.response(one) for one in effects}
    return {one.key: _disagreement(one.key, missing, told, domain.touched(one)) for one in effects}


def _disagreement(
    key: Key, missing: Array, told: Mapping[Key, Array], joints: Sequence[int]
) -> float:
    columns = {k: torque[:, joints].ravel() for k, torque in told.items()}
    own = columns.pop(key)
    share, factor = regressed(missing[:, joints].ravel(), own, list(columns.values()))
    return share * float(abs(np.log(np.clip(factor, 1.0 / FARTHEST, FARTHEST))))


def regressed(torque: Array, own: Array, others: Sequence[Array]) -> tuple[float, float]:
    """Returns which share of a torque a column explains beside others, and with which factor.

    Args:
        torque: shape (N,).
        own: The column, shape (N,).
        others: What both are freed of first, shape (N,) each.
    """
    if others:
        basis = orthonormal(np.stack(others, axis=1))
        torque, own = (without(x, basis) for x in (torque, own))
    power, size = float(torque @ torque), float(own @ own)
    if power <= 0.0 or size <= 0.0:
        return 0.0, 0.0
    along = float(own @ torque)
    return along**2 / (size * power), along / size


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
