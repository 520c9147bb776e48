"""All parameters at once by CMA-ES, as PACE does (Bjelonic et al. 2025, arXiv 2509.06342).

Armature, viscous and Coulomb friction and bias of every joint, and one delay, within bounds, by
the squared error of positions over rollouts. It names what matters most: that whose return to
nominal costs most.

Shape letters: P parameters, J joints.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from cmaes import CMA

from gfm.core.checks import Array
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance, find_effect
from peers.case import Case, Named, rises

#: Processor time that a search may take, generations, and recorded time in its rollouts, s.
_LIMIT_S, _GENERATIONS, _SIMULATED_S = 90.0, 150, 8.0
#: Largest bias, rad, and delay, s.
_BIAS, _DELAY = 0.1, 0.04


@dataclass(frozen=True, kw_only=True)
class Space:
    """What is searched: parameters from 0 (nominal) to their bounds; biases to both sides.

    Attributes:
        joints: Names.
        upper: Largest armature, viscous and Coulomb friction by joint, shape (3, J).
    """

    joints: tuple[str, ...]
    upper: Array

    @property
    def size(self) -> int:
        """P."""
        return 4 * len(self.joints) + 1

    def effects(self, x: Array) -> list[EffectInstance]:
        """Returns the model's changes for a point in [0, 1]^P; biases are no part of it.

        What is nought is left out: a delay of nought would still add a state.
        """
        return [
            EffectInstance(effect=find_effect(n.effect), joints=n.joints, values=n.parameters)
            for n in self.named(x)
            if n.effect != "encoder_offset" and any(n.parameters.values())
        ]

    def bias(self, x: Array) -> Array:
        """Returns the biases, rad, shape (J,)."""
        count = len(self.joints)
        return np.asarray((2.0 * x[3 * count : 4 * count] - 1.0) * _BIAS)

    def named(self, x: Array) -> list[Named]:
        """Returns what every parameter says, in order."""
        count = len(self.joints)
        amounts = self.upper.ravel() * x[: 3 * count]
        laws = (
            ("armature", "inertia"),
            ("viscous_friction", "coefficient"),
            ("coulomb_friction", "torque"),
        )
        made = [
            Named(effect=e, joints=(j,), parameters={p: float(a)}, weight=0.0)
            for (e, p, j), a in zip(
                ((e, p, j) for e, p in laws for j in self.joints), amounts, strict=True
            )
        ]
        made += [
            Named(effect="encoder_offset", joints=(j,), parameters={"offset": float(b)}, weight=0.0)
            for j, b in zip(self.joints, self.bias(x), strict=True)
        ]
        delay = {"delay": float(_DELAY * x[-1])}
        made.append(Named(effect="command_delay", joints=self.joints, parameters=delay, weight=0.0))
        return made

    @property
    def nominal(self) -> Array:
        """The point that changes nothing, shape (P,)."""
        x = np.zeros(self.size)
        x[3 * len(self.joints) : 4 * len(self.joints)] = 0.5
        return x


def cma(case: Case) -> tuple[list[Named], float]:
    """Returns what matters most of the parameters found, and the held-out error."""
    problem = case.problem.subset(case.problem.sample(_SIMULATED_S))
    space = _space(case)
    x, best = _search(problem, space)
    returned = np.tile(x, (space.size, 1))
    np.fill_diagonal(returned, space.nominal)
    losses = rises(np.array(_costs(problem, space, list(returned))), best)
    most = int(np.argmax(losses))
    named = space.named(x)[most]
    return [named], case.held_out_error(case.specs, space.effects(x))


def _space(case: Case) -> Space:
    """Returns bounds from the model itself: what is usual for drives of its size."""
    spec = next(iter(case.specs.values()))
    joints = [spec.joint(name) for name in case.joints]
    inertia = np.array([5.0 * max(float(j.armature), 1e-3) for j in joints])
    peak = np.max([_peak(case, i) for i in range(len(case.training))], axis=0)
    speed = np.max([np.ptp(r.position, axis=0) / 2.0 for r in case.training], axis=0) + 0.5
    return Space(joints=case.joints, upper=np.stack([inertia, peak / speed, 0.5 * peak]))


def _peak(case: Case, index: int) -> Array:
    """Returns the largest torques of a recording as the model has them, N m, shape (J,)."""
    predictions = case.problem.predictions([()], efforts=True)[0]
    here = [
        np.nanmax(np.abs(p.effort), axis=0)
        for p, s in zip(predictions, case.problem.segments, strict=True)
        if s.recording == index
    ]
    return np.asarray(np.max(here, axis=0))


def _search(problem: Problem, space: Space) -> tuple[Array, float]:
    bounds = np.tile([0.0, 1.0], (space.size, 1))
    start = np.clip(space.nominal, 0.05, 0.95)
    optimizer = CMA(mean=start, sigma=0.2, bounds=bounds, seed=0)
    ends = time.process_time() + _LIMIT_S
    best, cost = start, np.inf
    for _ in range(_GENERATIONS):
        points = [optimizer.ask() for _ in range(optimizer.population_size)]
        costs = _costs(problem, space, points)
        optimizer.tell(list(zip(points, costs, strict=True)))
        if min(costs) < cost:
            best, cost = points[int(np.argmin(costs))], min(costs)
        if optimizer.should_stop() or time.process_time() > ends:
            break
    return best, cost


def _costs(problem: Problem, space: Space, points: Sequence[Array]) -> list[float]:
    rows = problem.predictions([space.effects(x) for x in points])
    costs = []
    for x, row in zip(points, rows, strict=True):
        errors = [
            (s.position - p.position - space.bias(x)) / problem.noise.position
            for s, p in zip(problem.segments, row, strict=True)
        ]
        cost = float(np.mean(np.concatenate(errors) ** 2))
        costs.append(cost if np.isfinite(cost) else 1e12)
    return costs
