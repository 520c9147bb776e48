"""How long a diagnosis will take about, by what one prediction of the recordings takes here."""

from __future__ import annotations

import time
from collections.abc import Sequence
from math import comb

from gfm.api.doctor.lines import well
from gfm.api.models import NominalModel
from gfm.api.recordings import without_strangers
from gfm.core import Trajectory
from gfm.diagnosis.data.segmentation import all_segments, in_model_order, prepared
from gfm.diagnosis.found import SEARCHED_S
from gfm.effects import Scope, effect_library
from gfm.report.checks import Check
from gfm.sim.passive import with_idle_drives

DURATION = "time of a diagnosis"
#: Predictions of what a search looks at that a diagnosis takes, per candidate: where nothing is
#: to be found, and where play or elasticity is (measured on nine simulated robots).
FEWEST, MOST = 0.7, 15.0
#: What a command takes besides, s.
_BESIDES_S = 2.0


def how_long(nominal: NominalModel, recordings: Sequence[Trajectory]) -> Check:
    """Returns between what times a diagnosis will take on this machine, left alone.

    Args:
        nominal: Of the robot.
        recordings: What effects would be looked for in; nothing of them is refused.
    """
    known, _ = without_strangers(nominal.specs, recordings)
    specs, runs = with_idle_drives(nominal.specs, in_model_order(nominal.specs, known))
    problem = prepared(all_segments(specs, runs, given=nominal.effects), SEARCHED_S)
    problem.position_errors(())  # starts the threads
    began_s = time.process_time()  # another job on the machine is none of this one's work
    problem.position_errors(())
    one_s = time.process_time() - began_s
    least, most = (
        _BESIDES_S + one_s * per_candidate * candidates(len(runs[0].joint_names))
        for per_candidate in (FEWEST, MOST)
    )
    told = f"about {_words(least)} if little is wrong, up to {_words(most)} if much is"
    return well(DURATION, f"{told} (ends after --minutes, 10, with its best answer so far)")


def candidates(joints: int) -> int:
    """Returns at how many places effects can act on a robot with so many joints."""
    counts = {Scope.JOINT: joints, Scope.PAIR: comb(joints, 2), Scope.OBJECT: 0}
    library = [effect for effect in effect_library().values() if effect.twin is None]
    return sum(counts.get(effect.scope, 1) for effect in library)


def _words(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
