"""A law bent: its amount changes with the position and the speed of its joint.

The amount of a law that holds is the same in every state. One that only comes near to what acts
leaves what a bent law does: friction with the root of the speed is too weak at low speed and too
strong at high speed as a viscous one (a varying-coefficient model; Hastie and Tibshirani 1993).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.polynomial.legendre import legval
from typing_extensions import override

from gfm.core.checks import Array
from gfm.effects import Effect, EffectInstance, Scope
from gfm.effects.effect import Motion, Parameter, ProbeGroup, Scales, Values
from gfm.signals.torques import has_law

#: Degree of the polynomials by which an amount changes, over what most of the time is between.
DEGREE, MOSTLY = 3, (2.0, 98.0)
#: How far beyond that they go on, in half ranges: polynomials run away.
BEYOND = 1.2
#: By what share of itself a law is bent to see what that does.
SLIGHTLY = 0.02


@final
class BentLaw(Effect):
    """torque(q, v) * (sum_k position_k P_k(q) + sum_k speed_k P_k(|v|)), Legendre polynomials P."""

    name = "bent_law"
    native = False
    stepwise = True
    parameters = tuple(
        Parameter(name=f"{of}_{k}", unit="1", lower=-1.0, upper=1.0)
        for of in ("position", "speed")
        for k in range(1, DEGREE + 1)
    )
    shown_by = "all positions at all speeds"

    def __init__(self, law: Sequence[EffectInstance], position: Array, speed: Array) -> None:
        """Bends effects together.

        Args:
            law: Of one joint, with their amounts.
            position: Where the joint was, rad or m, shape (M,).
            speed: How fast it moved there, shape (M,).
        """
        self._law = tuple(law)
        self._spans = np.percentile(position, MOSTLY), np.percentile(np.abs(speed), MOSTLY)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return ()

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        whole = sum(np.asarray(one.effect.torque(motion, one.values)) for one in self._law)
        states = motion.position, np.abs(motion.velocity)
        amounts = np.array([values[p.name] for p in self.parameters]).reshape(2, DEGREE, -1)
        bend = sum(_series(*one) for one in zip(states, self._spans, amounts, strict=True))
        return np.asarray(whole * bend)


def _series(state: Array, span: Array, amounts: Array) -> Array:
    """Returns the sum of polynomials from the first degree on at states of shape (N,)."""
    low, high = span
    place = (2.0 * state - low - high) / max(high - low, 1e-9)
    coefficients = np.concatenate([np.zeros((1, amounts.shape[1])), amounts])
    return np.asarray(legval(np.clip(place, -BEYOND, BEYOND), coefficients, tensor=False))


def can_bend(instance: EffectInstance) -> bool:
    """Returns whether an effect is a torque of the state of one joint."""
    return instance.effect.scope is Scope.JOINT and has_law(instance)


def bent(law: Sequence[EffectInstance], position: Array, speed: Array) -> list[EffectInstance]:
    """Returns a law not bent, and bent a little in each of the K ways: by `SLIGHTLY`.

    Args:
        law: Effects on one joint, of which `can_bend` holds.
        position: Where the joint was, rad or m, shape (M,).
        speed: How fast it moved there, shape (M,).
    """
    effect, names = BentLaw(law, position, speed), [p.name for p in BentLaw.parameters]
    ways = np.concatenate([np.zeros((1, len(names))), SLIGHTLY * np.eye(len(names))])
    return [
        EffectInstance(
            effect=effect, joints=law[0].joints, values=dict(zip(names, way, strict=True))
        )
        for way in ways.tolist()
    ]
