"""What speaks for each effect of a hypothesis: what it predicts, and whether its law holds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.amounts import amounts, free_parameters
from gfm.diagnosis.inference.constants import UNWEIGHED
from gfm.diagnosis.inference.fitting import always
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.inference.steadiness import apart, bends
from gfm.diagnosis.residuals.outliers import slopes
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.moves.reduce import Compared, gains_of_each
from gfm.diagnosis.search.nameless import bent_by, laws_of, nameless_laws
from gfm.diagnosis.search.trace import Evidence, Nameless
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, Key
from gfm.effects.bent import SLIGHTLY, slightly
from gfm.signals.torque_domain import TorqueDomain


def support(
    here: Hypothesis[P], search: Search[P], compared: Sequence[Compared]
) -> dict[Key, Evidence]:
    """Returns what speaks for each effect of a hypothesis, also beside its best rival.

    For those that a few segments judge, what spoke for them there: all others know nothing of it.
    """
    rivals = {one.instance.key: one for one in compared}
    steady, gains = _steadiness(here, search.torques), gains_of_each(here)
    nats = {instance.key: gain.nats for gain, instance in gains}
    nothing = dict[Key, Nameless]()
    nameless = search.in_its_time(partial(nameless_laws, here, search, nats), nothing)
    witness = search.witness or search.torques
    unlike = witness.disagreement(here.effects) if witness else {}
    told = {}
    for without, instance in gains:
        beside = rivals.get(instance.key, Compared(instance=instance))
        rival = -beside.rival.gain if beside.rival else None
        unweighed = Difference(UNWEIGHED * without.nats, without.error)
        told[instance.key] = Evidence(
            without=search.held.get(instance.key, without),
            rival=rival if beside.weighed else unweighed,
            by=beside.rival.new[0] if beside.rival else None,
            apart=steady[instance.key][0],
            bends=steady[instance.key][1],
            disagrees=unlike.get(instance.key, 0.0),
            nameless=nameless.get(instance.key),
        )
    return told


def _steadiness(here: Hypothesis, domain: TorqueDomain | None) -> dict[Key, tuple[float, float]]:
    """Returns for each effect by what share of itself it may differ between parts of the data.

    And how much of what is left on its joint its law would explain if it were bent. Laws of one
    state of one joint are one law, as terms of a series are: they are asked together.
    """
    fitted, blocks, steady = here.fit, here.problem.blocks, always(here.fit)
    weights = slopes(fitted.residual, here.problem.limits())
    told = dict[Key, tuple[float, float]]()
    for law in laws_of(here.effects):
        own = np.array([one in law for one in fitted.effects])[fitted.owners]
        beside = own | steady  # what acts now and then, a part may not know
        known = replace(fitted, jacobian=fitted.jacobian[:, beside])
        parts = apart(known, blocks, own[beside], _does(here, law, weights))
        bend = 0.0
        if straight := list(bent_by(here, law, domain).values()):
            joint = here.problem.joints.index(law[0].joints[0])
            bend = bends(known, _ways(here, straight) * weights[:, None], blocks, joint)
        told |= dict.fromkeys((one.key for one in law), (parts, bend))
    return told


def _does(here: Hypothesis, law: Sequence[EffectInstance], weights: Array) -> Array:
    """Returns what a law does in the residual, by which other amounts of it are measured, (N,).

    To first order, as what other amounts would do. Where no amount is none, by rollouts without it;
    or to first order, if that is less: any larger amount would do as well.
    """
    free, linear = free_parameters(here.effects), here.fit.jacobian * amounts(here.effects)
    told = {(one.key, name) for one in law for name in one.effect.how_much}
    if all(one.effect.how_much for one in law):
        own = [(here.effects[i].key, name) in told for i, name in free]
        return np.asarray(linear[:, own].sum(axis=1))
    own = [here.effects[i] in law for i, _ in free]
    sets = [here.effects, [one for one in here.effects if one not in law]]
    whole, without = here.problem.plain().residuals(sets)
    both = (without - whole) * weights, linear[:, own].sum(axis=1)
    return np.asarray(min(both, key=np.linalg.norm))


def _ways(here: Hypothesis, straight: Sequence[EffectInstance]) -> Array:
    """Returns what a law changes in the residual, bent in K ways, by its size, shape (N, K)."""
    sets = [(*here.effects, way) for one in straight for way in slightly(one)]
    still, *rows = here.problem.coarse().residuals([(*here.effects, straight[0]), *sets])
    return np.stack([(row - still) / SLIGHTLY for row in rows], axis=1)
