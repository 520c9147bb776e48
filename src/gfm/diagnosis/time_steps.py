"""Time steps on which a diagnosis simulates: as long as what is predicted hardly depends on them.

Models come with steps that suit their own integrators. Integrated to fourth order, most do with
longer ones; a stiff servo on a light link needs a shorter one, or its rollouts run away. Where the
link is lighter still (arms that are modelled without rotors), no step is short enough for that, and
the model is integrated implicitly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.diagnosis.problem import Problem, Stepping
from gfm.effects import EffectInstance

#: Longest step that is taken, s.
LONGEST_S = 2e-3
#: Times that a model's own step is halved at most.
MOST_HALVED = 4
#: By how much a longer step may change what a joint leaves, RMS: in units of the noise, and as a
#: share of it, whichever is more.
HARDLY, HARDLY_OF_IT = 0.1, 0.01
#: The same of the model's own step, halved, from which on it is too long.
TOO_MUCH, TOO_MUCH_OF_IT = 10.0, 0.3
#: Recorded time on which steps are compared (of an arm; of smaller robots more), s.
COMPARED_S = 6.0


def with_suitable_steps(problem: Problem, effects: Sequence[EffectInstance] = ()) -> Problem:
    """Returns the problem with the time steps that suit its models with `effects` in them.

    As it is where a motor is apart from its link: those are simulated on steps of their own.
    """
    if problem.motors_apart([effects]):
        return problem
    part = problem.subset(problem.sample(COMPARED_S))
    stepping = {kind: _suitable(part, kind, spec, effects) for kind, spec in problem.specs.items()}
    return replace(problem, stepping=stepping)


def _suitable(
    problem: Problem, kind: CommandKind, spec: mujoco.MjSpec, effects: Sequence[EffectInstance]
) -> Stepping:
    """Returns what suits the model of one kind of command."""
    own_s = float(spec.option.timestep)
    of_kind = problem.subset([i for i, s in enumerate(problem.segments) if s.kind is kind])
    if not of_kind.segments:
        return Stepping(step_s=own_s)
    for implicit in (True,) if problem.is_implicit(kind) else (False, True):
        found = _long_enough(of_kind, effects, Stepping(step_s=own_s, implicit=implicit))
        if found is not None:
            return found
    return Stepping(step_s=own_s / 2.0 ** (MOST_HALVED - 1), implicit=True)


def _long_enough(
    problem: Problem, effects: Sequence[EffectInstance], own: Stepping
) -> Stepping | None:
    """Returns the longest step that does; None where even the shortest does not."""
    longer = int(np.log2(max(LONGEST_S / own.step_s, 1.0)) + 1e-9)
    for n in range(longer, 0, -1):
        one = replace(own, step_s=own.step_s * 2.0**n)
        if _agree(problem, effects, own, one, HARDLY, HARDLY_OF_IT):
            return one
    for n in range(MOST_HALVED):
        one = replace(own, step_s=own.step_s / 2.0**n)
        if _agree(problem, effects, one.halved(), one, TOO_MUCH, TOO_MUCH_OF_IT):
            return one
    return None


def _agree(
    problem: Problem,
    effects: Sequence[EffectInstance],
    finer: Stepping,
    coarser: Stepping,
    least: float,
    share: float,
) -> bool:
    """Returns whether two steps leave nearly the same on every joint, and neither breaks off."""
    kinds = list(problem.specs)
    accurate, other = (
        replace(problem, stepping=dict.fromkeys(kinds, one)).predictions([effects])[0]
        for one in (finer, coarser)
    )
    if any(p.diverged for p in (*accurate, *other)):
        return False
    left, others = (
        np.concatenate([problem.whitened(*row) for row in zip(problem.segments, told, strict=True)])
        for told in (accurate, other)
    )
    change, size = np.sqrt(problem.joint_costs(others - left)), np.sqrt(problem.joint_costs(left))
    return bool((change <= np.maximum(least, share * size)).all())
