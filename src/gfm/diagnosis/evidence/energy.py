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

import mujoco
import numpy as np

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.evidence.torques import TorqueDomain
from gfm.diagnosis.search.candidates import TorqueView
from gfm.diagnosis.search.nominal_parameters import covers
from gfm.effects import EffectInstance
from gfm.effects.effect import sign
from gfm.effects.friction import SIGN_WIDTH_RAD_S
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
class Dissipation:
    """Mean power that one named effect takes out of the robot, W; negative if it puts in."""

    effect: str
    joints: tuple[str, ...]
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


@dataclass(frozen=True, kw_only=True)
class _Work:
    """Energies of one recording, J."""

    drive: float
    through: float
    stored: float
    dissipated: float
    duration_s: float

    @property
    def missing(self) -> float:
        return self.drive - self.stored - self.dissipated


def energy_balance(domain: TorqueDomain, effects: Sequence[EffectInstance]) -> EnergyBalance:
    """Returns the balance under the nominal model and with `effects`."""
    spec = next(iter(domain.specs.values()))
    before, after = (_works(domain, chosen) for chosen in ((), domain.in_model(effects)))
    duration_s = sum(one.duration_s for one in before)
    named = tuple(
        Dissipation(
            effect=e.effect.name,
            joints=e.joints,
            power_w=-_work(domain, law) / duration_s,
            only_takes=e.effect.name in DISSIPATIVE and not covers(spec, e),
        )
        for e in effects
        if (law := domain.law(e)) is not None
    )
    missing = sum(one.missing for one in after) / duration_s
    return EnergyBalance(
        drive_w=sum(one.drive for one in after) / duration_s,
        through_w=sum(one.through for one in after) / duration_s,
        stored_w=sum(one.stored for one in after) / duration_s,
        dissipated_w=sum(one.dissipated for one in after) / duration_s,
        missing_w=sum(one.missing for one in before) / duration_s,
        named=named,
        unexplained_w=missing - sum(one.power_w for one in named),
    )


def _work(domain: TorqueDomain, law: Sequence[Array]) -> float:
    """Returns the work of torques (T, J) along the recordings, J."""
    return sum(
        _integral(recording, torque * view.velocity)
        for recording, torque, view in zip(domain.recordings, law, domain.views, strict=True)
    )


def _works(domain: TorqueDomain, effects: Sequence[EffectInstance]) -> list[_Work]:
    plants = domain.plants(effects)
    return [
        _recording_work(plants[recording.command_kind], recording, view)
        for recording, view in zip(domain.recordings, domain.views_with(effects), strict=True)
    ]


def _recording_work(plant: Plant, recording: Trajectory, view: TorqueView) -> _Work:
    """Returns one recording's energies under a plant, by its positions and velocities."""
    passive = _along(plant, view)
    power = view.drive * view.velocity
    return _Work(
        drive=_integral(recording, power),
        through=_integral(recording, np.abs(power)),
        stored=passive.stored - _integral(recording, passive.holding * view.velocity),
        dissipated=-_integral(recording, passive.damping * view.velocity),
        duration_s=recording.duration_s,
    )


@dataclass(frozen=True, kw_only=True)
class _Passive:
    """What a model does by itself: energy gained, J, and torques on the joints, (T, J) each."""

    stored: float
    damping: Array
    holding: Array


def _along(plant: Plant, view: TorqueView) -> _Passive:
    """Returns what the model does by itself along a motion; it holds what cancels its weight."""
    model, data = plant.model, mujoco.MjData(plant.model)
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    damping, holding = np.empty_like(view.position), np.empty_like(view.position)
    energy = np.empty(len(view.position))
    for i, (q, v) in enumerate(zip(view.position, view.velocity, strict=True)):
        data.qpos[plant.qpos], data.qvel[plant.dof] = q, v
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_energyPos(model, data)
        mujoco.mj_energyVel(model, data)
        energy[i] = data.energy.sum()
        other = data.qfrc_passive - data.qfrc_spring - data.qfrc_damper
        damping[i], holding[i] = data.qfrc_damper[plant.dof], other[plant.dof]
    dry = model.dof_frictionloss[plant.dof] * sign(view.velocity, SIGN_WIDTH_RAD_S)
    return _Passive(stored=float(energy[-1] - energy[0]), damping=damping - dry, holding=holding)


def _integral(recording: Trajectory, power: Array) -> float:
    """Returns the integral over time of what all joints sum up to, shape (T, J)."""
    return float(np.trapezoid(power.sum(axis=1), recording.time_s))
