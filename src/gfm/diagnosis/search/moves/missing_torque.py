"""Add the laws that the missing torque shows together, where rollouts are far from the truth.

Far off, a rollout goes where the robot never was, and the single effect that gains most there may
be none of those that are missing. Along the measured motion what is missing is the sum of laws
times their amounts, whatever those are: laws are taken one by one, each beside those before it
(orthogonal matching pursuit; Pati et al. 1993). The fit and the score are of rollouts, as always.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gfm.core.checks import Array
from gfm.diagnosis.inference.fitting import without
from gfm.diagnosis.residuals.initial_states import orthonormal
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import FAR_OFF, Hypothesis, P
from gfm.diagnosis.search.moves.add import beside
from gfm.diagnosis.search.trace import Move, Step
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance
from gfm.effects.friction import SIGN_WIDTH_RAD_S
from gfm.signals.torques import TorqueView

#: Share of what is left of a joint's missing torque from which on a law is taken, and by which
#: simpler ones may explain less; laws of one joint at most.
SHOWN, MOST_LAWS = 0.1, 3
#: Speed from which on a joint moves, rad/s: at rest dry friction is whatever holds it.
MOVES_RAD_S = 3.0 * SIGN_WIDTH_RAD_S


def missing_torque(before: Hypothesis[P], search: Search[P], best: Step) -> Step | None:
    """Returns the step that adds the laws that the missing torque shows; None for fewer than two.

    And where rollouts stay near the truth. Simpler ones that predict as well are preferred.
    """
    if search.view is None or before.fit.cost < FAR_OFF or not search.goes_on():
        return None
    new = _shown(search.view, before, search.candidates)
    if len(new) < 2:
        return None
    search.report(f"fitting {len(new)} laws that the missing torque shows")
    fitted = search.in_its_time(lambda: before.fitted((*before.effects, *new)), None, step=True)
    if fitted is None:
        return None
    tried = beside(before, fitted)
    there = replace(before, fit=fitted)
    good = tried.gain.clear and (best.chosen is None or there.over(best.chosen.fit).clear)
    return Step(
        move=Move.MISSING_TORQUE,
        before=before.fit.cost,
        ranked=(tried,),
        chosen=tried if good else None,
    )


def _shown(
    view: TorqueView, before: Hypothesis, candidates: Sequence[Place]
) -> list[EffectInstance]:
    """Returns laws that are not there yet, with the amounts that explain most together."""
    taken = {e.key for e in before.effects}
    known = [e for e in before.effects if e.has_law]
    found: list[EffectInstance] = []
    for joint in before.open_joints:
        places = [p for p in candidates if p.joints == (joint,) and p.key not in taken]
        found += _of_joint(view, joint, places, [e for e in known if joint in e.joints])
    return found


def _of_joint(
    view: TorqueView, joint: str, places: Sequence[Place], known: Sequence[EffectInstance]
) -> list[EffectInstance]:
    """Returns the laws of one joint that its missing torque shows, beside those known."""
    j = view.joints.index(joint)
    moves = np.abs(view.velocity[:, j]) > MOVES_RAD_S

    def column(one: EffectInstance) -> Array:
        return np.asarray(view.law(one)[moves, j])

    groups = [
        (place, group, np.stack([column(one) for one in group], axis=1))
        for place in places
        for group in place.probes
        if all(one.has_law for one in group)
    ]
    nothing = np.zeros(int(moves.sum()))
    told = np.stack([nothing, *(column(one) for one in known)], axis=1)
    chosen: list[tuple[Place, list[EffectInstance], Array]] = []
    found: list[EffectInstance] = []
    while len(chosen) < MOST_LAWS and len(found) == len(chosen):
        columns = np.concatenate([told, *(one[2] for one in chosen)], axis=1)
        basis = orthonormal(columns)
        left = without(view.missing[moves, j], basis)
        keys = {place.key for place, *_ in chosen}
        rest = [one for one in groups if one[0].key not in keys]
        shares = np.array([_share(without(one[2], basis), left) for one in rest])
        if not (shares >= SHOWN).any():
            break
        near = np.flatnonzero(shares >= (1.0 - SHOWN) * shares.max())
        chosen.append(rest[min(near, key=lambda i: (rest[i][2].shape[1], -shares[i]))])
        found = _in_amounts(view.missing[moves, j], told, chosen)
    return found if len(found) == len(chosen) else []


def _share(columns: Array, left: Array) -> float:
    """Returns the share of squares that columns explain of what is left."""
    explained = columns @ np.linalg.lstsq(columns, left, rcond=1e-6)[0]
    return float(explained @ explained) / max(float(left @ left), 1e-12)


def _in_amounts(
    missing: Array, told: Array, chosen: Sequence[tuple[Place, list[EffectInstance], Array]]
) -> list[EffectInstance]:
    """Returns laws in the amounts that explain most together; without those that cannot have it."""
    columns = np.concatenate([told, *(one[2] for one in chosen)], axis=1)
    amounts = np.linalg.lstsq(columns, missing, rcond=1e-6)[0][told.shape[1] :]
    found = []
    for place, group, own in chosen:
        mine, amounts = np.split(amounts, [own.shape[1]])
        values = place.effect.combine([one.values for one in group], mine.tolist())
        if values is not None:
            found.append(place.instance(values))
    return found
