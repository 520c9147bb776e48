"""A ladder of models, as BAM chooses among friction laws (Duclusaud et al., arXiv 2410.08650).

A rung adds one effect that MJCF can say, on one joint: its amount is refitted alone, by the squared
error of positions over short open-loop rollouts. The best rung is chosen on recordings that no
amount was fitted to, and is refused if it makes their error less than a tenth smaller.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
from scipy.optimize import minimize_scalar

from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance, find_effect
from peers.case import Case, Named

#: Least gain of a rung, rungs, rollouts of one fit, recorded time in each half, s, and processor
#: time after which no rung is begun, s.
_LEAST, _RUNGS, _ROLLOUTS, _SIMULATED_S, _LIMIT_S = 0.1, 6, 12, 8.0, 120.0
_DELAY, _GAIN = 0.04, (0.2, 3.0)


def ladder(case: Case) -> tuple[list[Named], float]:
    """Returns the effects of the rungs that were taken, and the held-out error."""
    (fitted_to, chosen_on), candidates = _halves(case), list(_candidates(case))
    taken, named = list[EffectInstance](), list[Named]()
    left, ends = _error(chosen_on, taken), time.process_time() + _LIMIT_S
    while len(taken) < _RUNGS and time.process_time() < ends:
        there = {one.key for one in taken}
        new = [one for one in candidates if one[:2] not in there]
        rungs = [_refitted(fitted_to, taken, *one) for one in new]
        errors = [_error(chosen_on, [*taken, one]) for one in rungs]
        best = int(np.argmin(errors))
        if errors[best] > (1.0 - _LEAST) * left:
            break
        one, gain = rungs[best], left / errors[best] - 1.0
        taken.append(one)
        named.append(
            Named(
                effect=one.effect.name, joints=one.joints, parameters=dict(one.values), weight=gain
            )
        )
        left = errors[best]
    return named, case.held_out_error(case.specs, taken)


def _halves(case: Case) -> tuple[Problem, Problem]:
    """Returns what amounts are fitted to, and what rungs are chosen on: other recordings.

    Of a single recording, its first and its second half.
    """
    of = np.array([segment.recording for segment in case.problem.segments])
    late = of == of.max() if len(set(of)) > 1 else np.arange(len(of)) >= len(of) // 2
    halves = [case.problem.subset(np.flatnonzero(half).tolist()) for half in (~late, late)]
    first, second = (half.subset(half.sample(_SIMULATED_S)) for half in halves)
    return first, second


def _candidates(
    case: Case,
) -> Iterator[tuple[str, tuple[str, ...], str, tuple[float, float]]]:
    """Yields what may be added: effect, joints, its parameter, and bounds from the model itself."""
    spec = next(iter(case.specs.values()))
    predicted = case.problem.predictions([()], efforts=True)[0]
    peaks = np.nanmax([np.nanmax(np.abs(one.effort), axis=0) for one in predicted], axis=0)
    speeds = np.max([np.ptp(r.position, axis=0) / 2.0 for r in case.training], axis=0) + 0.5
    for joint, peak, speed in zip(case.joints, peaks.tolist(), speeds.tolist(), strict=True):
        rotor = 5.0 * max(float(spec.joint(joint).armature), 1e-3)
        laws = {
            ("armature", "inertia"): (0.0, rotor),
            ("viscous_friction", "coefficient"): (0.0, peak / speed),
            ("coulomb_friction", "torque"): (0.0, 0.5 * peak),
            ("torque_offset", "torque"): (-0.5 * peak, 0.5 * peak),
            ("actuator_gain", "scale"): _GAIN,
        }
        for (effect, parameter), bounds in laws.items():
            yield effect, (joint,), parameter, bounds
    yield "command_delay", case.joints, "delay", (0.0, _DELAY)


def _refitted(
    problem: Problem,
    taken: list[EffectInstance],
    effect: str,
    joints: tuple[str, ...],
    parameter: str,
    bounds: tuple[float, float],
) -> EffectInstance:
    """Returns an effect in the amount that leaves least beside those taken."""

    def instance(amount: float) -> EffectInstance:
        values = {parameter: float(amount)}
        return EffectInstance(effect=find_effect(effect), joints=joints, values=values)

    found = minimize_scalar(
        lambda amount: _error(problem, [*taken, instance(amount)]),
        bounds=bounds,
        method="bounded",
        options={"maxiter": _ROLLOUTS},
    )
    return instance(found.x)


def _error(problem: Problem, effects: list[EffectInstance]) -> float:
    """Returns the RMS of position errors in units of the noise."""
    errors = np.concatenate([e.ravel() for e in problem.position_errors(effects)])
    return float(np.nan_to_num(np.sqrt(np.mean(errors**2)), nan=1e12, posinf=1e12))
