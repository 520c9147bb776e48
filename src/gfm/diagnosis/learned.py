"""What learned forces say: the forces of a fitted GFM, put through the library of named effects.

A GFM is a torque that the model lacks, as learned. Along the recorded motions it is a signal for
every joint, and every effect's torque there is another one: names are found by regression, the best
first, all that were found refitted together after each. What no name explains stays a GFM.

It stands beside the verdict from the recordings, not in place of it: a GFM has seen the same
recordings, and what it is wrong about it is wrong about here.

Shape letters: T measurements, B blocks, J joints, A joints that are asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gfm.core import Trajectory
from gfm.core.checks import Array
from gfm.diagnosis.evidence.torques import TorqueDomain, torque_domain
from gfm.diagnosis.inference.fitting import LEAST_GAIN, Fit, at_bound, free_parameters
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place, joint_scales, places
from gfm.diagnosis.search.equals import Recorded, looked_for
from gfm.diagnosis.search.naming import fitly_named
from gfm.effects import EffectInstance, Scales, effect_library
from gfm.effects.effect import ProbeGroup
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import LearnedForces
from gfm.sim.learned_along import joint_forces_along
from gfm.sim.plant import stepping_spec

#: A joint is asked if the force on it is this share of the torque of its drive: below, a GFM that
#: has nothing to learn shows what it could not unlearn.
LOUD = 0.05
#: Share of what is left of the force on its joints that a name must explain: a regression onto a
#: network leaves a fifth of a signal out easily. And the share of all the force there.
WORTH, LEAST = 0.2, 0.02
#: Names at most.
MOST_NAMES = 6
#: Candidates whose amount is checked by their own law in each round, best to first order.
SHORTLIST = 6


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
        named: Share of its energy that the names explain together; None where it was too small to
            be asked.
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
    domain = torque_domain(problem.specs, recordings, problem.given)
    along = np.stack([_forces(problem, one, domain.recordings) for one in members])
    rows = np.split(along.mean(axis=0), np.cumsum([len(v.position) for v in domain.views])[:-1])
    learned = domain.blocks(rows)
    views = [replace(v, missing=row) for v, row in zip(domain.views, rows, strict=True)]
    drive = _rms(domain.signals().drive)
    moving = domain.moving()
    asked = np.flatnonzero(_rms(moving * learned) > LOUD * np.maximum(drive, 1e-9))
    search = _Search(domain, moving * learned, moving, asked, joint_scales(problem, views))
    names = _named(search, problem)
    mean = _rms(along.mean(axis=0).ravel()[:, None])[0]
    apart = _rms((along - along.mean(axis=0)).ravel()[:, None])[0]
    return LearnedReport(
        members=len(members),
        spread=float(apart / mean) if len(members) > 1 and mean > 0.0 else None,
        names=names,
        joints=_joints(search, names, drive),
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


@dataclass(frozen=True, kw_only=True)
class _Probed:
    """An effect at a place with one group of its probes and their torques, shape (B, A, P)."""

    place: Place
    instances: Sequence[EffectInstance]
    torques: Array


@dataclass(frozen=True, kw_only=True)
class _Found:
    """A name with its torque, N m, shape (B, J), and the probes that it was found by."""

    probed: _Probed
    instance: EffectInstance
    torque: Array


@dataclass
class _Search:
    """The learned forces while joints move, shape (B, J), and all that they are regressed on.

    Joints are weighed by their forces, so that all that are asked count alike.
    """

    domain: TorqueDomain
    learned: Array
    moving: Array
    asked: NDArray[np.intp]
    scales: Sequence[Scales]
    probes: dict[tuple[object, ...], list[_Probed]] = field(default_factory=dict)

    def weighed(self, torque: Array) -> Array:
        """Returns a torque (B, J) on the joints that are asked, in units of theirs, (B, A)."""
        size = _rms(self.learned)[self.asked]
        return np.asarray((self.moving * torque)[:, self.asked] / size)

    def candidates(self) -> list[Place]:
        """Returns every effect at every place where it touches a joint that is asked."""
        # Along given positions all delays are late commands.
        along = Recorded(has_efforts=False, has_feedback=False)
        library = looked_for((e for e in effect_library().values() if e.twin is None), along)
        asked = {self.domain.joints[j] for j in self.asked}
        return [
            place
            for effect in library
            if not effect.separates_motor
            for place in places(effect, self.domain.joints)
            if set(place.joints) <= asked or len(place.joints) > 2 or not place.joints
        ]

    def groups(self, place: Place) -> list[_Probed]:
        """Returns an effect's groups of probes."""
        if place.key not in self.probes:
            first = self.domain.joints.index(place.joints[0]) if place.joints else 0
            groups = place.effect.probes(self.scales[first])
            self.probes[place.key] = [self._probed(place, group) for group in groups]
        return self.probes[place.key]

    def _probed(self, place: Place, group: ProbeGroup) -> _Probed:
        instances = [
            EffectInstance(effect=place.effect, joints=place.joints, values=values)
            for values in group
        ]
        torques = [self.weighed(self.domain.response(one)) for one in instances]
        return _Probed(place=place, instances=instances, torques=np.stack(torques, axis=2))

    def touched(self, place: Place) -> NDArray[np.bool_]:
        """Returns which of the joints that are asked an effect acts on, shape (A,)."""
        names = place.joints or self.domain.joints
        return np.array([self.domain.joints[j] in names for j in self.asked])


