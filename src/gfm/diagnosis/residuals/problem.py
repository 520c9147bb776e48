"""A diagnosis as a least-squares problem: segments, model, noise, and residuals of candidates.

Residuals are measured minus predicted, in units of the sensor noise, over open-loop rollouts. What
a wrong initial state could explain is taken out of them: it is fitted, to first order, segment by
segment (two numbers per joint, and two more where a motor rings against its link).

Segments that a model misses by far more than the others (a fall, a stall) would decide everything
by their squares: what is outlying counts little more than what is not (`outliers`).

Shape letters: T measurements of a segment, J joints, N numbers of all segments together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from typing_extensions import override

from gfm.core.checks import Array
from gfm.diagnosis.residuals.initial_states import (
    freely_settled,
    orthonormal,
    with_state_basis,
    without_states,
)
from gfm.diagnosis.residuals.outliers import OUTLYING, bounded
from gfm.diagnosis.residuals.rollouts import Rollouts
from gfm.effects import EffectInstance
from gfm.sim.commands import AFTER, BEFORE, InForce, best_in_force, since_commands

#: Recorded time on which it is told under which commands efforts were measured, s.
TIMED_S = 4.0
#: Share of a sample that is for segments of which most is left.
MOST_LEFT = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem(Rollouts):
    """Recordings and the model that should explain them, with initial states fitted."""

    @override
    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns the residual of every candidate, initial states fitted, shape (candidates, N)."""
        rows, limits = zip(candidates, self.predictions(candidates), strict=True), self.limits()
        left = [np.concatenate(without_states(self, *row)) for row in rows]
        return np.stack([bounded(residual, limits) for residual in left])

    @override
    def robust(self, effects: Sequence[EffectInstance]) -> Problem:
        residual = self.plain().residuals([effects])[0]
        shapes, joints = zip(self.slices(), self.channels, strict=True), len(self.joints)
        parts = [residual[rows].reshape(channels, -1, joints) for rows, channels in shapes]
        sizes = [np.sqrt(np.mean(part**2, axis=1)) for part in parts]
        of_each = [[own[channel] for own in sizes if len(own) > channel] for channel in range(2)]
        typical = [np.median(own or np.ones((1, joints)), axis=0) for own in of_each]
        return replace(self, outlying_from=OUTLYING * np.maximum(np.stack(typical), 1.0))

    def position_errors(self, effects: Sequence[EffectInstance]) -> list[Array]:
        """Returns measured minus predicted position, initial state fitted, per segment (T, J)."""
        parts = without_states(self, effects, self.predictions([effects])[0])
        return [
            part[: s.position.size].reshape(s.position.shape) * self.noise.position
            for s, part in zip(self.segments, parts, strict=True)
        ]

    @override
    def states(self) -> tuple[Array, Array]:
        speeds = [np.gradient(s.position, s.time_s, axis=0) for s in self.segments]
        return np.concatenate([s.position for s in self.segments]), np.concatenate(speeds)

    @override
    def positions_alone(self) -> Problem:
        segments = tuple(replace(segment, effort=None) for segment in self.segments)
        rows = zip(self.state_basis, segments, strict=True)
        basis = tuple(orthonormal(part[: segment.position.size]) for part, segment in rows)
        return replace(self, segments=segments, state_basis=basis)

    def joined(self, other: Problem) -> Problem:
        """Returns the same problem with the segments of another one behind its own."""
        return replace(
            self,
            segments=(*self.segments, *other.segments),
            state_basis=(*self.state_basis, *other.state_basis),
        )

    @override
    def settled(self, effects: Sequence[EffectInstance]) -> Problem:
        """Returns the problem with initial states, and times of efforts, that fit best.

        Where nothing leads a joint back, what a segment begins with counts to its end, and by more
        than to first order. A servo forgets it: its segments stay as they are.
        """
        return freely_settled(timed(self, effects), effects)

    @override
    def sample(self, simulated_s: float, of_each: int = 0, left: Array | None = None) -> list[int]:
        """Returns segments, spread over the recordings and kinds, of about so much time in all.

        Args:
            simulated_s: Recorded time, s.
            of_each: Segments of each recording that are taken in any case.
            left: A residual, shape (N,). A share of the time is for segments of which most is left,
                wherever they are: what acts now and then shows in few.
        """
        order, chosen = sorted(range(len(self.segments)), key=self._turn), list[int]()
        if left is not None:
            mean = [float(np.mean(left[rows] ** 2)) for rows in self.slices()]
            chosen = self.first(np.argsort(mean)[::-1].tolist(), MOST_LEFT * simulated_s)
            simulated_s *= 1.0 - MOST_LEFT
        others = [i for i in order if i not in chosen]
        return sorted(chosen + self.first(others, simulated_s, of_each))

    def first(self, order: Sequence[int], simulated_s: float, of_each: int = 0) -> list[int]:
        """Returns the first segments, in an order, of about so much time in all: see `sample`."""
        chosen, total_s = [], 0.0
        taken: Counter[int] = Counter()
        for i in order:
            here = self.segments[i]
            if total_s < simulated_s or taken[here.recording] < of_each:
                chosen.append(i)
                taken[here.recording] += 1
                total_s += float(here.time_s[-1])
        return sorted(chosen)

    def _turn(self, index: int) -> tuple[int, int, int]:
        """Returns a key by which kinds take turns, within a kind recordings, then segments."""
        here = self.segments[index]
        same_kind = sorted({s.recording for s in self.segments if s.kind is here.kind})
        within = [i for i, s in enumerate(self.segments) if s.recording == here.recording]
        place = within.index(index)
        # A golden-ratio order takes windows from all over a recording before their neighbours.
        spread = int((place * 0.618033988749895 % 1.0) * len(within))
        return (spread * len(same_kind) + same_kind.index(here.recording), here.recording, place)


def unsettled(problem: Problem, effects: Sequence[EffectInstance]) -> Problem:
    """Returns the problem with initial states as measured, and what they explain under `effects`.

    What suited a model that was wrong holds the next one there: it is bent to begin as that did.
    """
    return with_state_basis(problem.as_measured(), effects).robust(effects)


def timed(problem: Problem, effects: Sequence[EffectInstance]) -> Problem:
    """Returns the problem with efforts under that command of nearly the same stamp that fits best.

    Under `effects`.
    """
    telling = [
        i for i, s in enumerate(problem.segments) if s.same_stamp_s > 0.0 and s.effort is not None
    ]
    if not telling:
        return problem
    few = problem.subset(telling)
    few = few.subset(few.sample(TIMED_S))
    plants = few.plants(effects)
    since = [
        since_commands(plants[s.kind], s, s.time_s + plants[s.kind].effort_apart_s)
        for s in few.segments
    ]
    near = [np.abs(one) <= s.same_stamp_s for s, one in zip(few.segments, since, strict=True)]

    def missed(in_force: InForce) -> list[Array]:
        here = replace(few, in_force=in_force)
        parts = zip(few.segments, here.whitened(here.predictions([effects])[0]), strict=True)
        return [np.abs(part[s.position.size :]).reshape(s.position.shape) for s, part in parts]

    told = (since, missed(BEFORE), missed(AFTER))
    beside = [[one[n] for one, n in zip(parts, near, strict=True)] for parts in told]
    return replace(problem, in_force=best_in_force(*map(np.concatenate, beside)))
