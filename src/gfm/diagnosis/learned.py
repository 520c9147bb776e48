"""What learned forces say: the forces of a fitted GFM, put through the library of named effects.

A GFM is a torque that the model lacks, as learned. Along the recorded motions it is a signal for
every joint, and every effect's torque there is another one: what is learned and not named yet is
the residual of a least-squares problem, and names are found by the search that finds those of the
robot. What no name explains stays a GFM.

It stands beside the verdict from the recordings, not in place of it: a GFM has seen the same
recordings, and what it is wrong about it is wrong about here.

Shape letters: T measurements, B blocks, J joints, N numbers of a residual.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from typing_extensions import override

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.inference.blocks import SegmentShape
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.segmented import SegmentedProblem
from gfm.diagnosis.search.candidates import Place, joint_scales, places
from gfm.diagnosis.search.hypothesis import nominal_hypothesis
from gfm.diagnosis.search.moves.add import add, add_costly
from gfm.diagnosis.search.naming import Recorded, fitly_named, looked_for
from gfm.diagnosis.search.steps import end, run
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, Scales, effect_library
from gfm.signals.smoothing import rms
from gfm.signals.torque_domain import TorqueDomain, block_means, torque_domain
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import LearnedForces
from gfm.sim.learned_along import joint_forces_along
from gfm.sim.plant import stepping_spec

#: Noise of a learned force, as a share of the torque of its joint's drive: what a GFM could not
#: unlearn. The same laws are named from 0.01 to 0.02; 0.05 hides the smaller one of two.
NOISE_SHARE = 0.02
#: Length of the segments into which motions are cut, s: as short as a block of the score can be.
SEGMENT_S = 0.8


@dataclass(frozen=True, kw_only=True)
class LearnedName:
    """One name for a part of the learned forces.

    Attributes:
        instance: The effect, where, in which amount.
        share: Of the energy of the learned force on its joints that it explains besides the others.
    """

    instance: EffectInstance
    share: float


@dataclass(frozen=True, kw_only=True)
class JointForce:
    """The learned force on one joint.

    Attributes:
        joint: Name.
        rms_nm: Its root mean square along the motions.
        of_drive: The same as a share of the drive's torque.
        named: Share of its energy that all names explain; None where it is too small to ask.
    """

    joint: str
    rms_nm: float
    of_drive: float
    named: float | None


@dataclass(frozen=True, kw_only=True)
class LearnedReport:
    """What learned forces say.

    Attributes:
        members: How many force models were averaged.
        spread: RMS of their differences from the mean, as a share of its RMS; None for one alone.
        names: What was named, in the order in which it was found.
        joints: The force joint by joint.
    """

    members: int
    spread: float | None
    names: tuple[LearnedName, ...]
    joints: tuple[JointForce, ...]

    @property
    def named_share(self) -> float:
        """Mean share of the force that is named, over the joints that were asked."""
        shares = [one.named for one in self.joints if one.named is not None]
        return float(np.mean(shares)) if shares else 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class LearnedProblem(SegmentedProblem):
    """Learned forces along motions, and the nominal model that they were learned beside.

    Attributes:
        domain: The motions as torques.
        learned: The force while joints move, block means, N m, shape (B, J).
        noise: Of each joint, N m, shape (J,).
    """

    domain: TorqueDomain
    learned: Array
    noise: Array

    @override
    def residuals(self, candidates: Sequence[Sequence[EffectInstance]]) -> Array:
        moving, missing = self.domain.moving(), self.domain.missing()
        left = [
            self.learned - moving * (missing - self.domain.missing(effects))
            for effects in candidates
        ]
        return np.stack([(one / self.noise).ravel() for one in left])

    @override
    def layout(self) -> list[SegmentShape]:
        shapes = []
        for i, recording in enumerate(self.domain.recordings):
            count = len(block_means(recording.time_s[:, None], recording))
            parts = max(round(recording.duration_s / SEGMENT_S), 2)
            shapes += [
                SegmentShape(i, recording.duration_s * len(rows) / count, 1, len(rows))
                for rows in np.array_split(np.arange(count), parts)
            ]
        return shapes

    @override
    def states(self) -> tuple[Array, Array]:
        return self.domain.signals["position"], self.domain.signals["velocity"]

    @override
    def subset(self, keep: Sequence[int]) -> Self:
        """Returns the problem itself: a part of the motions would not be faster."""
        del keep
        return self


def learned_report(
    problem: Problem, recordings: Sequence[Trajectory], members: Sequence[LearnedForces]
) -> LearnedReport:
    """Returns what fitted force models say along recordings.

    Args:
        problem: Made from the recordings.
        recordings: Along whose motions the forces are looked at.
        members: Of an ensemble, at least one.

    Raises:
        BadInputError: a force model is of another robot.
    """
    domain = torque_domain(problem, recordings)
    along = np.stack([_forces(problem, one, domain.recordings) for one in members])
    mean = along.mean(axis=0)
    drive = domain.blocks(domain.view.drive)
    told = LearnedProblem(
        joints=problem.joints,
        given=problem.given,
        domain=domain,
        learned=domain.moving() * domain.blocks(mean),
        noise=NOISE_SHARE * np.maximum(np.sqrt(np.mean(drive**2, axis=0)), 1e-9),
    )
    here = nominal_hypothesis(told)
    takes = mean + domain.view.drive
    scales = joint_scales(problem, [replace(domain.view, missing=mean, served=takes)])
    search = Search[LearnedProblem](
        candidates=_candidates(told.joints, scales), report=lambda _: None
    )
    found = end(run(here, search, (add, add_costly)), search)
    effects = fitly_named(found.fit, problem.specs).effects
    without = [[e for e in effects if e is not one] for one in effects]
    before, after, *rest = map(told.joint_costs, told.residuals([(), effects, *without]))
    shares = [(left - after) / before for left in rest]
    size, asked = rms([mean]), here.open_joints
    return LearnedReport(
        members=len(members),
        spread=rms([along - mean]) / size if len(members) > 1 and size > 0.0 else None,
        names=tuple(
            LearnedName(instance=one, share=_share(told, one, share, asked))
            for one, share in zip(effects, shares, strict=True)
        ),
        joints=tuple(
            JointForce(
                joint=name,
                rms_nm=float(np.sqrt(before[j]) * told.noise[j]),
                of_drive=float(np.sqrt(before[j]) * NOISE_SHARE),
                named=float(1.0 - after[j] / before[j]) if name in asked else None,
            )
            for j, name in enumerate(told.joints)
        ),
    )


def _forces(problem: Problem, forces: LearnedForces, recordings: Sequence[Trajectory]) -> Array:
    """Returns one model's forces at the measurements of all recordings, N m, shape (T, J)."""
    kinds = {recording.command_kind for recording in recordings}
    model = HybridModel(
        models={k: stepping_spec(problem.specs[k], problem.given).compile() for k in kinds},
        joint_names=problem.joints,
        control_period_s=forces.control_period_s,
        effects=problem.given,
    )
    return np.concatenate([joint_forces_along(forces, model, one) for one in recordings])


def _candidates(joints: Sequence[str], scales: Sequence[Scales]) -> list[Place]:
    """Returns every effect at every place: no inverse dynamics tell of motors beside their links.

    Along given positions all delays are late commands.
    """
    along = Recorded(has_efforts=False, has_feedback=False)
    library = looked_for((e for e in effect_library().values() if e.twin is None), along)
    return [
        place
        for effect in library
        if not effect.separates_motor
        for place in places(effect, joints, scales)
    ]


def _share(
    told: LearnedProblem, instance: EffectInstance, shares: Array, asked: Collection[str]
) -> float:
    """Returns the mean share, shape (J,), over the joints of an effect that were asked."""
    rows = [j for j in told.domain.touched(instance) if told.joints[j] in asked]
    return float(np.mean(shares[rows])) if rows else 0.0
