"""Add the laws that the missing torque shows together, where rollouts are far from the truth.

Far off, a rollout goes where the robot never was, and the single effect that gains most there may
be none of those that are missing. Along the measured motion what is missing is the sum of laws
times their amounts, whatever those are: laws are taken one by one, each beside those before it
(orthogonal matching pursuit; Pati et al. 1993). The fit and the score are of rollouts, as always.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import FAR_OFF, Hypothesis, P
from gfm.diagnosis.search.moves.add import along_its_valley, beside
from gfm.diagnosis.search.read_off import read_off
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance
from gfm.signals.torques import TorqueView

#: Share of what is left of a joint's missing torque from which on a law is taken, and by which
#: simpler ones may explain less; laws of one joint at most.
SHOWN, MOST_LAWS = 0.1, 3


def missing_torque(before: Hypothesis[P], search: Search[P], best: Step) -> Step | None:
    """Returns the step that adds the laws that the missing torque shows.

    None for fewer than two, and where rollouts stay near the truth. It chooses them where they
    predict clearly better than the best step so far.
    """
    if search.view is None or before.fit.cost < FAR_OFF or not search.goes_on():
        return None
    new = _shown(search.view, before, search.candidates)
    if len(new) < 2:
        return None
    search.report(f"fitting {len(new)} laws that the missing torque shows")
    tried = search.in_its_time(partial(_tried, before, new), None, step=True)
    if tried is None:
        return None
    there = replace(before, fit=tried.fit)
    good = tried.gain.clear and (best.chosen is None or there.over(best.chosen.fit).clear)
    return Step(
        move=Move.MISSING_TORQUE,
        before=before.fit.cost,
        ranked=(tried,),
        chosen=tried if good else None,
    )


def _tried(before: Hypothesis, new: Sequence[EffectInstance]) -> Tried:
    """Returns new effects fitted beside those that are there, as far as their valley leads."""
    fitted = beside(before, before.fitted((*before.effects, *new)))
    return along_its_valley(before, [fitted])[0]


def _shown(
    view: TorqueView, before: Hypothesis, candidates: Sequence[Place]
) -> list[EffectInstance]:
    """Returns laws that are not there yet, with the amounts that explain most together."""
    found: list[EffectInstance] = []
    for joint in before.open_joints:
        places = [place for place in candidates if place.joints == (joint,)]
        known = [e for e in before.effects if e.has_law and joint in e.joints]
        found += _of_joint(view, view.joints.index(joint), places, known)
    return found


def _of_joint(
    view: TorqueView, joint: int, places: Sequence[Place], known: Sequence[EffectInstance]
) -> list[EffectInstance]:
    """Returns the laws of one joint that its missing torque shows, beside those known."""
    missing, laws = view.missing[:, joint], list(known)

    def column(one: EffectInstance) -> Array:
        return np.asarray(view.law(one)[:, joint])

    while len(laws) - len(known) < MOST_LAWS:
        basis = orthonormal(np.stack([np.zeros_like(missing), *map(column, laws)], axis=1))
        left, taken = without(missing, basis), {one.key for one in laws}
        rest = read_off(view, [place for place in places if place.key not in taken], laws)
        shares = np.array([_share(without(column(one), basis), left) for one in rest])
        if not (shares >= SHOWN).any():
            break
        near = np.flatnonzero(shares >= (1.0 - SHOWN) * shares.max())
        laws.append(rest[min(near, key=lambda i: (len(rest[i].effect.parameters), -shares[i]))])
    factors = np.linalg.lstsq(np.stack([missing * 0.0, *map(column, laws)], axis=1), missing)[0]
    own = zip(laws[len(known) :], factors[1 + len(known) :].tolist(), strict=True)
    return [_times(factor, one) for one, factor in own if factor > 0.0]


def _share(column: Array, left: Array) -> float:
    """Returns the share of the squares of what is left that a law explains in some amount."""
    along, size = float(column @ left), float(column @ column)
    return along**2 / max(size * float(left @ left), 1e-12)


def _times(factor: float, one: EffectInstance) -> EffectInstance:
    """Returns so many times as much of an effect."""
    first = one.effect.parameters[0].name
    return replace(one, values={**one.values, first: factor * one.values[first]})
