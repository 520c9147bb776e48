"""What most models of real robots get wrong at once: gains, friction, inertia, a delay.

Where everything is a little wrong, no single effect explains much, and the one that explains most
may be none of those that are missing. Then what is usually wrong is fitted on all joints together,
from the best of a coarse grid, and what does not earn its place is taken out again. The same is
done beside what was found, where much is left.

Shape letters: G values of a grid, J joints, N numbers of a residual, P parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import FITTING_S, LEAST_GAIN, ROUGH, Fit, fit, free_parameters
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.screening import SUSPECT_JOINT
from gfm.effects import EffectInstance, Scales, Scope, find_effect

#: Times that the grid is gone through, and fits with what is left after taking out.
PASSES, FITS = 2, 3
#: Shares of a typical size at which amounts are tried.
SHARES = (0.0, 0.1, 0.3, 1.0, 3.0)


@dataclass(frozen=True, kw_only=True)
class Usual:
    """An effect that a model may lack on any joint.

    Attributes:
        name: Of the effect, which has one parameter.
        none: Its value without the effect.
        grid: Values to begin with, for a joint with these scales.
    """

    name: str
    none: float
    grid: Callable[[Scales], Sequence[float]]


USUAL = (
    Usual(name="command_delay", none=0.0, grid=lambda _: (0.0, 0.01, 0.02, 0.04, 0.08)),
    Usual(name="actuator_gain", none=1.0, grid=lambda _: (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)),
    Usual(name="coulomb_friction", none=0.0, grid=lambda s: [x * s.torque_nm for x in SHARES]),
    Usual(
        name="viscous_friction",
        none=0.0,
        grid=lambda s: [x * s.torque_nm / s.velocity_rad_s for x in SHARES],
    ),
    Usual(name="armature", none=0.0, grid=lambda s: [x * s.inertia for x in SHARES]),
)


def usually_missing(
    problem: Problem,
    base: Sequence[EffectInstance],
    scales: Sequence[Scales],
    report: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Returns what is usually missing, fitted on all joints, without what explains too little.

    Args:
        problem: What is to be explained.
        base: Effects beside which it is looked for; they come first in the fit.
        scales: Of every joint's signals.
        report: Told what is happening, in words.
    """
    part = problem.subset(problem.sample(FITTING_S))
    report("looking for what is usually wrong on all joints")
    effects = [*base, *_from_grid(part, base, scales, missed(part, base))]
    for _ in range(FITS):
        report(f"fitting {len(effects)} effects together")
        fitted = fit(part.robust(effects), effects, tolerance=ROUGH)
        effects = earning(part, fitted, len(base))
        if len(effects) == len(fitted.effects):
            break
    return fit(part.robust(effects), effects, tolerance=ROUGH)


def missed(problem: Problem, base: Sequence[EffectInstance] = ()) -> list[int]:
    """Returns the joints on which a model with `base` leaves much, by their numbers."""
    costs = problem.joint_costs(problem.residuals([base])[0]) - 1.0
    return [int(j) for j in np.flatnonzero(costs > SUSPECT_JOINT * costs.max())]


def _from_grid(
    problem: Problem,
    base: Sequence[EffectInstance],
    scales: Sequence[Scales],
    joints: Sequence[int],
) -> tuple[EffectInstance, ...]:
    """Returns every usual effect on every one of `joints`, with the best of its grid.

    All joints are tried side by side: each takes what leaves least on itself. What `base` has
    already is left out.
    """
    chosen = {usual.name: np.full(len(problem.joints), usual.none) for usual in USUAL}
    taken = {instance.key for instance in base}

    def instances(values: dict[str, Array]) -> tuple[EffectInstance, ...]:
        return tuple(e for e in _instances(problem, joints, values) if e.key not in taken)

    for _ in range(PASSES):
        for usual in USUAL:
            grid = np.array([usual.grid(one) for one in scales]).T
            sets = [(*base, *instances({**chosen, usual.name: row})) for row in grid]
            costs = np.stack([problem.joint_costs(r) for r in problem.residuals(sets)])
            if find_effect(usual.name).scope is not Scope.JOINT:
                costs[:] = costs.mean(axis=1, keepdims=True)
            best = costs.argmin(axis=0)
            chosen[usual.name] = grid[best, np.arange(len(scales))]
    return instances(chosen)


def _instances(
    problem: Problem, joints: Sequence[int], values: dict[str, Array]
) -> list[EffectInstance]:
    found = []
    for name, amounts in values.items():
        effect = find_effect(name)
        there = problem.driven if effect.needs_drive else problem.joints
        places = [(there, amounts[0])]
        if effect.scope is Scope.JOINT:
            here = [(problem.joints[j], amounts[j]) for j in joints]
            places = [((joint,), amount) for joint, amount in here if joint in there]
        found += [
            EffectInstance(
                effect=effect, joints=place, values={effect.parameters[0].name: float(amount)}
            )
            for place, amount in places
        ]
    return found


def earning(
    problem: Problem, fitted: Fit, base: int = 0, own: Sequence[EffectInstance] = ()
) -> list[EffectInstance]:
    """Returns the effects of a fit without those that explain too little, to first order.

    One after the other, that first which explains least of what is left on its own joint; the
    others take over what they can.

    Args:
        problem: What is to be explained.
        fitted: All effects.
        base: How many of them, the first, stay.
        own: Effects with the amounts that explain nothing, where that is not none at all.
    """
    usual = {one.name: one.none for one in USUAL}
    said = {e.key: e.values[e.effect.parameters[0].name] for e in own}
    left = problem.joint_costs(fitted.residual)
    kept, effects = list(fitted.effects[:base]), list(fitted.effects[base:])
    jacobian, first = fitted.jacobian, len(free_parameters(kept))
    excess = np.array(
        [
            effects[i].values[p] - said.get(effects[i].key, usual[effects[i].effect.name])
            for i, p in free_parameters(effects)
        ]
    )
    while effects:
        inverse = np.linalg.pinv(jacobian.T @ jacobian)[:, first:]
        moves = -inverse * (excess / np.diag(inverse[first:]))
        shares = [
            _share(problem, effects[k], jacobian @ moves[:, k], left) for k in range(len(effects))
        ]
        least = int(np.argmin(shares))
        if shares[least] >= LEAST_GAIN:
            break
        excess = np.delete(excess + moves[first:, least], least)
        jacobian = np.delete(jacobian, first + least, axis=1)
        del effects[least]
    return [*kept, *effects]


def _share(problem: Problem, instance: EffectInstance, change: Array, left: Array) -> float:
    """Returns the cost of going without an effect, as a share of what is left where it acts.

    Of several joints that which needs it most counts.
    """
    shares = problem.joint_costs(change) / left
    return float(max(shares[problem.joints.index(name)] for name in instance.joints))
