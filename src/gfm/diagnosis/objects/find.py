"""Which effect of the object is missing: the few there are, fitted, and weighed by the score.

All candidates are fitted in every step; one is chosen that predicts clearly better. What poses
cannot tell is not fitted at all.

Shape letters: N numbers of a residual, P parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.inference.score import blocks_of, difference, predictive, room
from gfm.diagnosis.objects.problem import ObjectProblem
from gfm.diagnosis.objects.stage import make_stage
from gfm.diagnosis.search.moves.add import best_of
from gfm.diagnosis.search.trace import Evidence, Move, SearchResult, Step, Tried
from gfm.effects import Effect, EffectInstance, Key, Scope, effect_library

#: Steps of a fit at most, and the relative gain below which it ends.
FIT_STEPS, FIT_TOLERANCE = 6, 3e-3
#: Turns of amounts and initial states, and the relative gain of a turn that is not worth another.
TURNS, ENOUGH = 5, 0.01
#: Derivatives are taken over this share of a parameter's scale.
STEP = 0.3
#: An effect is seen where an amount of its scale changes all residuals together by so much.
SEEN = 6.0
#: Share of the best first-order gain from which an effect is fitted.
RIVAL = 0.2


@dataclass(frozen=True, kw_only=True)
class Found:
    """What was found, and what could not have been.

    Attributes:
        result: The search.
        unseen: Effects on which the stretches do not depend.
    """

    result: SearchResult
    unseen: tuple[Effect, ...]


def find(problem: ObjectProblem) -> Found:
    """Returns what the object lacks in the model."""
    effects = [one for one in effect_library().values() if one.scope is Scope.OBJECT]
    scales = _scales(problem)
    columns = [_response(problem, one, scales) for one in effects]
    pairs = list(zip(effects, columns, strict=True))
    seen = [e for e, c in pairs if np.linalg.norm(c, axis=0).max() > SEEN]
    likely = _likely(problem, [(e, c) for e, c in pairs if e in seen])
    blocks = blocks_of(problem)
    base = fit(problem, (), scales)
    nominal, steps = base.cost, []
    while room(blocks, predictive(blocks, base)).clear and len(base.effects) < len(likely):
        robust = problem.robust(base.effects)
        step = _step(robust, fit(robust, base.effects, scales), likely, scales)
        steps.append(step)
        if step.chosen is None:
            break
        base = step.chosen.fit
    return Found(
        result=SearchResult(
            nominal_cost=nominal,
            fit=base,
            room=room(blocks, predictive(blocks, base)),
            steps=tuple(steps),
            evidence=_evidence(problem, base, likely, scales),
        ),
        unseen=tuple(one for one in effects if one not in seen),
    )


def friction_cost(problem: ObjectProblem) -> float:
    """Returns what the object's friction leaves when it is fitted alone."""
    effect = effect_library()["object_friction"]
    return fit(problem, (_instance(effect, np.zeros(1)),), _scales(problem)).cost


def _scales(problem: ObjectProblem) -> dict[str, float]:
    """Returns amounts that matter, by effect and parameter: of friction, mass, place, rate."""
    stage = make_stage(problem.spec)
    body = int(stage.model.dof_bodyid[stage.object_dof.start])
    mass = float(stage.model.body_mass[body])
    inertia = float(np.max(stage.model.body_inertia[body]))
    radius = float(np.sqrt(inertia / mass))
    return {
        "object_friction.coefficient": 0.1,
        "object_mass.mass": 0.5 * mass,
        "object_damping.linear": 0.5 * mass,
        "object_damping.angular": 0.5 * inertia,
        **{f"object_com.{axis}": 0.2 * radius for axis in "xyz"},
    }


def _scale(effect: Effect, scales: Mapping[str, float]) -> Array:
    return np.array([scales[f"{effect.name}.{p.name}"] for p in effect.parameters])


def _response(problem: ObjectProblem, effect: Effect, scales: Mapping[str, float]) -> Array:
    """Returns by how much amounts of an effect's scale change residuals, shape (N, P)."""
    start = (_instance(effect, np.zeros(len(effect.parameters))),)
    return _jacobian(problem.based(()), start, scales) * _scale(effect, scales)


def _likely(problem: ObjectProblem, seen: Sequence[tuple[Effect, Array]]) -> list[Effect]:
    """Returns the effects that explain something to first order, beside the best of them."""
    (residual,) = problem.based(()).residuals([()])
    gains = {}
    for effect, columns in seen:
        rest = residual - columns @ np.linalg.lstsq(columns, residual, rcond=1e-6)[0]
        gains[effect.name] = 1.0 - float(np.sum(rest**2) / np.sum(residual**2))
    least = RIVAL * max(gains.values(), default=0.0)
    return [effect for effect, _ in seen if gains[effect.name] >= least]


def _instance(effect: Effect, values: Array) -> EffectInstance:
    names = [p.name for p in effect.parameters]
    amounts = dict(zip(names, values.tolist(), strict=True))
    return EffectInstance(effect=effect, joints=(), values=amounts)


