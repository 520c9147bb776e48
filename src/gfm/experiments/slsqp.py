"""The paper's baseline: actuator gain and damping of every joint, identified with SciPy's SLSQP.

It assumes that the model's structure is right and only these numbers are wrong (Jeong et al. 2019,
section V-A). What it cannot express, it bends them to imitate.

Shape letters: J joints, P = 2 J parameters (gains, then dampings), N residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest

import mujoco
import numpy as np
from scipy.optimize import minimize

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import all_segments, prepared
from gfm.diagnosis.inference.amounts import amounts, bounds_of, with_amounts
from gfm.diagnosis.inference.fitting import derivatives
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance, find_effect
from gfm.effects.nominal_parameters import least_amounts


@dataclass(frozen=True, kw_only=True)
class Identified:
    """What the baseline found.

    Attributes:
        effects: One actuator_gain and one viscous_friction per joint. The amount of the latter is
            added to the model's damping and may be negative, as far as their sum is not.
        gain: Factor on each drive's torque, shape (J,).
        damping: Of each joint, the model's own included, N m s/rad, shape (J,).
        before: Rollout position RMSE of the nominal model on the recordings used, rad.
        after: The same of the identified model.
        recordings: Names of the recordings used.
        iterations: Of SLSQP.
        converged: Whether SLSQP ended by itself.
    """

    effects: tuple[EffectInstance, ...]
    gain: Array
    damping: Array
    before: float
    after: float
    recordings: tuple[str, ...]
    iterations: int
    converged: bool


def identify(
    specs: Mapping[CommandKind, mujoco.MjSpec],
    recordings: Sequence[Trajectory],
    *,
    given: Sequence[EffectInstance] = (),
    most_s: float = 20.0,
    max_iterations: int = 15,
) -> Identified:
    """Returns the gains and dampings that minimise the error of open-loop rollouts.

    Args:
        specs: The nominal model by kind of command.
        recordings: Training recordings; kinds of command take turns until `most_s` is reached.
        given: Effects of the nominal model that `specs` cannot say.
        most_s: Recorded time to use, s.
        max_iterations: Of SLSQP.

    Raises:
        BadInputError: models and recordings do not belong together.
    """
    chosen = _alternating(recordings, most_s)
    positions = [replace(recording, effort=None) for recording in chosen]
    problem = prepared(all_segments(specs, positions, given=given))
    nominal = _nominal(problem)
    start, (low, high) = amounts(nominal), bounds_of(nominal)
    before = _errors(problem, nominal)
    unit_rad = max(float(np.sqrt(np.mean(before**2))), 1e-12)
    # Parameters that change residuals about as much, and a curvature of about one, which is what
    # SLSQP assumes at first.
    sizes = np.sqrt(np.mean(_slopes(problem, nominal, before) ** 2, axis=0))
    scale = unit_rad / np.maximum(sizes, 1e-9 * unit_rad)

    def at(scaled: Array) -> tuple[EffectInstance, ...]:
        return with_amounts(nominal, start + scale * scaled)

    def value(scaled: Array) -> float:
        return 0.5 * float(np.mean(_errors(problem, at(scaled)) ** 2)) / unit_rad**2

    def gradient(scaled: Array) -> Array:
        errors = _errors(problem, at(scaled))
        slopes = _slopes(problem, at(scaled), errors)
        return np.asarray(errors @ slopes / errors.size * scale / unit_rad**2)

    found = minimize(
        value,
        np.zeros(len(start)),
        jac=gradient,
        method="SLSQP",
        bounds=list(zip((low - start) / scale, (high - start) / scale, strict=True)),
        options={"maxiter": max_iterations, "ftol": 1e-6},
    )
    gain, added = np.split(start + scale * found.x, 2)
    return Identified(
        effects=at(found.x),
        gain=gain,
        damping=added - low[len(added) :],
        before=unit_rad,
        after=unit_rad * float(np.sqrt(2.0 * found.fun)),
        recordings=tuple(recording.name for recording in chosen),
        iterations=int(found.nit),
        converged=bool(found.success),
    )


def _alternating(recordings: Sequence[Trajectory], most_s: float) -> list[Trajectory]:
    """Returns recordings until `most_s` is reached; kinds of command take turns."""
    kinds = list(dict.fromkeys(r.command_kind for r in recordings))
    columns = [[r for r in recordings if r.command_kind is kind] for kind in kinds]
    turns = [r for row in zip_longest(*columns) for r in row if r is not None]
    passed_s = np.cumsum([0.0] + [r.duration_s for r in turns[:-1]])
    return [r for r, before_s in zip(turns, passed_s, strict=True) if before_s < most_s - 1e-6]


def _nominal(problem: Problem) -> tuple[EffectInstance, ...]:
    """Returns the effects that leave the model as it is; no damping falls below none at all."""
    none = {"actuator_gain": {"scale": 1.0}, "viscous_friction": {"coefficient": 0.0}}
    return tuple(
        EffectInstance(
            effect=(effect := find_effect(name)),
            joints=(joint,),
            values=values,
            least=least_amounts(problem.specs.values(), effect, [joint]),
        )
        for name, values in none.items()
        for joint in problem.joints
    )


def _errors(problem: Problem, effects: tuple[EffectInstance, ...]) -> Array:
    """Returns measured minus predicted positions, rad, shape (N,)."""
    return np.concatenate([part.ravel() for part in problem.position_errors(effects)])


def _slopes(problem: Problem, effects: tuple[EffectInstance, ...], errors: Array) -> Array:
    """Returns the derivatives of such errors by the parameters, shape (N, P)."""
    columns = derivatives(problem, effects, errors)
    noise = np.tile(problem.noise.position, len(columns) // len(problem.joints))
    return np.asarray(noise[:, None] * columns)
