"""A velocity-controlled arm as the control tasks act on it: speed limit, gain, disturbances.

Shape letters: N instances, n of them, J joints, A generalized forces.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gfm.core import CommandKind, ConfigError
from gfm.core.checks import Array, Array32
from gfm.envs.control_settings import ControlSettings
from gfm.sim.batch import HybridBatch
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import ForceEnsemble, LearnedForces
from gfm.sim.randomised import randomised_models
from gfm.sim.ranges import DrawnModels

#: Of the allowed velocities (Jeong et al. 2019, section IV-C).
VELOCITY_SHARE = 0.05
#: Between two decisions, s: 20 Hz.
CONTROL_PERIOD_S = 0.05
_VARIANTS_SEED = 0


@dataclass(frozen=True, kw_only=True)
class ArmProblem:
    """What all instances share.

    Attributes:
        model: Takes velocity commands.
        settings: Gain and disturbances.
        ensemble: Generalized force models; each episode has one of them. The model's own period is
            the longest that fits into theirs and into the task's (see `common_period_s`).
        drawn: Models with amounts drawn from ranges; each episode has one of them.
    """

    model: HybridModel
    settings: ControlSettings = field(default_factory=ControlSettings)
    ensemble: tuple[LearnedForces, ...] = ()
    drawn: DrawnModels | None = None

    def __post_init__(self) -> None:
        period_s = self.model.control_period_s
        for decided_s in (CONTROL_PERIOD_S, *(one.control_period_s for one in self.ensemble)):
            if abs(round(decided_s / period_s) * period_s - decided_s) > 1e-9:
                raise ConfigError(
                    f"the model is stepped every {period_s} s, expected a whole number of times "
                    f"within {decided_s} s"
                )
        if CommandKind.VELOCITY not in self.model.models:
            given = ", ".join(sorted(self.model.models))
            raise ConfigError(f"the control tasks need a velocity model, got one for {given}")
        if not self.nominal.actuator_ctrllimited[self.model.layout.actuator].all():
            raise ConfigError("an actuator has no control range, expected its velocity limit there")

    @property
    def nominal(self) -> mujoco.MjModel:
        """What is known of the arm: the model without randomisation, or with usual amounts."""
        if self.drawn is not None:
            return self.drawn.usual
        return self.model.models[CommandKind.VELOCITY]

    @property
    def repeats(self) -> int:
        """Steps of the model per control period."""
        return round(CONTROL_PERIOD_S / self.model.control_period_s)

    @cached_property
    def velocity_limit(self) -> Array:
        """What an action of 1 commands at a gain of 1, rad/s, shape (J,)."""
        upper = self.nominal.actuator_ctrlrange[self.model.layout.actuator, 1]
        return np.asarray(VELOCITY_SHARE * upper)

    @cached_property
    def variants(self) -> tuple[mujoco.MjModel, ...]:
        """What an episode's model is drawn from."""
        settings = self.settings
        if self.drawn is not None:
            return self.drawn.variants
        if settings.randomisation == 0.0:
            return (self.nominal,)
        rng = np.random.default_rng(_VARIANTS_SEED)  # every actor draws from the same ones
        return randomised_models(self.nominal, settings.variants, settings.randomisation, rng)

    @cached_property
    def zero(self) -> Array:
        """What the encoders read where the published arm is at zero, rad, shape (J,)."""
        return np.asarray(self.nominal.qpos0[self.model.layout.qpos])


def common_period_s(periods_s: Sequence[float], timestep_s: float) -> float:
    """Returns the longest time that fits into all periods, in whole time steps."""
    return math.gcd(*(round(period_s / timestep_s) for period_s in periods_s)) * timestep_s


@final
class Arm:
    """N arms.

    Attributes:
        gain: On the commanded velocities, shape (N,).
    """

    def __init__(
        self, problem: ArmProblem, num_envs: int, rng: np.random.Generator, nthread: int
    ) -> None:
        self.gain: Array = np.full(num_envs, problem.settings.curriculum.gain(0))
        self._problem = problem
        self._rng = rng
        self._batch = HybridBatch(problem.model, num_envs, nthread=nthread)
        members = problem.ensemble
        self._ensemble = ForceEnsemble(members, problem.model, num_envs) if members else None
        self._learner_steps = 0
        self._misread: Array = np.zeros((num_envs, self._joints))

    @property
    def qpos(self) -> Array:
        """Live positions, as encoders tell them, shape (N, nq)."""
        return self._batch.qpos

    @property
    def placed(self) -> Array:
        """Positions at which the nominal arm stands where this one does, shape (N, nq).

        Encoders of drawn models may count from elsewhere than those of the nominal one.
        """
        qpos = self.qpos.copy()
        qpos[:, self._problem.model.layout.qpos] -= self._misread
        return qpos

    @property
    def qvel(self) -> Array:
        """Live velocities, shape (N, nv)."""
        return self._batch.qvel

    def set_progress(self, learner_steps: int) -> None:
        """Notes how far learning is; episodes that begin from now on are of that stage."""
        self._learner_steps = learner_steps

    def gauges(self) -> Mapping[str, float]:
        """Returns what a status should tell."""
        return {"curriculum_gain": float(self.gain.mean())}

    def reset(self, ids: NDArray[np.intp], qpos: Array) -> None:
        """Starts the instances `ids` at rest in positions (n, nq), each on a model of its own."""
        problem = self._problem
        chosen = self._rng.integers(len(problem.variants), size=len(ids))
        rest = np.zeros((len(ids), self.qvel.shape[1]))
        models = [problem.variants[i] for i in chosen]
        own = [model.qpos0[problem.model.layout.qpos] for model in models]
        self._misread[ids] = np.array(own) - problem.zero
        self._batch.reset(ids, models, qpos, rest, np.zeros((len(ids), self._joints)))
        if self._ensemble is not None:
            self._ensemble.reset(ids, models, qpos, rest, self._rng)
        self.gain[ids] = problem.settings.curriculum.gain(self._learner_steps)

    def step(self, action: Array32) -> NDArray[np.bool_]:
        """Holds commands for one control period; returns which simulations diverged, shape (N,).

        Args:
            action: Joint velocities in units of their limits, in [-1, 1], shape (N, J).
        """
        command = action * self._problem.velocity_limit * self.gain[:, None]
        random = self._random_forces()
        diverged = np.zeros(len(self.gain), bool)
        for _ in range(self._problem.repeats):
            diverged |= self._batch.step(command, random + self._learned_forces(command))
        return diverged

    def _random_forces(self) -> Array:
        limit = self._problem.model.force_limit
        share = self._problem.settings.perturbation
        if share == 0.0:
            return np.zeros((len(self.gain), len(limit)))
        return share * limit * self._rng.uniform(-1.0, 1.0, size=(len(self.gain), len(limit)))

    def _learned_forces(self, command: Array) -> Array | float:
        if self._ensemble is None:
            return 0.0
        return self._ensemble.forces(self.qpos, self.qvel, command)

    @property
    def _joints(self) -> int:
        return len(self._problem.model.layout.joint_names)
