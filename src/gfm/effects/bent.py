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
    Effect,
    EffectInstance,
    Motion,
    Parameter,
    ProbeGroup,
    Scales,
    Scope,
    Values,
)
from gfm.effects.of_state import OfPosition, OfSpeed

#: Degree of the polynomials by which an amount changes, over what most of the time is between.
DEGREE, MOSTLY = 3, (2.0, 98.0)
#: How far beyond that they go on, in half ranges: polynomials run away.
BEYOND = 1.2
#: By what share of itself a law is bent to see what that does, and at most.
SLIGHTLY, MOST = 0.02, 10.0


class BentLaw(Effect):
    """torque(q, v) * sum_k amount_k P_k(state), Legendre polynomials P of one state of a joint."""

    native = False
    stepwise = True
    parameters = tuple(
        Parameter(name=f"degree_{k}", unit="1", lower=-MOST, upper=MOST)
        for k in range(1, DEGREE + 1)
    )
    shown_by = "all positions at all speeds"

    def __init__(self, law: Sequence[EffectInstance], states: Array) -> None:
        """Bends effects together.

        Args:
            law: Of one joint, with their amounts.
            states: In which that joint was, see `state`, shape (M,).
        """
        self._law = tuple(law)
        self._span = np.percentile(states, MOSTLY)

    @staticmethod
    @abstractmethod
    def state(position: Array, velocity: Array) -> Array:
        """Returns with which state amounts change, shape (N,), at positions and velocities."""

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return ()

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        whole = sum(np.asarray(one.effect.torque(motion, one.values)) for one in self._law)
        amounts = np.array([values[p.name] for p in self.parameters]).reshape(DEGREE, -1)
        bend = _series(self.state(motion.position, motion.velocity), self._span, amounts)
        return np.asarray(whole * bend)


@final
class BentByPosition(OfPosition, BentLaw):
    """A law whose amount changes along the way."""

    name = "bent_by_position"


@final
class BentBySpeed(OfSpeed, BentLaw):
    """A law whose amount changes with the speed."""

    name = "bent_by_speed"


#: How a law of one state of its joint is bent.
BENT_BY: Mapping[str | None, type[BentLaw]] = {"position": BentByPosition, "velocity": BentBySpeed}


def _series(state: Array, span: Array, amounts: Array) -> Array:
    """Returns the sum of polynomials from the first degree on at states of shape (N,)."""
    low, high = span
    place = (2.0 * state - low - high) / max(high - low, 1e-9)
    coefficients = np.concatenate([np.zeros((1, amounts.shape[1])), amounts])
    return np.asarray(legval(np.clip(place, -BEYOND, BEYOND), coefficients, tensor=False))


def can_bend(instance: EffectInstance) -> bool:
    """Returns whether an effect is a torque of the state of one joint."""
    return instance.effect.scope is Scope.JOINT and instance.has_law


def bent(
    how: type[BentLaw], law: Sequence[EffectInstance], position: Array, velocity: Array
) -> EffectInstance:
    """Returns what bends a law, by nothing so far.

    Args:
        how: By which state of its joint.
        law: Effects on one joint, of which `can_bend` holds.
        position: Where the joint was, rad or m, shape (M,).
        velocity: How fast it moved there, shape (M,).
    """
    effect = how(law, how.state(position, velocity))
    nothing = {p.name: 0.0 for p in effect.parameters}
    return EffectInstance(effect=effect, joints=law[0].joints, values=nothing)


def slightly(straight: EffectInstance) -> list[EffectInstance]:
    """Returns what bends a law, bent a little in each of its ways: by `SLIGHTLY`."""
    return [
        replace(straight, values={**straight.values, name: SLIGHTLY}) for name in straight.values
    ]
