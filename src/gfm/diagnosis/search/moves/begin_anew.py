"""Settle amounts from another beginning: what the missing torque tells of all of them at once.

Where laws stand for one another, rollouts have several valleys, and a fit ends in the one where it
begins: each effect began beside those before it. A linear regression has no valleys.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from gfm.diagnosis.inference.score import NOTHING, difference
from gfm.diagnosis.search.hypothesis import Hypothesis, P
from gfm.diagnosis.search.read_off import told_together
from gfm.diagnosis.search.trace import Move, Step, Tried
from gfm.diagnosis.search.under_way import Search


def begun_anew(here: Hypothesis[P], search: Search[P]) -> Hypothesis[P]:
    """Returns a hypothesis with amounts from a fit that begins with what the missing torque tells.

    If that predicts better, or as well (to within one standard error) with amounts nearer to the
    missing torque: that is the other witness. Where nothing is left, the same as it was.
    """
    domain = search.witness or search.torques
    if domain is None or not (here.effects and here.room.clear):
        return here
    if (told := told_together(domain, here.effects)) == here.effects:
        return here  # of none of them it tells anything
    search.report("settling amounts anew, from those that the missing torque tells")
    begun = Tried(new=(), fit=replace(here.fit, effects=told), gain=NOTHING)
    step = Step(move=Move.MISSING_TORQUE, before=here.fit.cost, chosen=begun)
    there = search.in_its_time(partial(search.after, here, step), here)
    gain = difference(here.problem.blocks, there.predictive, here.predictive)
    unlike = [sum(domain.disagreement(one.effects).values()) for one in (there, here)]
    nearer = unlike[0] < unlike[1] and not (-gain).notable
    return there if gain.notable or nearer else here
