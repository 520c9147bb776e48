"""What a search asks of recordings: a least-squares problem of the amounts of effects, in segments.

There are three: the robot's rollouts, the poses of an object that it pushes, and learned forces
along its motions.

Shape letters: N numbers of a residual, J joints.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Self

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import small_differences
from gfm.diagnosis.inference.score import SegmentShape
from gfm.effects import EffectInstance


class SegmentedProblem(ABC):
    """Recordings, and the model that should explain them."""

    if TYPE_CHECKING:  # fields or properties of those that are

        @property
        def joints(self) -> tuple[str, ...]:
            """The measured joints, or what else each measurement has."""

        @property
        def segments(self) -> tuple[object, ...]:
            """What is predicted, and how each begins."""

        @property
        def given(self) -> tuple[EffectInstance, ...]:
            """Effects that the nominal model has already."""

    @abstractmethod
    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns the residual of every candidate, in units of the noise, (candidates, N)."""

    @abstractmethod
    def layout(self) -> list[SegmentShape]:
        """Returns what each segment's numbers are."""

    def slices(self) -> list[slice]:
        """Returns where each segment's numbers lie in a residual."""
        sizes = [s.channels * s.measurements * len(self.joints) for s in self.layout()]
        ends = np.cumsum(sizes).tolist()
        return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]

    def joint_costs(self, residual: Array) -> Array:
        """Returns the mean squared residual of each joint, shape (J,)."""
        return np.asarray((residual.reshape(-1, len(self.joints)) ** 2).mean(axis=0))

    def sample(self, simulated_s: float) -> list[int]:
        """Returns segments of about so much time in all; each one where they are few."""
        del simulated_s
        return list(range(len(self.layout())))

    @abstractmethod
    def subset(self, keep: Sequence[int]) -> Self:
        """Returns the same problem with some of its segments only."""

    def coarse(self) -> Self:
        """Returns the same, faster and without limits: good enough for differences."""
        return self

    def limits(self) -> Array | None:
        """Returns beyond what numbers count less in a fit, shape (N,); None where none does."""
        return None

    def differences(self, effects: Sequence[EffectInstance]) -> Array:
        """Returns the changes of free amounts over which derivatives are taken, shape (P,)."""
        return small_differences(effects)

    def robust(self, effects: Sequence[EffectInstance]) -> Self:
        """Returns the problem with limits from what `effects` leave in a typical segment."""
        del effects
        return self

    def plain(self) -> Self:
        """Returns the problem without such limits: what is outlying counts in full."""
        return self

    def settled(self, effects: Sequence[EffectInstance]) -> Self:
        """Returns the problem begun as it fits best under `effects`; itself if nothing is free."""
        del effects
        return self

    @property
    def separated(self) -> set[tuple[str, ...]]:
        """Joints whose motor the model has apart from the link already, each as a place."""
        return set()

    @property
    def has_efforts(self) -> bool:
        """Whether efforts are predicted beside positions."""
        return False

    def positions_alone(self) -> Self:
        """Returns the problem without efforts."""
        return self
