"""A law bent: its amount changes with the position or the speed of its joint.

The amount of a law that holds is the same in every state. One that only comes near to what acts
leaves what a bent law does: friction with the root of the speed is too weak at low speed and too
strong at high speed as a viscous one (a varying-coefficient model; Hastie and Tibshirani 1993).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import final

import numpy as np
from numpy.polynomial.legendre import legval
from typing_extensions import override

from gfm.core.checks import Array
from gfm.effects.effect import (
    DRIVE,
    Effect,
    EffectInstance,
    Motion,
    Parameter,
    ProbeGroup,
    Scales,
    Scope,
    Values,
)
from gfm.effects.of_state import OfDrive, OfPosition, OfSpeed

#: Degree of the polynomials by which an amount changes, over what most of the time is between.
DEGREE, MOSTLY = 3, (2.0, 98.0)
#: How far beyond that they go on, in half ranges: polynomials run away.
BEYOND = 1.2
#: By what share of itself a law is bent to see what that does, and at most.
SLIGHTLY, MOST = 0.02, 10.0


class BentLaw(Effect):
    """Something that a joint feels, times sum_k amount_k P_k(state), Legendre polynomials P."""

    native = False
    parameters = tuple(
        Parameter(name=f"degree_{k}", unit="1", lower=-MOST, upper=MOST)
        for k in range(1, DEGREE + 1)
    )
    shown_by = "all positions at all speeds"

    def __init__(self, law: Sequence[EffectInstance], motion: Motion) -> None:
        """Bends effects together.

        Args:
            law: Of one joint, with their amounts.
            motion: Of that joint: in these states.
        """
        self._law = tuple(law)
        self._span = np.percentile(self.state(motion), MOSTLY)

    @staticmethod
    @abstractmethod
    def state(motion: Motion) -> Array:
        """Returns with which state amounts change, shape (N,)."""

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return ()

    def bend(self, motion: Motion, values: Mapping[str, Array] | Values) -> Array:
        """Returns by what share of itself a law changes, shape (N,)."""
        amounts = np.array([values[p.name] for p in self.parameters]).reshape(DEGREE, -1)
        return _series(self.state(motion), self._span, amounts)


class BentTorque(BentLaw):
    """A torque that changes with a state of its joint."""

    stepwise = True

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        whole = sum(np.asarray(one.effect.torque(motion, one.values)) for one in self._law)
        return np.asarray(whole * self.bend(motion, values))


@final
class BentByPosition(OfPosition, BentTorque):
    """A torque that changes along the way."""

    name = "bent_by_position"


@final
class BentBySpeed(OfSpeed, BentTorque):
    """A torque that changes with the speed."""

    name = "bent_by_speed"


@final
class BentByDrive(OfDrive, BentLaw):
    """A drive whose gain changes with the torque that it should give."""

    name = "bent_by_drive"

    @override
    def drive_change(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        return motion.drive * self.bend(motion, values)


def _series(state: Array, span: Array, amounts: Array) -> Array:
    """Returns the sum of polynomials from the first degree on at states of shape (N,)."""
    low, high = span
    place = (2.0 * state - low - high) / max(high - low, 1e-9)
    coefficients = np.concatenate([np.zeros((1, amounts.shape[1])), amounts])
    return np.asarray(legval(np.clip(place, -BEYOND, BEYOND), coefficients, tensor=False))


def ways_to_bend(instance: EffectInstance) -> Mapping[str, type[BentLaw]]:
    """Returns how an effect may change with states of its joint; nothing where it is no law."""
    if instance.effect.scope is not Scope.JOINT:
        return {}
    if instance.has_law:
        return {"position": BentByPosition, "velocity": BentBySpeed}
    return {DRIVE: BentByDrive} if instance.effect.law_of == DRIVE else {}


def bent(law: Sequence[EffectInstance], motion: Motion) -> dict[str, EffectInstance]:
    """Returns what bends a law, by nothing so far, by each state with which it may change.

    Args:
        law: Effects on one joint that are laws of one state; those that can bend do so together.
        motion: Of that joint.
    """
    able = [one for one in law if ways_to_bend(one)]
    told = {}
    for state, how in (ways_to_bend(able[0]) if able else {}).items():
        effect = how(able, motion)
        nothing = {p.name: 0.0 for p in effect.parameters}
        told[state] = EffectInstance(effect=effect, joints=law[0].joints, values=nothing)
    return told


def slightly(straight: EffectInstance) -> list[EffectInstance]:
    """Returns what bends a law, bent a little in each of its ways: by `SLIGHTLY`."""
    return [
        replace(straight, values={**straight.values, name: SLIGHTLY}) for name in straight.values
    ]
