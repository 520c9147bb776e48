"""Energy balance: does what the drives put in come out again, stored or dissipated by a name?

Over whole recordings the work of the drives is the change of kinetic and potential energy plus what
is dissipated. Energies need positions and velocities only, no accelerations and no rollouts; a fit
that is wrong in a way that rollouts hide (a clock, a friction that stands for a delay) dissipates
many times what went in.

Shape letters: T measurements of a recording, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.effects import EffectInstance, Placed
from gfm.effects.effect import sign
from gfm.effects.friction import SIGN_WIDTH_RAD_S
from gfm.effects.nominal_parameters import covers
from gfm.signals.torque_domain import TorqueDomain, without_law
from gfm.sim.kinematics import along
from gfm.sim.plant import Plant

#: Effects that can only dissipate.
DISSIPATIVE = (
    "coulomb_friction",
    "viscous_friction",
    "quadratic_drag",
    "stribeck_friction",
    "load_dependent_friction",
    "coupled_friction",
)
#: Share of the power that goes through the drives up to which a balance is even: smoothing
#: velocities and measuring torques errs by some percent.
EVEN = 0.1


@dataclass(frozen=True, kw_only=True)
class Dissipation(Placed):
    """Mean power that one named effect takes out of the robot, W; negative if it puts in."""

    power_w: float
    only_takes: bool

    @property
    def possible(self) -> bool:
        """Whether it does what such an effect can."""
        return self.power_w >= 0.0 or not self.only_takes


@dataclass(frozen=True, kw_only=True)
class EnergyBalance:
    """Mean powers over the held-out recordings, W.

    Attributes:
        drive_w: Net power of the drives.
        through_w: Mean of its absolute value: what goes in and out.
        stored_w: Kinetic and potential energy gained, of the corrected model.
        dissipated_w: By damping and friction that the nominal model has.
        missing_w: What goes missing under the nominal model.
        named: What each named effect takes of it.
        unexplained_w: What is still missing.
    """

    drive_w: float
    through_w: float
    stored_w: float
    dissipated_w: float
    missing_w: float
    named: tuple[Dissipation, ...]
    unexplained_w: float

    @property
    def share(self) -> float:
        """Unexplained power as a share of what goes through the drives."""
        return abs(self.unexplained_w) / self.through_w if self.through_w > 0.0 else 0.0

    @property
    def even(self) -> bool:
        """Whether little is unexplained, and nothing dissipates less than nothing."""
        return self.share <= EVEN and all(one.possible for one in self.named)


def energy_balance(domain: TorqueDomain, effects: Sequence[EffectInstance]) -> EnergyBalance:
    """Returns the balance under the nominal model and with `effects`."""
    view, spec = domain.view, next(iter(domain.problem.specs.values()))
    named = tuple(
        Dissipation(
            *e.key,
            power_w=-_mean_power(domain, view.law(e) * view.velocity),
            only_takes=e.effect.name in DISSIPATIVE and not covers(spec, e),
        )
        for e in effects
        if e.has_law
    )
    before, _, gained, lost = _powers(domain, ())
    drive, through, stored, dissipated = _powers(domain, without_law(effects))
    return EnergyBalance(
        drive_w=drive,
        through_w=through,
        stored_w=stored,
        dissipated_w=dissipated,
        missing_w=before - gained - lost,
        named=named,
        unexplained_w=drive - stored - dissipated - sum(one.power_w for one in named),
    )


def _powers(domain: TorqueDomain, effects: Sequence[EffectInstance]) -> list[float]:
    """Returns mean powers with `effects` in the model, W: as of `_works`."""
    plants, view = domain.problem.plants(effects), domain.view_with(effects)
    motion = np.stack([view.position, view.velocity, view.drive], axis=1)
    works = [_works(plants[one.command_kind], one, own) for one, own in domain.of_each(motion)]
    return [sum(work) / domain.duration_s for work in zip(*works, strict=True)]


def _works(plant: Plant, recording: Trajectory, motion: Array) -> tuple[float, ...]:
    """Returns what the drives do along a recording, what goes through them, is stored, and lost, J.

    What cancels the weight of a part stores energy as a spring does. A motion is position, velocity
    and drive, shape (T, 3, J).
    """
    position, velocity, drive = np.moveaxis(motion, 1, 0)
    damping, holding = np.empty_like(position), np.empty_like(position)
    energy = np.empty(len(position))
    for i, data in enumerate(along(plant, position, velocity)):
        other = data.qfrc_passive - data.qfrc_spring - data.qfrc_damper
        damping[i], holding[i] = data.qfrc_damper[plant.dof], other[plant.dof]
        energy[i] = data.energy.sum()
    damping -= plant.model.dof_frictionloss[plant.dof] * sign(velocity, SIGN_WIDTH_RAD_S)
    put_in, held, damped = (_work(recording, t * velocity) for t in (drive, holding, damping))
    through = _work(recording, np.abs(drive * velocity))
    return put_in, through, float(energy[-1] - energy[0]) - held, -damped


def _mean_power(domain: TorqueDomain, power: Array) -> float:
    """Returns the mean of powers at all measurements, shape (T of all, J), W."""
    return sum(_work(one, own) for one, own in domain.of_each(power)) / domain.duration_s


def _work(recording: Trajectory, power: Array) -> float:
    """Returns the integral over time of what all joints sum up to, shape (T, J)."""
    return float(np.trapezoid(power.sum(axis=1), recording.time_s))
