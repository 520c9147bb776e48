"""How long a diagnosis will take about, by what its parts take on a small share of recordings."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from math import comb
from typing import TypeVar

import mujoco

from gfm.api.doctor.lines import doubt, well
from gfm.api.models import NominalModel
from gfm.api.recordings import cut_in_two, without_strangers
from gfm.core import Trajectory
from gfm.diagnosis.data.segmentation import all_segments, in_model_order, prepared
from gfm.diagnosis.found import SEARCHED_S
from gfm.effects import Scope, effect_library
from gfm.report.checks import Check
from gfm.sim.passive import with_idle_drives

DURATION = "time of a diagnosis"
#: Predictions of what a search looks at that a diagnosis takes, per candidate: where nothing is
#: to be found, and where play or elasticity is. Three simulated robots took 1.5, 3.5 and 25.
FEWEST, MOST = 1.0, 25.0
#: How often a diagnosis looks for contacts along its recordings, and what it takes besides, s.
_PASSES, _BESIDES_S = 6, 2.0
#: Recorded time on which parts are tried: of each recording an equal share, s.
_TRIED_S = 12.0

_NO_CONTACT = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)

T = TypeVar("T")


def how_long(nominal: NominalModel, recordings: Sequence[Trajectory]) -> Check:
    """Returns between what times a diagnosis will take on this machine, left alone.

    Args:
        nominal: Of the robot.
        recordings: What effects would be looked for in; nothing of them is refused.
    """
    known, _ = without_strangers(nominal.specs, recordings)
    specs, runs = with_idle_drives(nominal.specs, in_model_order(nominal.specs, known))
    whole_s = sum(run.duration_s for run in runs)
    share = min(_TRIED_S / whole_s, 1.0)
    heads = [cut_in_two(run, share)[0] if share < 1.0 else run for run in runs]
    segments, looking_s = _timed(lambda: all_segments(specs, heads, given=nominal.effects))
    if not all(spec.option.disableflags & _NO_CONTACT for spec in segments.specs.values()):
        found = "long: the robot is never in the air, contacts are simulated"
        return doubt(DURATION, found, "mend the contacts above, if they are not there")
    problem = prepared(segments)
    problem.position_errors(())  # starts the threads
    _, predicting_s = _timed(lambda: problem.position_errors(()))
    once_s = predicting_s * min(SEARCHED_S, whole_s) / (share * whole_s)
    places = candidates(len(runs[0].joint_names))
    besides_s = _BESIDES_S + _PASSES * looking_s / share
    least, most = (_words(besides_s + once_s * each * places) for each in (FEWEST, MOST))
    told = f"about {least} if little is wrong, up to {most} if much is"
    return well(DURATION, f"{told} (--minutes, 10, ends it with its best answer so far)")


def _timed(work: Callable[[], T]) -> tuple[T, float]:
    """Returns what work gives and takes, s, without what other jobs on the machine take."""
    began_s = time.process_time()
    return work(), time.process_time() - began_s


def candidates(joints: int) -> int:
    """Returns at how many places effects can act on a robot with so many joints."""
    counts = {Scope.JOINT: joints, Scope.PAIR: comb(joints, 2), Scope.OBJECT: 0}
    library = [effect for effect in effect_library().values() if effect.twin is None]
    return sum(counts.get(effect.scope, 1) for effect in library)


def _words(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 90.0 else f"{seconds / 60.0:.0f} min"