def _step(
    problem: ObjectProblem, base: Fit, likely: Sequence[Effect], scales: Mapping[str, float]
) -> Step:
    """Returns every effect that is not there yet, fitted beside those that are."""
    blocks = blocks_of(problem)
    start = predictive(blocks, base)
    there = {instance.effect.name for instance in base.effects}
    tried = []
    for effect in (one for one in likely if one.name not in there):
        new = _instance(effect, np.zeros(len(effect.parameters)))
        fitted = fit(problem, (*base.effects, new), scales)
        gain = difference(blocks, predictive(blocks, fitted), start)
        tried.append(Tried(new=fitted.effects[-1:], fit=fitted, gain=gain))
    return Step(
        move=Move.ADD,
        before=base.cost,
        ranked=tuple(sorted(tried, key=lambda one: -one.gain.nats)),
        chosen=best_of(blocks, tried),
    )


def _evidence(
    problem: ObjectProblem, fitted: Fit, likely: Sequence[Effect], scales: Mapping[str, float]
) -> dict[Key, Evidence]:
    """Returns what speaks for each effect: against none in its place, and against every other."""
    if not fitted.effects:
        return {}
    robust = problem.robust(fitted.effects)
    blocks = blocks_of(robust)
    whole = fit(robust, fitted.effects, scales)
    told = predictive(blocks, whole)
    nominal = max(fit(robust, (), scales).cost - 1.0, 1e-9)
    names = {one.effect.name for one in fitted.effects}
    found = {}
    for instance in fitted.effects:
        rest = tuple(one for one in whole.effects if one.key != instance.key)
        others = [_instance(e, np.zeros(len(e.parameters))) for e in likely if e.name not in names]
        instead = [fit(robust, (*rest, other), scales) for other in others]
        pairs = [(difference(blocks, told, predictive(blocks, f)), f) for f in instead]
        over, rival = min(pairs, key=lambda pair: pair[0].nats, default=(None, None))
        found[instance.key] = Evidence(
            without=difference(blocks, told, predictive(blocks, fit(robust, rest, scales))),
            rival=over,
            by=rival.effects[-1] if rival else None,
            left=max(whole.cost - 1.0, 0.0) / nominal,
            halves=0.0,
        )
    return found


def fit(
    problem: ObjectProblem, start: tuple[EffectInstance, ...], scales: Mapping[str, float]
) -> Fit:
    """Returns effects with the values that leave the least residual.

    By turns with how the stretches begin: first as measured, then as it fits best.
    """
    if not start:
        (residual,) = problem.settled(()).residuals([()])
        empty = np.zeros((len(residual), 0))
        return Fit(effects=(), cost=_cost(residual), jacobian=empty, residual=residual)
    best = _fitted(problem.based(start), start, scales)
    for _ in range(TURNS):
        problem = problem.nearer(best.effects)
        newest = _fitted(problem, best.effects, scales)
        done = newest.cost > (1.0 - ENOUGH) * best.cost
        best = newest
        if done:
            break
    return best


def _fitted(
    problem: ObjectProblem, start: tuple[EffectInstance, ...], scales: Mapping[str, float]
) -> Fit:
    scale = np.concatenate([_scale(one.effect, scales) for one in start])
    bounds = [(p.lower, p.upper) for one in start for p in one.effect.parameters]
    low, high = np.array(bounds).T
    answer = least_squares(
        lambda x: problem.residuals([_with(start, x * scale)])[0],
        np.clip(_vector(start), low + 1e-9, high - 1e-9) / scale,
        jac=lambda x: _jacobian(problem, _with(start, x * scale), scales) * scale,
        bounds=(low / scale, high / scale),
        ftol=FIT_TOLERANCE,
        xtol=1e-3,
        max_nfev=FIT_STEPS,
    )
    return Fit(
        effects=_with(start, answer.x * scale),
        cost=_cost(answer.fun),
        jacobian=answer.jac / scale,
        residual=answer.fun,
    )


def _cost(residual: Array) -> float:
    return float(np.mean(residual**2))


def _vector(effects: Sequence[EffectInstance]) -> Array:
    return np.array([one.values[p.name] for one in effects for p in one.effect.parameters])


def _with(effects: Sequence[EffectInstance], vector: Array) -> tuple[EffectInstance, ...]:
    ends = np.cumsum([len(one.effect.parameters) for one in effects])[:-1]
    parts = np.split(vector, ends)
    return tuple(
        replace(_instance(one.effect, part), joints=one.joints)
        for one, part in zip(effects, parts, strict=True)
    )


def _jacobian(
    problem: ObjectProblem, effects: Sequence[EffectInstance], scales: Mapping[str, float]
) -> Array:
    """Returns the derivative of the residual by each parameter, shape (N, P)."""
    values = _vector(effects)
    steps = STEP * np.concatenate([_scale(one.effect, scales) for one in effects])
    moved = [_with(effects, values + step) for step in np.diag(steps)]
    still, *rows = problem.residuals([effects, *moved])
    return np.asarray(((np.stack(rows) - still) / steps[:, None]).T)
