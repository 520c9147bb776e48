"""A law without a name: any torque over a state of its joint, its position, speed or drive."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from typing_extensions import override

from gfm.core.checks import Array
from gfm.effects.effect import DRIVE, Effect, Motion, Parameter, ProbeGroup, Scales, Values, sign
from gfm.effects.friction import SIGN_WIDTH_RAD_S
from gfm.effects.of_state import OfDrive, OfPosition, OfSpeed

#: Knots between which it is a straight line, over what most of the time is between, in percent.
KNOTS, MOSTLY = 9, (1.0, 99.0)


class Curve(Effect):
    """torque(state) = sum_k torque_k H_k(state), hat functions H."""

    native = False
    stepwise = True
    parameters = tuple(
        Parameter(name=f"torque_{k}", unit="N m", lower=-1e4, upper=1e4) for k in range(KNOTS)
    )
    shown_by = "all positions at all speeds"

    def __init__(self, motion: Motion) -> None:
        """Lays knots over the states in which a joint was."""
        states = self.state(motion)
        first, last = np.percentile(states, MOSTLY)
        self._first, self._width = float(first), max(float(last - first) / (KNOTS - 1), 1e-9)

    @staticmethod
    @abstractmethod
    def state(motion: Motion) -> Array:
        """Returns of which state it is a law, shape (N,)."""

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        nothing = {p.name: 0.0 for p in self.parameters}
        return [[{**nothing, name: 1.0} for name in nothing]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        values = {p.name: float(a) for p, a in zip(self.parameters, amplitudes, strict=True)}
        return values if self.admissible(values) else None

    def height(self, motion: Motion, values: Mapping[str, Array] | Values) -> Array:
        """Returns how high it is in the states of a motion, N m, shape (N,)."""
        place = np.clip((self.state(motion) - self._first) / self._width, 0.0, KNOTS - 1.0)
        hats = np.maximum(1.0 - np.abs(place - np.arange(KNOTS)[:, None]), 0.0)
        amounts = np.array([values[p.name] for p in self.parameters]).reshape(KNOTS, -1)
        return np.asarray((amounts * hats).sum(axis=0))


@final
class CurveOfPosition(OfPosition, Curve):
    """A spring of any shape."""

    name = "curve_of_position"

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return self.height(motion, values)


@final
class CurveOfSpeed(OfSpeed, Curve):
    """A friction of any shape: against the motion."""

    name = "curve_of_speed"

    @override
    def torque(self, motion: Motion, values: Values) -> Array | None:
        return -self.height(motion, values) * sign(motion.velocity, SIGN_WIDTH_RAD_S)


@final
class CurveOfDrive(OfDrive, Curve):
    """A gain of any shape: what a drive gives beside the torque that it should give."""

    name = "curve_of_drive"
    stepwise = False  # what a drive gives acts at every step anyway

    @override
    def drive_change(self, motion: Motion, values: Mapping[str, Array]) -> Array | None:
        return self.height(motion, values)


#: By the state of which it is a law.
CURVE_OF: Mapping[str, type[Curve]] = {
    "position": CurveOfPosition,
    "velocity": CurveOfSpeed,
    DRIVE: CurveOfDrive,
}
