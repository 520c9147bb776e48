"""Laws that MuJoCo cannot express: dry friction whose level depends on the state, and other forces.

To MuJoCo the level is a constant of the joint. Whoever simulates (predictions of recordings, hybrid
stepping, inverse dynamics along a recording) asks here what to write over it, and which forces to
apply, before every step.

Shape letters: N simulations, J joints, M sensor data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast, final

import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from gfm.core import UnknownNameError
from gfm.core.checks import Array
from gfm.effects import Effect, EffectInstance, Motion, Values
from gfm.effects.effect import AT_REST


def acts_at_every_step(instance: EffectInstance) -> bool:
    """Returns whether an effect's friction or force has to be evaluated at every step."""
    values = {name: np.array([value]) for name, value in instance.values.items()}
    effect = instance.effect
    told = (effect.extra_friction(AT_REST, values), effect.drive_change(AT_REST, values))
    return effect.stepwise or any(one is not None for one in told)


@dataclass(frozen=True, kw_only=True)
class StepLaw:
    """One effect in every simulation.

    Attributes:
        effect: The law.
        joints: Indices of the joints that it acts on: one, or two.
        values: Each parameter, shape (N,).
    """

    effect: Effect
    joints: tuple[int, ...]
    values: Mapping[str, Array]


@dataclass(frozen=True, kw_only=True)
class Moment:
    """Many simulations in the middle of a step.

    Attributes:
        qpos: shape (N, nq).
        qvel: shape (N, nv).
        sensordata: shape (N, M).
    """

    qpos: Array
    qvel: Array
    sensordata: Array


@dataclass(frozen=True, kw_only=True)
class Acting:
    """What laws do in a step.

    Attributes:
        force: Generalized forces to apply, N m, shape (N, nv).
        friction: What the levels of dry friction are beside the models' own, N m, shape (N, nv).
    """

    force: Array
    friction: Array


@final
class LawsAtWork:
    """Laws in the simulations of a batch, before each of their steps.

    What holds for a whole step is taken from its middle: from its beginning, friction that changes
    with speed comes late, and looks like another, and what is taken off a servo leaves what the
    servo gives anew within the step, which damps.
    """

    def __init__(self, simulations: batch.Batch, laws: StepLaws, step_s: float) -> None:
        self._batch, self._laws, self._half_s = simulations, laws, 0.5 * step_s
        self._qpos: Array = simulations.bind("qpos")
        self._qvel: Array = simulations.bind("qvel")
        self._qacc: Array = simulations.bind("qacc")
        self._sensordata: Array = simulations.bind("sensordata")
        self._applied: Array = simulations.bind("qfrc_applied")
        self._forces: Array = np.zeros_like(self._applied)

    def begin_anew(self, ids: NDArray[np.intp]) -> None:
        """Forgets the last step of some simulations."""
        self._forces[ids] = 0.0

    def apply(self, force: Array) -> Acting:
        """Adds the laws' forces of the coming step to those that act; returns what laws do in it.

        Args:
            force: What else acts, N m, shape (N, nv).
        """
        self._applied[:] = force + self._forces
        acting = self._laws.acting(self._middle())
        self._applied[:] = force + acting.force
        self._forces = acting.force
        if not np.isfinite(acting.force).all():  # what diverged is put back: no step was before
            self._forces = np.nan_to_num(acting.force, posinf=0.0, neginf=0.0)
        return acting

    def _middle(self) -> Moment:
        """Returns the simulations half a step on, under its commands; they stay where they are."""
        self._batch.forward()
        qpos, qvel = self._qpos.copy(), self._qvel.copy()
        ahead, speed = qpos.copy(), qvel + self._half_s * self._qacc
        ahead[:, self._laws.qpos] += self._half_s * qvel[:, self._laws.dof]
        if self._laws.change_drives:
            self._qpos[:], self._qvel[:] = ahead, speed
            self._batch.forward()
            self._qpos[:], self._qvel[:] = qpos, qvel
        return Moment(qpos=ahead, qvel=speed, sensordata=self._sensordata.copy())


