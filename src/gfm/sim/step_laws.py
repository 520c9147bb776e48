"""Laws that MuJoCo cannot express: dry friction whose level depends on the state, and other forces.

To MuJoCo the level is a constant of the joint. Whoever simulates (predictions of recordings, hybrid
stepping, inverse dynamics along a recording) asks here what to write over it, and which forces to
apply, before every step.

Shape letters: N simulations, J joints, M sensor data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import cast, final

import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from gfm.core import UnknownNameError
from gfm.core.checks import Array
from gfm.effects import Effect, EffectInstance, Motion, Values

#: A joint at rest that nothing drives.
_STILL = Motion(
    position=np.zeros(1), velocity=np.zeros(1), drive=np.zeros(1), other_velocity=np.zeros(1)
)


def acts_at_every_step(instance: EffectInstance) -> bool:
    """Returns whether an effect's friction or force has to be evaluated at every step."""
    values = {name: np.array([value]) for name, value in instance.values.items()}
    effect = instance.effect
    told = (effect.extra_friction(_STILL, values), effect.drive_change(_STILL, values))
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

    def apply(self, force: Array) -> Moment:
        """Adds the laws' forces of the coming step to those that act; returns its middle.

        Args:
            force: What else acts, N m, shape (N, nv).
        """
        # What diverged was put back, and has no step before.
        self._applied[:] = force + np.nan_to_num(self._forces, posinf=0.0, neginf=0.0)
        now = self._middle()
        self._forces = self._laws.forces(now)
        self._applied[:] = force + self._forces
        return now

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

    @property
    def change_drives(self) -> bool:
        """Whether a law changes what drives give."""
        changes = (law.effect.drive_change(_STILL, law.values) for law in self.laws)
        return any(change is not None for change in changes)

    def levels(self, constant: Array, now: Moment) -> Array:
        """Returns the levels of dry friction for the coming step, N m, shape (N, nv).

        Args:
            constant: What the models have, N m, shape (N, nv).
            now: In the middle of the step.
        """
        level = constant.copy()
        for law, motion in zip(self.laws, self._motions(self.laws, now), strict=True):
            extra = law.effect.extra_friction(motion, law.values)
            level[:, self.dof[law.joints[0]]] += 0.0 if extra is None else extra
        return level

    def forces(self, now: Moment) -> Array:
        """Returns the generalized forces to be applied in the coming step, N m, shape (N, nv)."""
        force = np.zeros_like(now.qvel)
        force[:, self.drive_dof] += self.drive_changes(now)
        laws = [law for law in self.laws if law.effect.stepwise]
        for law, motion in zip(laws, self._motions(laws, now), strict=True):
            # A stepwise law takes its amounts in all simulations at once.
            torque = law.effect.torque(motion, cast("Values", law.values))
            if torque is not None:
                force[:, self.dof[law.joints[0]]] += torque
                for other in law.joints[1:]:
                    force[:, self.dof[other]] -= torque
        return force

    def drive_changes(self, now: Moment) -> Array:
        """Returns what the drives give beside their models' torques, N m, shape (N, J)."""
        drive = np.asarray(now.sensordata) @ self.drive.T
        changes = np.zeros_like(drive)
        for law, motion in zip(self.laws, self._seen(self.laws, now, drive), strict=True):
            change = law.effect.drive_change(motion, law.values)
            changes[:, law.joints[0]] += 0.0 if change is None else change
        return changes

    def _motions(self, laws: Sequence[StepLaw], now: Moment) -> list[Motion]:
        """Returns what each law sees, of the drives what they give."""
        if not laws:
            return []
        drive = np.asarray(now.sensordata) @ self.drive.T
        return self._seen(laws, now, drive + self.drive_changes(now))

    def _seen(self, laws: Sequence[StepLaw], now: Moment, drive: Array) -> list[Motion]:
        velocity = now.qvel[:, self.dof]
        return [
            Motion(
                position=now.qpos[:, self.qpos[law.joints[0]]],
                velocity=velocity[:, law.joints[0]],
                drive=drive[:, law.joints[0]],
                other_velocity=velocity[:, law.joints[1]] if len(law.joints) == 2 else None,
            )
            for law in laws
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
