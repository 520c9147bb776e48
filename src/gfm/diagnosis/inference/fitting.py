"""Amounts of effects that leave the least residual: damped Gauss-Newton over rollouts.

Shape letters: N numbers of a residual, P parameters.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear, minimize

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import (
    amounts,
    bounds_of,
    free_parameters,
    rough_below,
    with_amounts,
)
from gfm.diagnosis.residuals.outliers import bounded, slopes, unbounded
from gfm.effects import EffectInstance, Key

#: Gauss-Newton steps of a fit that lead nearer, and the relative gain below which it ends.
FIT_STEPS, FIT_TOLERANCE = 8, 1e-3
#: The same where candidates are compared only.
ROUGH = 1e-2
#: Logarithm by which a simplex changes amounts at first, and rollouts that it takes at most.
NEARBY, SIMPLEX_STEPS = 0.02, 60
#: Damping of the first step, and that beyond which no step helps.
DAMPING, MOST_DAMPING = 1e-3, 1e3
#: Share of the gain that first order promises, from which on it holds as far as the step went
#: (Madsen, Nielsen and Tingleff 2004).
KEPT = 0.25
#: Size of a response, beside the largest of those weighed together, below which nothing is told.
TINY = 0.05

#: A free parameter: the effect whose it is, and its name.
Parameter: TypeAlias = tuple[Key, str]


class AtHand(NamedTuple):
    """An amount, and the derivative by it that was taken there, shape (N,)."""

    value: float
    column: Array


class LeastSquares(ABC):
    """What amounts are fitted to."""

    @abstractmethod
    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns the residual of every candidate, in units of the noise, (candidates, N)."""

    def coarse(self) -> Self:
        """Returns the same, faster and with nothing outlying: good enough for differences."""
        return self

    def limits(self) -> Array | float:
        """Returns beyond what numbers count less in a fit, shape (N,); infinite for none."""
        return np.inf

    def differences(self, effects: Sequence[EffectInstance]) -> Array:
        """Returns the changes of free amounts over which derivatives are taken, shape (P,).

        Small ones: where residuals are smooth.
        """
        low, high = bounds_of(effects)
        least = 1e-2 * np.minimum(high - low, 1.0)
        return rough_below(effects) * np.maximum(np.abs(amounts(effects)), least)


@dataclass(frozen=True, kw_only=True)
class Fit:
    """Effects fitted together.

    Attributes:
        effects: With the fitted values.
        jacobian: Derivative of the residual by each free parameter, shape (N, P).
        residual: In units of the noise, shape (N,).
    """

    effects: tuple[EffectInstance, ...]
    jacobian: Array
    residual: Array

    @cached_property
    def cost(self) -> float:
        """Mean squared residual."""
        return mean_square(self.residual)

    @property
    def owners(self) -> NDArray[np.intp]:
        """The number of the effect whose amount each free parameter is, shape (P,)."""
        return np.array([i for i, _ in free_parameters(self.effects)], dtype=np.intp)


def measured(problem: LeastSquares, effects: Sequence[EffectInstance]) -> Fit:
    """Returns `effects` with the values that they have as a fit."""
    effects, residual = tuple(effects), problem.residuals([effects])[0]
    jacobian = np.zeros((len(residual), 0))
    if effects:
        jacobian = derivatives(problem, effects, residual)
    return Fit(effects=effects, jacobian=jacobian, residual=residual)


def fit(
    problem: LeastSquares,
    effects: Sequence[EffectInstance],
    *,
    tolerance: float = FIT_TOLERANCE,
    known: Fit | None = None,
) -> Fit:
    """Returns `effects` with the values that leave the least residual (damped Gauss-Newton).

    Args:
        problem: What they should explain.
        effects: With the values to begin with.
        tolerance: Relative gain of a step at which the fit ends.
        known: A fit of some of them to the same problem. Derivatives by its amounts are taken over
            from there, as long as steps with them gain anything and they still hold in the end.
    """
    if not effects:
        return measured(problem, ())
    at_hand = {} if known is None else _at_hand(problem, known)
    end = _descended(problem, tuple(effects), tolerance, at_hand)
    usual = tuple(replace(e, values=e.effect.canonical(e.values)) for e in end.effects)
    return replace(end, effects=usual)