def _named(search: _Search, problem: Problem) -> tuple[LearnedName, ...]:
    found: list[_Found] = []
    while len(search.asked) and len(found) < MOST_NAMES:
        better = _one_more(search, found)
        if better is None:
            break
        found = better
    effects = tuple(one.instance for one in found)
    columns = np.zeros((0, len(free_parameters(effects))))
    fit = Fit(effects=effects, cost=0.0, jacobian=columns, residual=np.zeros(0))
    shares = [_share(search, one, [o for o in found if o is not one]) for one in found]
    return tuple(
        LearnedName(instance=instance, share=share)
        for instance, share in zip(fitly_named(fit, problem.specs).effects, shares, strict=True)
    )


def _one_more(search: _Search, found: Sequence[_Found]) -> list[_Found] | None:
    """Returns what was found and the name that explains most beside it, all refitted together.

    None where no name explains enough.
    """
    taken = {one.probed.place.key for one in found}
    before = [one.probed for one in found]
    probed = [g for p in search.candidates() if p.key not in taken for g in search.groups(p)]
    gains = [-float(np.sum(_weights(search, [*before, one])[1] ** 2)) for one in probed]
    best = [probed[i] for i in np.argsort(gains)[::-1][:SHORTLIST]]
    tried = [together for one in best if (together := _together(search, [*before, one]))]
    tried = [together for together in tried if _enough(search, found, together)]
    return max(tried, key=lambda together: _score(search, found, together), default=None)


def _weights(search: _Search, probed: Sequence[_Probed]) -> tuple[list[Array], Array]:
    """Returns the weights of all probes together, (P,) each, and what they leave, (B, A)."""
    learned = search.weighed(search.learned)
    columns = np.concatenate([one.torques for one in probed], axis=2).reshape(learned.size, -1)
    sizes = np.linalg.norm(columns, axis=0) + 1e-12
    weights = np.linalg.lstsq(columns / sizes, learned.ravel(), rcond=1e-6)[0] / sizes
    left = learned - (columns @ weights).reshape(learned.shape)
    ends = np.cumsum([one.torques.shape[2] for one in probed])
    return [np.asarray(w) for w in np.split(weights, ends[:-1])], np.asarray(left)


def _together(search: _Search, probed: Sequence[_Probed]) -> list[_Found] | None:
    """Returns effects in the amounts that their probes say together, with their own laws' torques.

    None where an amount is none that the effect can have.
    """
    found = []
    for one, weights in zip(probed, _weights(search, probed)[0], strict=True):
        effect = one.place.effect
        values = effect.combine([i.values for i in one.instances], [float(w) for w in weights])
        if values is None:
            return None
        usual = effect.canonical(values)
        instance = EffectInstance(effect=effect, joints=one.place.joints, values=usual)
        if at_bound(instance):
            return None
        torque = search.domain.response(instance)
        found.append(_Found(probed=one, instance=instance, torque=torque))
    return found


def _left(search: _Search, found: Sequence[_Found]) -> Array:
    return search.weighed(search.learned - sum((o.torque for o in found), np.zeros(())))


def _score(search: _Search, found: Sequence[_Found], together: Sequence[_Found]) -> float:
    """Returns how little is left, each parameter of the newest name having its price.

    What is no force itself (a gain, a shifted encoder) is no rival of a force that takes as much.
    """
    newest = together[-1].instance
    effect, no_force = newest.effect, search.domain.law(newest) is None
    price = LEAST_GAIN * (len(effect.parameters) - len(effect.fixed) + no_force)
    before, after = (float(np.sum(_left(search, names) ** 2)) for names in (found, together))
    return -after - price * before


def _enough(search: _Search, found: Sequence[_Found], together: Sequence[_Found]) -> bool:
    """Returns whether the newest name makes enough of a difference on its joints."""
    touched = search.touched(together[-1].probed.place)
    before, after = (_left(search, names)[:, touched] for names in (found, together))
    taken = float(np.sum(before**2) - np.sum(after**2))
    return taken > WORTH * float(np.sum(before**2)) and taken > LEAST * before.size


def _share(search: _Search, one: _Found, others: Sequence[_Found]) -> float:
    """Returns the share of the force on its joints that a name explains besides the others."""
    touched = search.touched(one.probed.place)
    without, whole = (_left(search, names)[:, touched] for names in (others, [one, *others]))
    return float(np.sum(without**2) - np.sum(whole**2)) / without.size


def _joints(search: _Search, names: Sequence[LearnedName], drive: Array) -> tuple[JointForce, ...]:
    told = sum((search.domain.response(n.instance) for n in names), np.zeros(()))
    left = search.learned - search.moving * told
    size, rest = _rms(search.learned), _rms(left)
    return tuple(
        JointForce(
            joint=name,
            rms_nm=float(size[j]),
            of_drive=float(size[j] / max(drive[j], 1e-9)),
            named=float(1.0 - (rest[j] / size[j]) ** 2) if j in search.asked else None,
        )
        for j, name in enumerate(search.domain.joints)
    )


def _rms(rows: Array) -> Array:
    """Returns the root mean square of each column."""
    return np.asarray(np.sqrt(np.mean(rows**2, axis=0)))
