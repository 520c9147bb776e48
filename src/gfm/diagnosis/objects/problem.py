"""How the object moved as a least-squares problem: segments, model, noise, residuals.

Residuals are measured minus predicted place and yaw in units of their noise. How a segment begins
is known no better than the noise allows. In the midst of a motion it is fitted, segment by segment
(three places and three speeds). At rest it is known nearly, and what may be wrong with it makes
errors that go together: residuals are weighed by their whole covariance. What is outlying counts
little more than what is not (`gfm.diagnosis.residuals.outliers`).

Shape letters: P poses of a segment, N numbers of all segments together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import mujoco
import numpy as np
from scipy.linalg import orth
from typing_extensions import override

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import free_parameters
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.residuals.outliers import OUTLYING, bounded
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.effects import EffectInstance
from gfm.signals.object_segments import ObjectSegment, own_velocity
from gfm.signals.object_track import in_plane, turned
from gfm.sim.object_stage import Stage, make_stage, run

#: Steps with which the effect of the initial state is measured: m, m, rad, and per second.
STATE_STEPS = (2e-4, 2e-4, 2e-3, 2e-3, 2e-3, 2e-2)
#: Farthest that an initial state is moved at once, in these steps.
FARTHEST = 20.0
#: Times that initial states are looked for anew around where they were found.
ROUNDS = 2
#: Derivatives are taken over this share of an amount that matters.
STEP = 0.3
#: Largest residual that counts, in units of the noise.
LARGEST = 1e4


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectProblem(SegmentedProblem):
    """Segments and the model that should explain them.

    Attributes:
        joints: What a pose has: its place in the plane, and its yaw.
        spec: The nominal model.
        noise: Of x, y (m) and yaw (rad), shape (3,).
    """

    joints: tuple[str, ...] = ("x", "y", "yaw")
    spec: mujoco.MjSpec
    segments: tuple[ObjectSegment, ...]
    noise: Array

    @property
    @override
    def errs_to_the_end(self) -> bool:
        return True  # where a contact leads the object aside, it stays aside

    @override
    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        rows = [np.concatenate(self.parts(effects)) for effects in candidates]
        return bounded(np.stack(rows), self.limits())

    def parts(self, effects: Sequence[EffectInstance]) -> list[Array]:
        """Returns measured minus predicted in units of the noise, by segment, shape (3 P,) each.

        What the initial state can explain is taken out, as far as that is unknown.
        """
        parts = self._whitened(make_stage(self.spec, effects), self.segments)
        if not self.state_basis:
            return parts
        return [without(*row) for row in zip(parts, self.state_basis, strict=True)]

    def _whitened(self, stage: Stage, segments: Sequence[ObjectSegment]) -> list[Array]:
        """Returns the residuals of some segments, shape (3 P,) each."""
        poses = run(stage, [segment.setting for segment in segments])
        errors = [
            (segment.plane - predicted(segment, pose, stage.timestep_s)) / self.noise
            for segment, pose in zip(segments, poses, strict=True)
        ]
        numbers = [np.nan_to_num(error.ravel(), nan=LARGEST) for error in errors]
        return [np.clip(one, -LARGEST, LARGEST) for one in numbers]

    @cached_property
    def sizes(self) -> Mapping[str, float]:
        """Amounts that matter, by parameter: of friction, mass, place and rates."""
        mass, inertia = make_stage(self.spec).inertia
        place = dict.fromkeys("xyz", 0.2 * float(np.sqrt(inertia / mass)))
        rates = {"mass": 0.5 * mass, "linear": 0.5 * mass, "angular": 0.5 * inertia}
        return {"coefficient": 0.1, **rates, **place}

    @override
    def differences(self, effects: Sequence[EffectInstance]) -> Array:
        """Contacts are rough: a share of amounts that matter."""
        return np.array([STEP * self.sizes[name] for _, name in free_parameters(effects)])

    @override
    def coarse(self) -> ObjectProblem:
        return self.plain()

    @override
    def robust(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        typical = np.median([np.sqrt(np.mean(p**2)) for p in self.parts(effects)])
        return replace(self, outlying_from=np.full((1, 3), OUTLYING * max(float(typical), 1.0)))

    def based(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        """Returns the problem with what initial states can explain near those measured."""
        pairs = zip(self._derivatives(make_stage(self.spec, effects)), self.segments, strict=True)
        return replace(self, state_basis=tuple(_unknown(*one) for one in pairs))

    @override
    def settled(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        # States that suited another model hold this one there: they are looked for from the start.
        stage, problem = make_stage(self.spec, effects), self.as_measured()
        free = [i for i, one in enumerate(self.segments) if one.place_error is None]
        segments = list(problem.segments)
        for _ in range(ROUNDS if free else 0):
            nearer = problem.subset(free)._nearer(stage)
            for i, one in zip(free, nearer, strict=True):
                segments[i] = one
            problem = replace(problem, segments=tuple(segments))
        return problem.based(effects)

    def _nearer(self, stage: Stage) -> list[ObjectSegment]:
        """Returns segments whose initial states are a Gauss-Newton step better."""
        before = self._whitened(stage, self.segments)
        pairs = zip(self._derivatives(stage), before, strict=True)
        steps = [-np.linalg.lstsq(columns, left, rcond=1e-3)[0] for columns, left in pairs]
        steps = np.clip(steps, -FARTHEST, FARTHEST)
        moved = [_moved(*one) for one in zip(self.segments, steps, strict=True)]
        after = self._whitened(stage, moved)
        return [
            new if np.sum(b**2) < np.sum(a**2) else old
            for old, new, a, b in zip(self.segments, moved, before, after, strict=True)
        ]

    def _derivatives(self, stage: Stage) -> list[Array]:
        """Returns by how much each unknown of an initial state changes residuals, (3 P, 3 or 6)."""
        moved = [
            [one, *(_moved(one, step) for step in np.eye(6)[: one.unknowns])]
            for one in self.segments
        ]
        parts = iter(self._whitened(stage, list(chain.from_iterable(moved))))
        each = [[next(parts) for _ in ways] for ways in moved]
        return [np.stack([one - still for one in others], axis=1) for still, *others in each]


def _unknown(columns: Array, segment: ObjectSegment) -> Array:
    """Returns what of a residual is its initial state, as far as it is unknown, shape (3 P, K).

    What is left without it has the covariance of noise alone. `columns` are by how much steps of
    what is unknown change the residual, shape (3 P, 3 or 6).
    """
    if segment.place_error is None:
        return np.asarray(orth(columns, rcond=1e-3))
    errors = segment.place_error / np.array(STATE_STEPS[:3])
    ways, size, _ = np.linalg.svd(columns * errors, full_matrices=False)
    return np.asarray(ways * np.sqrt(1.0 - 1.0 / np.sqrt(1.0 + size**2)))


def predicted(segment: ObjectSegment, pose: Array, timestep_s: float) -> Array:
    """Returns x, y and yaw at the times of a segment, shape (P, 3), from poses after each step."""
    plane = in_plane(pose, segment.reference)
    whole = 2.0 * np.pi * np.round((segment.plane[0, 2] - plane[0, 2]) / (2.0 * np.pi))
    grid = timestep_s * np.arange(len(plane))
    at = np.stack([np.interp(segment.time_s, grid, column) for column in plane.T], axis=1)
    return np.asarray(at + np.array([0.0, 0.0, whole]))


def _moved(segment: ObjectSegment, amounts: Array) -> ObjectSegment:
    """Returns a segment that begins elsewhere: by `amounts` of `STATE_STEPS`, shape (6,)."""
    change, setting = amounts * np.array(STATE_STEPS), segment.setting
    here = np.array([*setting.pose[:2], 0.0])
    pose = turned(setting.pose, here + change[:3], here)
    faster = own_velocity(pose, np.asarray(change[3:]))
    setting = replace(setting, pose=pose, velocity=setting.velocity + faster)
    return replace(segment, setting=setting, measured=segment.measured or segment)