@dataclass(frozen=True, kw_only=True, eq=False)
class StepLaws:
    """All of them; make it with `step_laws`.

    Attributes:
        laws: At least one.
        qpos: Of the joints in qpos, shape (J,).
        dof: Of the joints in qvel, shape (J,).
        drive: From sensor data to the drive torque of each joint, shape (J, M).
        drive_dof: Where the drives act in qvel, shape (J,).
    """

    laws: tuple[StepLaw, ...]
    qpos: NDArray[np.intp]
    dof: NDArray[np.intp]
    drive: Array
    drive_dof: NDArray[np.intp]

    @cached_property
    def change_drives(self) -> bool:
        """Whether a law changes what drives give."""
        changes = (law.effect.drive_change(AT_REST, law.values) for law in self.laws)
        return any(change is not None for change in changes)

    def acting(self, now: Moment) -> Acting:
        """Returns what the laws do in the coming step, told of its middle."""
        drive = np.asarray(now.sensordata) @ self.drive.T
        force, friction = np.zeros_like(now.qvel), np.zeros_like(now.qvel)
        if self.change_drives:
            changes = self._changes(now, drive)
            force[:, self.drive_dof] += changes
            drive += changes
        for law, motion in zip(self.laws, self._seen(now, drive), strict=True):
            first = self.dof[law.joints[0]]
            extra = law.effect.extra_friction(motion, law.values)
            if extra is not None:
                friction[:, first] += extra
            # A stepwise law takes its amounts in all simulations at once.
            stepwise = law.effect.stepwise
            torque = law.effect.torque(motion, cast("Values", law.values)) if stepwise else None
            if torque is not None:
                force[:, first] += torque
                for other in law.joints[1:]:
                    force[:, self.dof[other]] -= torque
        return Acting(force=force, friction=friction)

    def drive_changes(self, now: Moment) -> Array:
        """Returns what the drives give beside their models' torques, N m, shape (N, J)."""
        return self._changes(now, np.asarray(now.sensordata) @ self.drive.T)

    def _changes(self, now: Moment, drive: Array) -> Array:
        changes = np.zeros_like(drive)
        for law, motion in zip(self.laws, self._seen(now, drive), strict=True):
            change = law.effect.drive_change(motion, law.values)
            if change is not None:
                changes[:, law.joints[0]] += change
        return changes

    def _seen(self, now: Moment, drive: Array) -> list[Motion]:
        """Returns what each law sees, drives giving torques of shape (N, J)."""
        position, velocity = now.qpos[:, self.qpos], now.qvel[:, self.dof]
        return [
            Motion(
                position=position[:, law.joints[0]],
                velocity=velocity[:, law.joints[0]],
                drive=drive[:, law.joints[0]],
                other_velocity=velocity[:, law.joints[1]] if len(law.joints) == 2 else None,
            )
            for law in self.laws
        ]


def step_laws(
    effects: Sequence[Sequence[EffectInstance]],
    joints: Sequence[str],
    places: tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]],
    drive: Array,
) -> StepLaws | None:
    """Returns the laws among the effects of N simulations; None where there are none.

    Args:
        effects: Of each simulation: the same ones in the same places and order, in other amounts.
        joints: Their names.
        places: Of the joints in qpos and in qvel, and of their drives in qvel, shape (J,) each.
        drive: From sensor data to the drive torque of each joint, shape (J, M).

    Raises:
        UnknownNameError: an effect acts on a joint that is not one of `joints`.
    """
    columns = zip(*([e for e in own if acts_at_every_step(e)] for own in effects), strict=True)
    laws = tuple(_law(column, joints) for column in columns)
    if not laws:
        return None
    qpos, dof, drive_dof = places
    return StepLaws(laws=laws, qpos=qpos, dof=dof, drive=drive, drive_dof=drive_dof)


def _law(column: Sequence[EffectInstance], joints: Sequence[str]) -> StepLaw:
    first = column[0]
    for name in first.joints:
        if name not in joints:
            raise UnknownNameError(f"joint of {first.effect.name}", name, joints)
    return StepLaw(
        effect=first.effect,
        joints=tuple(list(joints).index(name) for name in first.joints),
        values={name: np.array([e.values[name] for e in column]) for name in first.values},
    )
