"""The paper's baseline: actuator gain and damping of every joint, identified with SciPy's SLSQP.

It assumes that the model's structure is right and only these numbers are wrong (Jeong et al. 2019,
section V-A). What it cannot express, it bends them to imitate.

Shape letters: J joints, P = 2 J parameters (gains, then dampings), N residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import final

import mujoco
import numpy as np
from scipy.optimize import minimize

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.data.segmentation import make_problem
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import Effect, EffectInstance, find_effect

#: Relative steps of the finite differences: of the gain, and of the damping's unit.
_STEP = 0.01
#: Least motion and torque that the damping's unit is taken from, rad/s and N m.
_LEAST_SPEED, _LEAST_TORQUE = 1e-3, 1e-3


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
    problem = make_problem(specs, positions, given=given)
    objective = _Objective(problem)
    found = minimize(
        objective.value,
        objective.start,
        jac=objective.gradient,
        method="SLSQP",
        bounds=objective.bounds,
        options={"maxiter": max_iterations, "ftol": 1e-6},
    )
    parameters = objective.parameters(found.x)
    gain, added = np.split(parameters, 2)
    return Identified(
        effects=objective.effects(parameters),
        gain=gain,
        damping=added + objective.nominal_damping,
        before=objective.unit_rad,
        after=objective.unit_rad * float(np.sqrt(2.0 * found.fun)),
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


@final
class _Objective:
    """Half the mean squared position error of rollouts, in units of the nominal model's.

    Rollouts are integrated fast; what that changes is measured once, on the nominal model, and
    taken off. SLSQP's variables are scaled so that each changes the residuals about as much, and
    the objective has about unit curvature in them, which is what SLSQP assumes at first.

    Attributes:
        unit_rad: RMSE of the nominal model.
        nominal_damping: shape (J,).
    """

    def __init__(self, problem: Problem) -> None:
        self._joints = problem.joints
        # Amounts come from these rollouts alone: steps that do for derivatives are too long.
        stepping = {kind: one.halved() for kind, one in problem.stepping.items()}
        self._fast = replace(problem.coarse(), stepping=stepping)
        self._noise = problem.noise.position
        damping = [
            [spec.joint(name).damping[0] for name in problem.joints]
            for spec in problem.specs.values()
        ]
        self.nominal_damping: Array = np.min(damping, axis=0)
        nominal = np.concatenate([np.ones(len(problem.joints)), np.zeros(len(problem.joints))])
        accurate = self._in_rad(problem.residuals([()]))[0]
        self._correction: Array = np.zeros(len(accurate))
        self._correction = accurate - self._residuals([nominal])[0]
        self.unit_rad = max(float(np.sqrt(np.mean(accurate**2))), 1e-12)
        self._step = np.concatenate(
            [np.full(len(self._joints), _STEP), _STEP * self._damping_unit()]
        )
        self._nominal = nominal
        columns = self._jacobian(nominal)[1]
        self._scale = self.unit_rad / np.maximum(
            np.sqrt((columns**2).mean(axis=1)), 1e-9 * self.unit_rad
        )
        self._known: dict[bytes, float] = {}

    @property
    def start(self) -> Array:
        """The nominal model, shape (P,)."""
        return np.zeros(len(self._nominal))

    @property
    def bounds(self) -> list[tuple[float, None]]:
        """Neither gain nor damping is negative."""
        least = np.concatenate([np.zeros(len(self._joints)), -self.nominal_damping])
        return [(float(low), None) for low in (least - self._nominal) / self._scale]

    def parameters(self, scaled: Array) -> Array:
        """Returns gains and added dampings, shape (P,), of SLSQP's variables."""
        return np.asarray(self._nominal + self._scale * scaled)

    def effects(self, parameters: Array) -> tuple[EffectInstance, ...]:
        """Returns the parameters as effects."""
        gain, damping = find_effect("actuator_gain"), find_effect("viscous_friction")
        gains, dampings = np.split(parameters, 2)
        return (
            *(_on(gain, name, "scale", x) for name, x in zip(self._joints, gains, strict=True)),
            *(
                _on(damping, name, "coefficient", x)
                for name, x in zip(self._joints, dampings, strict=True)
            ),
        )

    def value(self, scaled: Array) -> float:
        """Returns the objective."""
        key = scaled.tobytes()
        if key not in self._known:
            residual = self._residuals([self.parameters(scaled)])[0]
            self._known[key] = self._cost(residual)
        return self._known[key]

    def gradient(self, scaled: Array) -> Array:
        """Returns its gradient, shape (P,): finite differences of the residuals, in one batch."""
        residual, columns = self._jacobian(self.parameters(scaled))
        return np.asarray(columns @ residual / residual.size * self._scale / self.unit_rad**2)

    def _cost(self, residual: Array) -> float:
        return 0.5 * float(np.mean(residual**2)) / self.unit_rad**2

    def _jacobian(self, parameters: Array) -> tuple[Array, Array]:
        """Returns the residual (N,) and its derivatives (P, N)."""
        moved = parameters + np.diag(self._step)
        rows = self._residuals([parameters, *moved])
        return rows[0], (rows[1:] - rows[0]) / self._step[:, None]

    def _residuals(self, parameters: Sequence[Array]) -> Array:
        """Returns measured minus predicted positions, rad, shape (len(parameters), N)."""
        rows = self._fast.residuals([self.effects(one) for one in parameters])
        return self._in_rad(rows) + self._correction

    def _in_rad(self, whitened: Array) -> Array:
        shape = (len(whitened), -1, len(self._joints))
        return np.asarray((whitened.reshape(shape) * self._noise).reshape(len(whitened), -1))

    def _damping_unit(self) -> Array:
        """Returns a damping that would matter: drive torque over speed, N m s/rad, shape (J,)."""
        predictions = self._fast.predictions([()], efforts=True)[0]
        torque = np.concatenate([p.effort for p in predictions])
        speed = np.concatenate(
            [
                np.gradient(p.position, s.time_s, axis=0)
                for p, s in zip(predictions, self._fast.segments, strict=True)
            ]
        )
        rms = [np.sqrt((values**2).mean(axis=0)) for values in (torque, speed)]
        return np.asarray(np.maximum(rms[0], _LEAST_TORQUE) / np.maximum(rms[1], _LEAST_SPEED))


def _on(effect: Effect, joint: str, parameter: str, value: float) -> EffectInstance:
    return EffectInstance(effect=effect, joints=(joint,), values={parameter: float(value)})
