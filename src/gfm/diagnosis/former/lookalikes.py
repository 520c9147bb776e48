"""Effects that were found while others were missing, exchanged for their lookalikes.

The first effects of a search are chosen while later ones are missing, and bent to stand for those,
too: a spring whose rest is far away, for a constant torque. Beside the later ones, another law of
nearly the same torque may explain more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from gfm.diagnosis.former.attribution import Round, worth_it
from gfm.diagnosis.inference.fitting import Fit, at_bound, fit
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.search.candidates import Place, TorqueView, law_along
from gfm.diagnosis.search.naming import describe
from gfm.diagnosis.search.screening import probes, weigh
from gfm.effects import EffectInstance, Scales

#: Share of an effect's squared torque that a lookalike gives.
ALIKE = 0.8


def exchanges(
    problem: Problem,
    found: Fit,
    candidates: Sequence[Place],
    scales: Sequence[Scales],
    views: Sequence[TorqueView],
    report: Callable[[str], None] = lambda _: None,
) -> tuple[Round, ...]:
    """Returns the rounds in which an effect made way for a lookalike that explains more.

    One that was found alone had its rivals: there is nothing that came after it.

    Args:
        problem: What is to be explained.
        found: What was found.
        candidates: What may explain it.
        scales: Of every joint's signals.
        views: The motion along which torques are compared.
        report: Told what is happening, in words.
    """
    rounds: list[Round] = []
    best = found
    for here in found.effects if len(found.effects) > 1 else ():
        rest = tuple(e for e in best.effects if e.key != here.key)
        taken = {e.key for e in best.effects}
        others = [p for p in candidates if p.key not in taken and not p.effect.costly]
        for other in lookalikes(here, problem, others, scales, views):
            report(f"trying {describe(other)} in the place of {describe(here)}")
            changed = fit(problem, (*rest, other))
            if worth_it(problem, changed, best) and not at_bound(changed.effects[-1]):
                rounds.append(_round(best, changed, here))
                best = changed
                break
    return tuple(rounds)


def _round(before: Fit, after: Fit, instead_of: EffectInstance) -> Round:
    return Round(
        before=before.cost, screened=(), fits=(after,), accepted=after, instead_of=instead_of
    )


def lookalikes(
    instance: EffectInstance,
    problem: Problem,
    candidates: Sequence[Place],
    scales: Sequence[Scales],
    views: Sequence[TorqueView],
) -> list[EffectInstance]:
    """Returns the candidates that give nearly the torque of an effect, in the amounts that do.

    The most alike first; none of an effect whose law is no torque.
    """
    joint = problem.joints.index(instance.joints[0]) if instance.joints else 0
    torque = law_along(joint, instance, problem.joints, views)
    if not torque.any():
        return []
    here = [place for place in candidates if place.joints == instance.joints]
    weighed = []
    for place, group in probes(problem, here, scales):
        columns = np.stack([law_along(joint, e, problem.joints, views) for e in group], axis=1)
        if columns.any():
            weighed.append(weigh(place, group, columns, torque))
    alike = [one for one in weighed if one is not None and one.gain > ALIKE]
    return [one.instance for one in sorted(alike, key=lambda one: -one.gain)]