def _descended(
    problem: LeastSquares,
    current: tuple[EffectInstance, ...],
    tolerance: float,
    at_hand: Mapping[Parameter, AtHand],
) -> Fit:
    """Returns where steps from the current amounts lead, with derivatives there."""
    values, bounds = amounts(current), bounds_of(current)
    residual = problem.residuals([current])[0]
    jacobian = derivatives(problem, current, residual, at_hand)
    damping, astray, steps, promised = DAMPING, False, FIT_STEPS, 0.0
    while steps > 0 and residual.any():
        step = _step(jacobian, residual, damping, bounds[0] - values, bounds[1] - values)
        candidate = with_amounts(current, values + step)
        tried = problem.residuals([candidate])[0]
        gain = 1.0 - mean_square(tried) / mean_square(residual)
        told = 1.0 - mean_square(residual + jacobian @ step) / mean_square(residual)
        kept = gain > KEPT * told
        if at_hand and not kept:
            at_hand = {}
            jacobian = derivatives(problem, current, residual)
            continue
        promised = max(promised, told)
        damping *= 0.1 if kept else 30.0
        if gain > 0.0:
            steps -= kept
            current, values, residual = candidate, values + step, tried
            jacobian = derivatives(problem, current, residual, at_hand)
            astray, promised = False, 0.0
        elif damping > MOST_DAMPING and promised > ROUGH and not astray:
            damping, astray, steps = DAMPING, True, FIT_STEPS
            jacobian = derivatives(problem, current, residual, over=step)
        if (0.0 <= gain < tolerance and (kept or told < tolerance)) or damping > MOST_DAMPING:
            break
    if astray:
        jacobian = derivatives(problem, current, residual)
    end = Fit(effects=current, jacobian=jacobian, residual=residual)
    if _outdated(problem, end, at_hand):
        return _descended(problem, current, tolerance, {})
    return end


def _outdated(problem: LeastSquares, end: Fit, at_hand: Mapping[Parameter, AtHand]) -> bool:
    """Returns whether derivatives at hand no longer tell what their amounts change.

    They are asked for the change from where they were taken: a centre of mass counts as much as
    there is mass. A fit to which they led may not be at its end, and what it predicts is wrong.
    """
    values, names = amounts(end.effects), _names(end.effects)
    begun = [at_hand[n].value if n in at_hand else v for n, v in zip(names, values, strict=True)]
    moved = values - np.array(begun)
    if not moved.any():
        return False
    sets = [end.effects, with_amounts(end.effects, np.array(begun))]
    here, there = problem.coarse().residuals(sets)
    change = slopes(end.residual, problem.limits()) * (here - there)
    most = max(mean_square(change), end.cost)
    return mean_square(change - end.jacobian @ moved) > ROUGH * most


def by_simplex(problem: LeastSquares, fitted: Fit) -> Fit:
    """Returns a fit as near as a simplex leads (Nelder and Mead 1965), for effects that are rugged.

    Where such an effect holds joints, derivatives tell nothing: a fit ends a hundredth beside the
    truth. Moved are its amounts and those of the level above which it comes.
    """
    effects, values = fitted.effects, amounts(fitted.effects)
    keys = {k for e in effects if e.effect.rugged for k in (e.key, (e.effect.excess_of, e.joints))}
    if not keys:
        return fitted
    moved = np.flatnonzero([effects[i].key in keys for i in fitted.owners])

    def at(logs: Array) -> tuple[EffectInstance, ...]:
        factors = np.ones_like(values)
        factors[moved] = np.exp(logs)
        return with_amounts(effects, np.clip(factors * values, *bounds_of(effects)))

    corners = NEARBY * np.vstack([np.zeros(len(moved)), np.eye(len(moved))])
    found = minimize(
        lambda logs: mean_square(problem.residuals([at(logs)])[0]) / fitted.cost,
        corners[0],
        method="Nelder-Mead",
        tol=FIT_TOLERANCE,
        options={"initial_simplex": corners, "maxfev": SIMPLEX_STEPS},
    )
    return measured(problem, at(found.x))


def without_some(problem: LeastSquares, fitted: Fit, gone: Sequence[Collection[int]]) -> list[Fit]:
    """Returns fits without some effects each, by number; others make up for them to first order.

    What that changes is simulated fast where that errs by little of what is left.
    """
    if not gone:
        return []
    coarse, limits = problem.coarse(), problem.limits()
    errs = unbounded(fitted.residual, limits) - coarse.residuals([fitted.effects])[0]

    def residuals(sets: Sequence[Sequence[EffectInstance]]) -> Array:
        if mean_square(errs) > ROUGH * fitted.cost:
            return problem.residuals(sets)
        return bounded(errs + coarse.residuals(sets), limits)

    rests = [[e for i, e in enumerate(fitted.effects) if i not in some] for some in gone]
    left = [~np.isin(fitted.owners, list(some)) for some in gone]
    moved = []
    for rest, own, residual in zip(rests, left, residuals(rests), strict=True):
        values, (low, high) = amounts(rest), bounds_of(rest)
        if rest:
            jacobian = fitted.jacobian[:, own]
            values = values + _step(jacobian, residual, DAMPING, low - values, high - values)
        moved.append(with_amounts(rest, values))
    rows = zip(moved, left, residuals(moved), strict=True)
    return [Fit(effects=e, jacobian=fitted.jacobian[:, own], residual=r) for e, own, r in rows]


