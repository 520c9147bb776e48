"""Dry friction whose level depends on the state.

To MuJoCo the level is a constant of the joint. Whoever simulates (predictions of recordings, hybrid
stepping, inverse dynamics along a recording) asks here what to write over it before every step.

Shape letters: N simulations, J joints, M sensor data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core import UnknownNameError
from gfm.core.checks import Array
from gfm.effects import Effect, EffectInstance


def adds_friction(instance: EffectInstance) -> bool:
    """Returns whether an effect's dry friction has to be evaluated at every step."""
    still = np.zeros(1)
    values = {name: np.array([value]) for name, value in instance.values.items()}
    return instance.effect.extra_friction(still, still, values) is not None


@dataclass(frozen=True, kw_only=True)
class FrictionLaw:
    """One effect in every simulation.

    Attributes:
        effect: The law.
        joint: Index of the joint that it acts on.
        values: Each parameter, shape (N,).
    """

    effect: Effect
    joint: int
    values: Mapping[str, Array]


@dataclass(frozen=True, kw_only=True, eq=False)
class StepLaws:
    """All of them; make it with `step_laws`.

    Attributes:
        laws: At least one.
        dof: Of the joints in qvel, shape (J,).
        drive: From sensor data to the drive torque of each joint, shape (J, M).
    """

    laws: tuple[FrictionLaw, ...]
    dof: NDArray[np.intp]
    drive: Array

    def levels(self, constant: Array, qvel: Array, sensordata: Array) -> Array:
        """Returns the levels of dry friction for the coming step, N m, shape (N, nv).

        Args:
            constant: What the models have, N m, shape (N, nv).
            qvel: rad/s, shape (N, nv).
            sensordata: shape (N, M).
        """
        drive = np.asarray(sensordata) @ self.drive.T
        level = constant.copy()
        for law in self.laws:
            dof = self.dof[law.joint]
            extra = law.effect.extra_friction(qvel[:, dof], drive[:, law.joint], law.values)
            level[:, dof] += 0.0 if extra is None else extra
        return level


def step_laws(
    effects: Sequence[Sequence[EffectInstance]],
    joints: Sequence[str],
    dof: NDArray[np.intp],
    drive: Array,
) -> StepLaws | None:
    """Returns the laws among the effects of N simulations; None where there are none.

    Args:
        effects: Of each simulation: the same ones in the same places and order, in other amounts.
        joints: Their names.
        dof: Of the joints in qvel, shape (J,).
        drive: From sensor data to the drive torque of each joint, shape (J, M).

    Raises:
        UnknownNameError: an effect acts on a joint that is not one of `joints`.
    """
    columns = zip(*([e for e in own if adds_friction(e)] for own in effects), strict=True)
    laws = tuple(_law(column, joints) for column in columns)
    return StepLaws(laws=laws, dof=dof, drive=drive) if laws else None


def _law(column: Sequence[EffectInstance], joints: Sequence[str]) -> FrictionLaw:
    first = column[0]
    if first.joints[0] not in joints:
        raise UnknownNameError(f"joint of {first.effect.name}", first.joints[0], joints)
    return FrictionLaw(
        effect=first.effect,
        joint=list(joints).index(first.joints[0]),
        values={name: np.array([e.values[name] for e in column]) for name in first.values},
    )
