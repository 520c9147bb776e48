"""What a search asks of recordings: a least-squares problem of the amounts of effects, in segments.

There are three: the robot's rollouts, the poses of an object that it pushes, and learned forces
along its motions.

Shape letters: N numbers of a residual, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import Any, Self

import numpy as np
from typing_extensions import override

from gfm.core.checks import Array
from gfm.diagnosis.inference.blocks import Blocks, SegmentShape, blocks_of
from gfm.diagnosis.inference.fitting import LeastSquares
from gfm.effects import EffectInstance


@dataclass(frozen=True, kw_only=True, eq=False)
class SegmentedProblem(LeastSquares):
    """Recordings, and the model that should explain them.

    Attributes:
        joints: The measured joints, or what else each measurement has.
        given: Effects that the nominal model has already: every candidate has them.
        segments: What is predicted, and how each begins. Where that was fitted, each has itself
            as it was measured.
        state_basis: Per segment, an orthonormal basis of what its initial state can explain, if
            that is taken out of the residual, shape (N of the segment, up to states).
        outlying_from: Residuals from which on they are outlying, by channel and joint, in units of
            the noise, shape (channels, J); infinite for none.
        each_segment: Whether each segment is a part of the data by itself: where there are few.
    """

    joints: tuple[str, ...]
    given: tuple[EffectInstance, ...] = ()
    segments: tuple[Any, ...] = ()
    state_basis: tuple[Array, ...] = ()
    outlying_from: Array | float = np.inf
    each_segment: bool = False

    def layout(self) -> list[SegmentShape]:
        """Returns what each segment's numbers are."""
        return [
            SegmentShape(
                recording=segment.recording,
                duration_s=float(segment.time_s[-1] - segment.time_s[0]),
                channels=channels,
                measurements=len(segment.time_s),
            )
            for segment, channels in zip(self.segments, self.channels, strict=True)
        ]

    @property
    def errs_to_the_end(self) -> bool:
        """Whether what is wrong at one moment of a segment is so until its end."""
        return False

    @property
    def channels(self) -> list[int]:
        """How many numbers each joint has at each measurement of every segment."""
        return [1] * len(self.segments)

    @cached_property
    def blocks(self) -> Blocks:
        """How a residual is divided, to be scored."""
        joints = len(self.joints)
        return blocks_of(self.layout(), joints, self.limits(), each_segment=self.each_segment)

    @override
    def limits(self) -> Array:
        by_channel = np.broadcast_to(self.outlying_from, (2, len(self.joints)))
        return np.concatenate(
            [
                np.tile(by_channel[channel], shape.measurements)
                for shape in self.layout()
                for channel in range(shape.channels)
            ]
        )

    def slices(self) -> list[slice]:
        """Returns where each segment's numbers lie in a residual."""
        sizes = [s.channels * s.measurements * len(self.joints) for s in self.layout()]
        ends = np.cumsum(sizes).tolist()
        return [slice(a, b) for a, b in zip([0, *ends[:-1]], ends, strict=True)]

    def by_recording(self) -> list[slice]:
        """Returns where the numbers of each recording lie in a residual."""
        pairs = zip(self.layout(), self.slices(), strict=True)
        own = [[*some] for _, some in groupby(pairs, key=lambda pair: pair[0].recording)]
        return [slice(some[0][1].start, some[-1][1].stop) for some in own]

    def joint_costs(self, residual: Array) -> Array:
        """Returns the mean squared residual of each joint, shape (J,)."""
        return np.asarray((residual.reshape(-1, len(self.joints)) ** 2).mean(axis=0))

    def sample(self, simulated_s: float, of_each: int = 0, left: Array | None = None) -> list[int]:
        """Returns segments of about so much time in all; each one where they are few."""
        del simulated_s, of_each, left
        return list(range(len(self.layout())))

    def subset(self, keep: Sequence[int]) -> Self:
        """Returns the same problem with some of its segments only."""
        return replace(
            self,
            segments=tuple(self.segments[i] for i in keep),
            state_basis=tuple(self.state_basis[i] for i in keep if self.state_basis),
        )

    def as_measured(self) -> Self:
        """Returns the problem with every segment begun as it was measured, to the letter."""
        segments = tuple(segment.measured or segment for segment in self.segments)
        return replace(self, segments=segments, state_basis=())

    def robust(self, effects: Sequence[EffectInstance]) -> Self:
        """Returns the problem with limits from what `effects` leave in a typical segment."""
        del effects
        return self

    def plain(self) -> Self:
        """Returns the problem without such limits: what is outlying counts in full."""
        return replace(self, outlying_from=np.inf)

    def states(self) -> tuple[Array, Array]:
        """Returns where joints were measured and how fast they moved there, shape (M, J) each.

        Nowhere, if no joints are measured.
        """
        nowhere = np.zeros((0, len(self.joints)))
        return nowhere, nowhere

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
        return any(shape.channels > 1 for shape in self.layout())

    def positions_alone(self) -> Self:
        """Returns the problem without efforts."""
        return self