def always(fitted: Fit) -> NDArray[np.bool_]:
    """Returns which derivatives are by amounts of what acts all the time, shape (P,)."""
    rare = np.array([e.effect.intermittent for e in fitted.effects])
    return ~rare[fitted.owners] if rare.any() else np.ones(fitted.jacobian.shape[1], dtype=bool)


def derivatives(
    problem: LeastSquares,
    effects: tuple[EffectInstance, ...],
    residual: Array,
    at_hand: Mapping[Parameter, AtHand] = MappingProxyType({}),
    over: Array | None = None,
) -> Array:
    """Returns the derivative of the residual by each free parameter, shape (N, P).

    By forward differences of a faster simulation. That errs by more than a limit may be: how much
    less a number counts beyond it is taken from the accurate residual, shape (N,). Those at hand,
    of numbers that count in full, are not taken anew. By default, differences are small; a step
    that they led astray, shape (P,), is one to take them over.
    """
    weights = slopes(residual, problem.limits())
    names = _names(effects)
    values, sizes, high = amounts(effects), problem.differences(effects), bounds_of(effects)[1]
    steps = np.where(values + sizes > high, -sizes, sizes)
    if over is not None:
        steps = np.where(np.abs(over) > sizes, over, steps)
    new = [i for i, name in enumerate(names) if name not in at_hand]
    moved = [with_amounts(effects, values + step) for step in np.diag(steps)[new]]
    columns = {name: one.column for name, one in at_hand.items()}
    if moved:
        still, *rows = problem.coarse().residuals([effects, *moved])
        columns.update(
            (names[i], (row - still) / steps[i]) for i, row in zip(new, rows, strict=True)
        )
    return np.asarray(np.stack([columns[name] * weights for name in names], axis=1))


def _names(effects: Sequence[EffectInstance]) -> list[Parameter]:
    return [(effects[i].key, name) for i, name in free_parameters(effects)]


def _at_hand(problem: LeastSquares, known: Fit) -> dict[Parameter, AtHand]:
    """Returns derivatives of a fit, by numbers that count in full."""
    columns = (known.jacobian / slopes(known.residual, problem.limits())[:, None]).T
    rows = zip(amounts(known.effects).tolist(), columns, strict=True)
    return dict(zip(_names(known.effects), map(AtHand._make, rows), strict=True))


def _step(jacobian: Array, residual: Array, damping: float, low: Array, high: Array) -> Array:
    """Returns the damped Gauss-Newton step within bounds (Levenberg, Marquardt: by the diagonal).

    The bounds are part of the linear problem: a parameter that would leave them stays there while
    the others go where they fit best with it.
    """
    size = np.linalg.norm(jacobian, axis=0) + 1e-9
    basis, square = np.linalg.qr(jacobian / size)
    rows = np.concatenate([square, np.sqrt(damping) * np.eye(len(size))])
    target = np.concatenate([-basis.T @ residual, np.zeros(len(size))])
    inside = (np.minimum(low, -1e-12) * size, np.maximum(high, 1e-12) * size)
    return np.asarray(np.clip(lsq_linear(rows, target, inside).x / size, low, high))


def times_each(columns: Array, values: Array) -> Array:
    """Returns how many times each column (N, K) explains most of values (N,), shape (K,).

    One that is tiny beside the others is none: a robot that moves in a plane knows nothing of
    gravity across it.
    """
    size, times = np.linalg.norm(columns, axis=0), np.zeros(columns.shape[1])
    told = size >= TINY * size.max()
    times[told] = np.linalg.lstsq(columns[:, told], values, rcond=1e-6)[0]
    return times


def without(values: Array, basis: Array) -> Array:
    """Returns values, shape (N, ...), without what an orthonormal basis (N, P) explains of them."""
    return np.asarray(values - basis @ (basis.T @ values))


def mean_square(residual: Array) -> float:
    """Returns the mean of the squares of a residual, shape (N,)."""
    return float(np.mean(residual**2))
