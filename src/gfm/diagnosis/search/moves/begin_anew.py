"""Settle amounts from another beginning: what the missing torque tells of all of them at once.

Where laws stand for one another, rollouts have several valleys, and a fit ends in the one where it
begins: each effect began beside those before it. A linear regression has no valleys.
"""

from __future__ import annotations

from functools import partial

from gfm.diagnosis.inference.fitting import fit
from gfm.diagnosis.inference.score import NOTHING, difference
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.read_off import told_together
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search


def begun_anew(here: Hypothesis[P], search: Search[P]) -> Hypothesis[P]:
    """Returns a hypothesis with amounts from a fit that begins with what the missing torque tells.

    If that predicts better, or as well (to within one standard error) with amounts nearer to the
    missing torque: that is the other witness. The same as it was where nothing is left, and where
    the fit leads back to it.
    """
    domain = search.witness or search.torques
    if domain is None or not (here.effects and here.room.clear):
        return here
    search.report("fitting anew, from the amounts that the missing torque tells")
    told = told_together(domain, here.effects)
    begun = search.in_its_time(partial(fit, here.problem, told), here.fit)
    if here.over(begun).same:
        return here
    search.report("settling what that led to")
    tried = Tried(new=(), fit=begun, gain=NOTHING)
    step = Step(move=Move.MISSING_TORQUE, before=here.fit.cost, chosen=tried)
    there = search.in_its_time(partial(search.after, here, step), here)
    gain = difference(here.problem.blocks, there.predictive, here.predictive)
    unlike = [sum(domain.disagreement(one.effects).values()) for one in (there, here)]
    nearer = unlike[0] < unlike[1] and not (-gain).notable
    return there if gain.notable or nearer else here
