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
from gfm.diagnosis.attribution import LEAST_GAIN, Fit, at_bound, free_parameters
from gfm.diagnosis.candidates import Place, joint_scales, places
from gfm.diagnosis.chain.torques import TorqueDomain, torque_domain
from gfm.diagnosis.naming import fitly_named
from gfm.diagnosis.problem import Problem
from gfm.effects import EffectInstance, Scales, effect_library
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
#: Names at most, and rounds in which all that were found are refitted together.
MOST_NAMES, SWEEPS = 6, 3
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
class _Found:
    """A name with its torque, N m, shape (B, J)."""

    place: Place
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
    probes: dict[tuple[object, ...], list[tuple[list[EffectInstance], Array]]] = field(
        default_factory=dict
    )

    def weighed(self, torque: Array) -> Array:
        """Returns a torque (B, J) on the joints that are asked, in units of theirs, (B, A)."""
        size = _rms(self.learned)[self.asked]
        return np.asarray((self.moving * torque)[:, self.asked] / size)

    def candidates(self) -> list[Place]:
        """Returns every effect at every place where it touches a joint that is asked."""
        library = [e for e in effect_library().values() if e.twin is None]
        asked = {self.domain.joints[j] for j in self.asked}
        return [
            place
            for effect in library
            if not effect.separates_motor
            for place in places(effect, self.domain.joints)
            if set(place.joints) <= asked or len(place.joints) > 2 or not place.joints
        ]

    def groups(self, place: Place) -> list[tuple[list[EffectInstance], Array]]:
        """Returns an effect's probes and the torques of each group, shape (B, A, probes)."""
        if place.key not in self.probes:
            first = self.domain.joints.index(place.joints[0]) if place.joints else 0
            told = []
            for group in place.effect.probes(self.scales[first]):
                instances = [
                    EffectInstance(effect=place.effect, joints=place.joints, values=values)
                    for values in group
                ]
                torques = [self.weighed(self.domain.response(one)) for one in instances]
                told.append((instances, np.stack(torques, axis=2)))
            self.probes[place.key] = told
        return self.probes[place.key]

    def touched(self, place: Place) -> NDArray[np.bool_]:
        """Returns which of the joints that are asked an effect acts on, shape (A,)."""
        names = place.joints or self.domain.joints
        return np.array([self.domain.joints[j] in names for j in self.asked])


def _named(search: _Search, problem: Problem) -> tuple[LearnedName, ...]:
    found: list[_Found] = []
    while len(search.asked) and len(found) < MOST_NAMES:
        best = _best(search, found)
        if best is None:
            break
        found = _refitted(search, [*found, best])
    effects = tuple(one.instance for one in found)
    columns = np.zeros((0, len(free_parameters(effects))))
    fit = Fit(effects=effects, cost=0.0, jacobian=columns, residual=np.zeros(0))
    shares = [_share(search, one, [o for o in found if o is not one]) for one in found]
    return tuple(
        LearnedName(instance=instance, share=share)
        for instance, share in zip(fitly_named(fit, problem.specs).effects, shares, strict=True)
    )


def _best(search: _Search, found: Sequence[_Found]) -> _Found | None:
    """Returns the name that explains most of what is left, if one explains enough."""
    left = _left(search, found)
    taken = {one.place.key for one in found}
    rough = [(p, _first_order(search, p, left)) for p in search.candidates() if p.key not in taken]
    rough = sorted(rough, key=lambda pair: -pair[1])[:SHORTLIST]
    tried = [one for place, gain in rough if gain > 0.0 for one in _fits(search, place, left)]
    tried = [one for one in tried if _enough(search, one, left)]
    return max(tried, key=lambda one: _score(search, one, left), default=None)


def _first_order(search: _Search, place: Place, left: Array) -> float:
    """Returns the squares that a place's probes take from what is left, at most."""
    return max(
        float(np.sum(left**2) - np.sum(_regressed(torques, left)[1] ** 2))
        for _, torques in search.groups(place)
    )


def _regressed(torques: Array, left: Array) -> tuple[Array, Array]:
    """Returns the weights of probes (B, A, P) that leave least, (P,), and what they leave."""
    columns = torques.reshape(-1, torques.shape[2])
    weights = np.asarray(np.linalg.lstsq(columns, left.ravel(), rcond=1e-6)[0], np.float64)
    return weights, left - (columns @ weights).reshape(left.shape)


def _fits(search: _Search, place: Place, left: Array) -> list[_Found]:
    """Returns an effect in the amounts that its probes say, each with the torque of its own law."""
    found = []
    for instances, torques in search.groups(place):
        weights, _ = _regressed(torques, left)
        values = place.effect.combine([i.values for i in instances], [float(w) for w in weights])
        if values is None:
            continue
        usual = place.effect.canonical(values)
        instance = EffectInstance(effect=place.effect, joints=place.joints, values=usual)
        if not at_bound(instance):
            torque = search.domain.response(instance)
            found.append(_Found(place=place, instance=instance, torque=torque))
    return found


def _left(search: _Search, found: Sequence[_Found]) -> Array:
    return search.weighed(search.learned - sum((o.torque for o in found), np.zeros(())))


def _taken(search: _Search, one: _Found, left: Array) -> float:
    """Returns the squares that a name takes from what is left."""
    return float(np.sum(left**2) - np.sum((left - search.weighed(one.torque)) ** 2))


def _score(search: _Search, one: _Found, left: Array) -> float:
    """Returns what a name takes, less what each of its parameters has to take.

    What is no force itself (a gain, a shifted encoder) is no rival of a force that takes as much.
    """
    effect = one.instance.effect
    no_force = search.domain.law(one.instance) is None
    price = LEAST_GAIN * (len(effect.parameters) - len(effect.fixed) + no_force)
    return _taken(search, one, left) - price * float(np.sum(left**2))


def _enough(search: _Search, one: _Found, left: Array) -> bool:
    touched = search.touched(one.place)
    there = float(np.sum(left[:, touched] ** 2))
    taken = _taken(search, one, left)
    return taken > WORTH * there and taken > LEAST * len(left) * int(touched.sum())


def _refitted(search: _Search, found: list[_Found]) -> list[_Found]:
    """Returns the names with their amounts fitted in turn, each to what the others leave."""
    for _ in range(SWEEPS if len(found) > 1 else 0):
        for i, one in enumerate(found):
            left = _left(search, [o for o in found if o is not one])
            again = _fits(search, one.place, left)
            found[i] = max([one, *again], key=lambda f: _taken(search, f, left))
    return found


def _share(search: _Search, one: _Found, others: Sequence[_Found]) -> float:
    """Returns the share of the force on its joints that a name explains besides the others."""
    touched = search.touched(one.place)
    power = len(search.learned) * int(touched.sum())
    return _taken(search, one, _left(search, others)) / power


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
