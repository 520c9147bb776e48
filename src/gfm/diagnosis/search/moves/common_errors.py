"""Add what most models of real robots get wrong at once: gains, friction, inertia, a delay.

Where everything is a little wrong, no single effect explains much, and the one that explains most
may be none of those that are missing. Then common errors are fitted on all joints together, from
the best of a coarse grid; a model may also say too much of a joint. What does not earn its place
is removed later, by the score.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gfm.diagnosis.inference.amounts import acting
from gfm.diagnosis.inference.fitting import ROUGH, Fit, fit
from gfm.diagnosis.residuals.outliers import bounded
from gfm.diagnosis.search.candidates import Place
from gfm.diagnosis.search.hypothesis import FAR_OFF, Hypothesis, P
from gfm.diagnosis.search.moves.add import after, beside
from gfm.diagnosis.search.trace import Move, Step
from gfm.diagnosis.search.under_way import Search
from gfm.effects import EffectInstance, Key, Scales, Scope, find_effect

#: Share of the nominal misfit from which on common errors are looked for (where first order says
#: little, `FAR_OFF`, they always are), and of the room that a single effect gains at most.
MUCH, ENOUGH = 0.1, 0.5
#: Times that the grid is gone through.
PASSES = 2
#: Shares of a typical size at which amounts are tried, and of what a model says that is taken off.
SHARES, TAKEN_OFF = (0.0, 0.1, 0.3, 1.0, 3.0), (-1.0, -0.7, -0.4)
#: Effects of one parameter that a model may lack on any joint, with the values to begin with for a
#: joint with some scales. A soft servo looks late: how late commands are is told last.
COMMON: Mapping[str, Callable[[Scales], Sequence[float]]] = {
    "actuator_gain": lambda _: (0.01, 0.03, 0.1, 0.3, 1.0, 3.0),
    "coulomb_friction": lambda s: [x * s.torque_nm for x in SHARES],
    "viscous_friction": lambda s: [x * s.torque_nm / s.velocity_rad_s for x in SHARES],
    "armature": lambda s: [x * s.inertia for x in SHARES],
    "command_delay": lambda _: (0.0, 0.01, 0.02, 0.04, 0.08),
}
#: What the robot has of them without: as much as the model says, and once its gain.
NONE = dict.fromkeys(COMMON, 0.0) | {"actuator_gain": 1.0}
#: A joint that sticks hides what else it lacks, and a fit does not find its way out of that: one
#: begins without dry friction.
BEGUN_WITHOUT = ("", "coulomb_friction")


def common_errors(before: Hypothesis[P], search: Search[P], best: Step) -> Step | None:
    """Returns the step that adds common errors on all joints that something is missing on.

    None where that was tried, a single effect gains as much as single ones do, or the best step
    leaves nothing. Where rollouts stay near what was measured, several gain none where none does.
    """
    tried_before = any(step.move is Move.COMMON_ERRORS for step in search.steps)
    much = before.fit.cost > min(MUCH * float(np.mean(before.nominal)), FAR_OFF)
    alone = best.chosen is not None and len(best.chosen.new) == 1
    enough = alone and best.gain >= ENOUGH * before.room.nats
    left = after(before, best.chosen).is_open
    hopeless = best.chosen is None and before.fit.cost < FAR_OFF
    if tried_before or enough or hopeless or not (much and left and search.goes_on()):
        return None
    search.report("looking for common errors on all joints")
    begun = [_from_grid(before, search, without) for without in BEGUN_WITHOUT]
    new = max(begun, key=len)
    search.report(f"fitting {len(new)} effects together")
    fitted = min((_fitted_together(before, one) for one in begun), key=lambda f: f.cost)
    tried = beside(before, fitted)
    return Step(
        move=Move.COMMON_ERRORS,
        before=before.fit.cost,
        ranked=(tried,),
        chosen=tried if new and tried.gain.clear else None,
    )


def _fitted_together(before: Hypothesis, new: Sequence[EffectInstance]) -> Fit:
    effects = (*before.effects, *new)
    problem = before.problem.robust(effects)
    begun = acting(fit(problem, effects, tolerance=ROUGH).effects)
    return before.fitted(begun)


def _from_grid(before: Hypothesis[P], search: Search[P], without: str) -> list[EffectInstance]:
    """Returns every common error on every open joint, with the best of its grid.

    All joints are tried side by side: each takes what leaves least on itself. What is there already
    is left out; what comes to none on the grid may be found beside the others by a fit. What is
    called `without` is none to begin with.
    """
    problem, taken = before.problem, {e.key for e in before.effects}
    places = [
        place
        for place in search.candidates
        if place.effect.name in COMMON
        and place.key not in taken
        and set(place.joints) & set(before.open_joints)
    ]
    chosen = {place.key: NONE[place.effect.name] for place in places}
    for _ in range(PASSES):
        for name in [name for name in COMMON if name != without]:
            grids = {place.key: _grid(place) for place in places if place.effect.name == name}
            rows = [dict(zip(grids, row, strict=True)) for row in zip(*grids.values(), strict=True)]
            if not rows:
                continue
            sets = [(*before.effects, *_instances(places, {**chosen, **row})) for row in rows]
            left = bounded(problem.coarse().residuals(sets), problem.limits())
            costs = np.stack([problem.joint_costs(r) for r in left])
            if find_effect(name).scope is not Scope.JOINT:
                costs[:] = costs.mean(axis=1, keepdims=True)
            best = dict(zip(problem.joints, costs.argmin(axis=0).tolist(), strict=True))
            chosen |= {key: grid[best[key[1][0]]] for key, grid in grids.items()}
    return _instances(places, chosen)


def _grid(place: Place) -> list[float]:
    """Returns the amounts to try somewhere, what can be taken off among them."""
    least = min(place.least.values(), default=0.0)
    return [*COMMON[place.effect.name](place.scales), *(-x * least for x in TAKEN_OFF)]


def _instances(places: Sequence[Place], amounts: Mapping[Key, float]) -> list[EffectInstance]:
    """Returns the effects in some amounts."""
    return [
        place.instance({place.effect.parameters[0].name: float(amounts[place.key])})
        for place in places
    ]
