"""How the object moved as a least-squares problem: stretches, model, noise, residuals.

Residuals are measured minus predicted place and yaw in units of their noise. How a stretch begins
is known no better than the noise allows: it is fitted, stretch by stretch (three places and three
speeds). What is outlying counts little more than what is not (`gfm.diagnosis.residuals.outliers`).

Shape letters: P poses of a stretch, N numbers of all stretches together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.score import SegmentShape
from gfm.diagnosis.objects.stage import Setting, Stage, make_stage, run
from gfm.diagnosis.objects.stretches import Stretch, own_velocity
from gfm.diagnosis.objects.track import in_plane, turned
from gfm.diagnosis.residuals.outliers import OUTLYING, bounded
from gfm.effects import EffectInstance

#: Steps with which the effect of the initial state is measured: m, m, rad, and per second.
STATE_STEPS = (2e-4, 2e-4, 2e-3, 2e-3, 2e-3, 2e-2)
#: Farthest that an initial state is moved at once, in these steps.
FARTHEST = 20.0
#: Times that initial states are looked for anew around where they were found.
ROUNDS = 2
#: Largest residual that counts, in units of the noise.
LARGEST = 1e4


@dataclass(frozen=True, kw_only=True, eq=False)
class ObjectProblem:
    """Stretches and the model that should explain them.

    Attributes:
        spec: The nominal model.
        stretches: What is predicted.
        noise: Of x, y (m) and yaw (rad), shape (3,).
        state_basis: Per stretch, an orthonormal basis of what its initial state can explain,
            shape (3 P, up to 6).
        outlying_from: Residuals from which on they are outlying, in units of the noise.
    """

    spec: mujoco.MjSpec
    stretches: tuple[Stretch, ...]
    noise: Array
    state_basis: tuple[Array, ...] = ()
    outlying_from: float = np.inf

    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        """Returns the residual of every candidate, initial states fitted, shape (candidates, N)."""
        return np.stack([self._counted(self.parts(effects)) for effects in candidates])

    def parts(self, effects: Sequence[EffectInstance]) -> list[Array]:
        """Returns measured minus predicted in units of the noise, by stretch, shape (3 P,) each.

        What the initial state can explain is taken out.
        """
        stage = make_stage(self.spec, effects)
        parts = self._whitened(stage, [stretch.setting for stretch in self.stretches])
        if not self.state_basis:
            return parts
        bases = self.state_basis
        return [part - b @ (b.T @ part) for part, b in zip(parts, bases, strict=True)]

    def _whitened(self, stage: Stage, settings: Sequence[Setting]) -> list[Array]:
        """Returns residuals under some settings, those of all stretches, repeated as need be."""
        poses = run(stage, settings)
        stretches = self.stretches * (len(settings) // len(self.stretches))
        return [
            self._part(stretch, pose, stage.timestep_s)
            for stretch, pose in zip(stretches, poses, strict=True)
        ]

    def _part(self, stretch: Stretch, pose: Array, timestep_s: float) -> Array:
        error = (stretch.plane - predicted(stretch, pose, timestep_s)) / self.noise
        return np.asarray(np.clip(np.nan_to_num(error.ravel(), nan=LARGEST), -LARGEST, LARGEST))

    def _counted(self, parts: Sequence[Array]) -> Array:
        return bounded(np.concatenate(parts), self.outlying_from)

    def limits(self) -> Array | None:
        """Returns from where on each number is outlying, shape (N,); None where none is."""
        if not np.isfinite(self.outlying_from):
            return None
        sizes = (one.channels * one.measurements * len(self.joints) for one in self.layout())
        return np.full(sum(sizes), self.outlying_from)

    @property
    def joints(self) -> tuple[str, ...]:
        """What a pose has: its place in the plane, and its yaw."""
        return "x", "y", "yaw"

    def layout(self) -> list[SegmentShape]:
        """Returns what each stretch's numbers are."""
        return [
            SegmentShape(
                recording=stretch.recording,
                duration_s=float(stretch.time_s[-1] - stretch.time_s[0]),
                channels=1,
                measurements=len(stretch.time_s),
            )
            for stretch in self.stretches
        ]

    def slices(self) -> list[slice]:
        """Returns where each stretch's numbers lie in a residual."""
        ends = np.cumsum([3 * len(stretch.time_s) for stretch in self.stretches])
        return [slice(int(a), int(b)) for a, b in zip([0, *ends[:-1]], ends, strict=True)]

    def subset(self, keep: Sequence[int]) -> ObjectProblem:
        """Returns the same problem with some of its stretches only, as they were measured."""
        return replace(self, stretches=tuple(self.stretches[i] for i in keep), state_basis=())

    def robust(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        """Returns the problem with a limit from what `effects` leave in a typical stretch."""
        typical = np.median([np.sqrt(np.mean(p**2)) for p in self.settled(effects).parts(effects)])
        return replace(self, outlying_from=OUTLYING * max(float(typical), 1.0))

    def based(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        """Returns the problem with what initial states can explain near those measured."""
        bases = [_orthonormal(c) for c in self._derivatives(make_stage(self.spec, effects))]
        return replace(self, state_basis=tuple(bases))

    def settled(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        """Returns the problem with initial states as they fit best under `effects`."""
        problem = self
        for _ in range(ROUNDS):
            problem = problem.nearer(effects)
        return problem

    def nearer(self, effects: Sequence[EffectInstance]) -> ObjectProblem:
        """Returns the problem with initial states a Gauss-Newton step better, and their bases."""
        stage = make_stage(self.spec, effects)
        residuals = self._whitened(stage, [stretch.setting for stretch in self.stretches])
        columns = self._derivatives(stage)
        moved = [
            replace(s, setting=_moved(s.setting, np.clip(_solve(c, r), -FARTHEST, FARTHEST)))
            for s, c, r in zip(self.stretches, columns, residuals, strict=True)
        ]
        after = self._whitened(stage, [s.setting for s in moved])
        kept = [
            new if np.sum(b**2) < np.sum(a**2) else old
            for old, new, a, b in zip(self.stretches, moved, residuals, after, strict=True)
        ]
        return replace(self, stretches=tuple(kept)).based(effects)

    def _derivatives(self, stage: Stage) -> list[Array]:
        """Returns by how much each step of an initial state changes residuals, (3 P, 6) each."""
        count = len(self.stretches)
        ways = [stretch.setting for stretch in self.stretches]
        ways += [_moved(one, step) for step in np.eye(6) for one in ways[:count]]
        parts = self._whitened(stage, ways)
        return [
            np.stack([parts[i * count + s] - parts[s] for i in range(1, 7)], axis=1)
            for s in range(count)
        ]


def predicted(stretch: Stretch, pose: Array, timestep_s: float) -> Array:
    """Returns x, y and yaw at the times of a stretch, shape (P, 3), from poses after each step."""
    plane = in_plane(pose, stretch.reference)
    whole = 2.0 * np.pi * np.round((stretch.plane[0, 2] - plane[0, 2]) / (2.0 * np.pi))
    grid = timestep_s * np.arange(len(plane))
    at = np.stack([np.interp(stretch.time_s, grid, column) for column in plane.T], axis=1)
    return np.asarray(at + np.array([0.0, 0.0, whole]))


def _moved(setting: Setting, amounts: Array) -> Setting:
    """Returns a setting that begins elsewhere: `amounts` of `STATE_STEPS`, shape (6,)."""
    change = amounts * np.array(STATE_STEPS)
    here = np.array([*setting.pose[:2], 0.0])
    pose = turned(setting.pose, here + change[:3], here)
    faster = own_velocity(pose, np.asarray(change[3:]))
    return replace(setting, pose=pose, velocity=setting.velocity + faster)


def _solve(columns: Array, residual: Array) -> Array:
    return np.asarray(-np.linalg.lstsq(columns, residual, rcond=1e-3)[0])


def _orthonormal(columns: Array) -> Array:
    """Returns an orthonormal basis of the columns, without directions that are numerical noise."""
    left, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, sizes > 1e-3 * max(sizes[0], 1e-12)])
