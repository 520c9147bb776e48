"""Laws without a name: what acts where the library has nothing, told as what comes nearest to it.

Two things give them away. Of several laws of one state of a joint, one whose amount changes with
that state predicts better than all, or any curve over it does; what says nothing beside that is
part of it. Whether a lone law bends is told to first order (`steadiness.bends`); far from the truth
it is fitted bent as well, and gives way where a tenth of what was left stays at most. And there the
missing torque may show such a curve: it predicts better than a name that adds nothing clear to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from gfm.diagnosis.inference.fitting import Fit, mean_square, without
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import FAR_OFF, Hypothesis, P
from gfm.diagnosis.search.naming import first_of_each, grouped
from gfm.diagnosis.search.read_off import ALIKE, basis_of, column, read_off, whitened
from gfm.diagnosis.search.trace import Nameless
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, Key, Motion
from gfm.effects.bent import bent, ways_to_bend
from gfm.effects.curve import CURVE_OF
from gfm.effects.effect import DRIVE
from gfm.signals.torque_domain import TorqueDomain

#: States over which a curve may stand for any effect. A drive bears whatever acts: not over that.
STATES = ("position", "velocity")


def nameless_laws(
    here: Hypothesis[P], search: Search[P], nats: Mapping[Key, float]
) -> dict[Key, Nameless]:
    """Returns what speaks for effects against laws without a name that predict better.

    Known ones are told where they predict as well, to within one standard error.

    Args:
        here: The hypothesis.
        search: With the recordings as torques, if they can be seen so.
        nats: By how much the hypothesis predicts better than without each effect.
    """
    return dict(_one_law(here, search, nats)) | dict(_curve(here, search))


def laws_of(effects: Sequence[EffectInstance]) -> list[list[EffectInstance]]:
    """Returns effects, those together that are laws of one state of one joint."""
    return grouped(effects, lambda one: (one.effect.law_of or one.key, one.joints))


def bent_by(
    here: Hypothesis, law: Sequence[EffectInstance], domain: TorqueDomain | None
) -> dict[str, EffectInstance]:
    """Returns what bends a law over states of its joint, by state; torques tell that of a drive."""
    if not any(map(ways_to_bend, law)) or (domain is None and law[0].effect.law_of == DRIVE):
        return {}
    joint = here.problem.joints.index(law[0].joints[0])
    position, velocity = (state[:, joint] for state in here.problem.states())
    drive = position if domain is None else domain.view.drive[:, joint]
    return bent(law, Motion(position=position, velocity=velocity, drive=drive))


def _one_law(
    here: Hypothesis[P], search: Search[P], nats: Mapping[Key, float]
) -> Iterator[tuple[Key, Nameless]]:
    """Yields laws of one state that stand for another: the strongest, bent; or a curve."""
    most = here.problem.joints[int(np.argmax(here.problem.joint_costs(here.fit.residual)))]
    far_off = [most] if here.fit.cost > FAR_OFF else []
    for law in laws_of(here.effects):
        torques, state = [one for one in law if ways_to_bend(one)], law[0].effect.law_of
        lone = len(law) < 2
        if state is None or not torques or (lone and law[0].joints[0] not in far_off):
            continue
        rest = [one for one in here.effects if one not in law]
        alone = here.fitted([*rest, max(torques, key=lambda one: nats[one.key])])
        bends = bent_by(here, alone.effects[-1:], search.torques)
        instead = [(*alone.effects, bends[state])] if state in bends else []
        places = [place for place in search.candidates if place.joints == law[0].joints]
        if search.torques is not None and places:
            curves = _shown(search.torques, places[0], [state], rest)
            instead += [(*rest, curve) for _, _, curve in curves]
        fits = map(here.fitted, instead)
        best = min(fits, key=lambda one: here.over(one).nats, default=here.fit)
        over, nearly_all = here.over(best), best.cost < (1.0 - ALIKE) * here.fit.cost
        if (-over).notable and (nearly_all or not lone):
            told = Nameless(over=over, state=state, joint=law[0].joints[0])
            parts = [one for one in rest if one.joints == law[0].joints]
            yield from ((one.key, told) for one in (*law, *_adding_nothing(here, best, parts)))


def _adding_nothing(
    here: Hypothesis, best: Fit, parts: Sequence[EffectInstance]
) -> list[EffectInstance]:
    """Returns effects that say something, and nothing beside a law without a name: its part.

    A load on a pendulum is a law of its position.
    """
    beside = replace(here, fit=best)
    gains = here.over_less([(here.effects.index(one),) for one in parts])
    saying = [one for gain, one in zip(gains, parts, strict=True) if gain.notable]
    rests = [[e for e in best.effects if e.key != one.key] for one in saying]
    rows = zip(saying, rests, strict=True)
    return [one for one, rest in rows if not beside.over(here.fitted(rest)).notable]


def _curve(here: Hypothesis[P], search: Search[P]) -> Iterator[tuple[Key, Nameless]]:
    """Yields effects for which the curve stands that explains most of a joint's missing torque.

    None near the truth, and of laws of one state: those are asked whether they bend.
    """
    asked = [e for e in here.effects if not (e.effect.law_of in STATES or e.effect.intermittent)]
    places = first_of_each([p for p in search.candidates if len(p.joints) == 1], lambda p: p.joints)
    left = here.problem.plain().residuals([here.effects])[0]
    if search.torques is None or not (asked and places) or mean_square(left) < FAR_OFF:
        return
    for one in asked:
        rest = [effect for effect in here.effects if effect is not one]
        shown = [law for at in places for law in _shown(search.torques, at, STATES, rest)]
        share, state, curve = max(shown, key=lambda law: law[0])
        over = here.over(instead := here.fitted([*rest, curve]))
        better = over.nats < 0.0 if share > ALIKE else (-over).notable
        both = replace(here, fit=here.fitted([*here.effects, curve])) if better else here
        if better and not both.over(instead).clear:
            yield one.key, Nameless(over=over, state=state, joint=curve.joints[0])


def _shown(
    domain: TorqueDomain, candidate: Place, states: Sequence[str], others: Sequence[EffectInstance]
) -> Iterator[tuple[float, str, EffectInstance]]:
    """Yields curves over states of a joint, beside others, and their share of its torque."""
    joints = domain.problem.joints
    motion = domain.view.motion(j := joints.index(candidate.joints[0]))
    missing, basis = whitened(domain, domain.missing()), basis_of(domain, others)
    for state in states:
        place = replace(candidate, effect=CURVE_OF[state](motion))
        for one, *_ in read_off(domain, place, without(missing, basis), basis):
            of_joint = np.stack([missing, missing - column(domain, one)], axis=1)
            whole, left = np.sum(of_joint.reshape(-1, len(joints), 2)[:, j] ** 2, 0)
            yield 1.0 - left / max(whole, 1e-12), state, one
