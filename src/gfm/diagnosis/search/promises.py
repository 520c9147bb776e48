"""What screening promises: which candidates a fit could gain anything clear by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from gfm.diagnosis.inference.fitting import measured
from gfm.diagnosis.inference.score import Difference
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import Hypothesis
from gfm.diagnosis.search.screening import Screened, screen
from gfm.effects import EffectInstance
from gfm.sim.plant import acts_on_command

#: Recorded time on which all candidates are looked at, and on which the best of them are, s.
GLANCE_S, SCREENING_S = 8.0, 24.0
#: Candidates that are looked at again.
LOOKED_AT = 16
#: Times what screening shows that a fit gains at most.
FIT_GAINS = 4.0


def promising(before: Hypothesis, places: Sequence[Place]) -> list[Screened]:
    """Returns the candidates that promise most, best first: at a glance, then the best.

    Motors apart from their links, which take longest, only if they promise anything at a glance.
    """
    glanced = [
        one
        for one in screen(before, places, GLANCE_S)
        if promise((one,)).notable or not one.instance.effect.separates_motor
    ]
    again = list(dict.fromkeys(one.instance.key for one in glanced))[:LOOKED_AT]
    best = screen(before, [p for p in places if p.key in again], SCREENING_S)
    return _without_jumps(before, places, best)


def _without_jumps(
    before: Hypothesis, places: Sequence[Place], screened: Sequence[Screened]
) -> list[Screened]:
    """Returns candidates, of those that jump and promise nothing what positions alone show."""
    hidden = {
        one.instance.key
        for one in screened
        if jumps(before, one.instance) and not promise((one,)).clear
    }
    if not hidden:
        return list(screened)
    problem = before.problem.positions_alone()
    alone = replace(before, problem=problem, fit=measured(problem, before.effects))
    seen = screen(alone, [p for p in places if p.key in hidden], SCREENING_S)
    others = [one for one in screened if one.instance.key not in hidden]
    return sorted([*others, *seen], key=lambda one: -one.gain.nats)


def jumps(before: Hypothesis, instance: EffectInstance) -> bool:
    """Returns whether a small amount of an effect tells nothing of a larger one.

    An effort beside the command of its stamp jumps when a delay goes past it; a position does not.
    """
    return before.problem.has_efforts and acts_on_command(instance)


def promise(together: Sequence[Screened]) -> Difference:
    """Returns by how much a fit of candidates together would predict better at most.

    Its error grows with the root of that, as the one that noise makes of a difference.
    """
    gains = [one.gain for one in together]
    nats, error = sum(gain.nats for gain in gains), math.hypot(*(gain.error for gain in gains))
    return Difference(FIT_GAINS * nats, math.sqrt(FIT_GAINS) * error)
