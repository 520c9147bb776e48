"""Time steps on which a diagnosis simulates: as long as what is predicted hardly depends on them.

Models come with steps that suit their own integrators. Integrated to fourth order, most do with
longer ones; a stiff servo on a light link needs a shorter one, or its rollouts run away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.diagnosis.problem import Problem
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
    steps_s = {kind: _suitable(part, kind, spec, effects) for kind, spec in problem.specs.items()}
    return replace(problem, steps_s=steps_s)


def _suitable(
    problem: Problem, kind: CommandKind, spec: mujoco.MjSpec, effects: Sequence[EffectInstance]
) -> float:
    """Returns the step that suits the model of one kind of command, s."""
    own = float(spec.option.timestep)
    of_kind = problem.subset([i for i, s in enumerate(problem.segments) if s.kind is kind])
    if not of_kind.segments:
        return own
    longer = int(np.log2(max(LONGEST_S / own, 1.0)) + 1e-9)
    for step in (own * 2.0**n for n in range(longer, 0, -1)):
        if _agree(of_kind, effects, own, step, HARDLY, HARDLY_OF_IT):
            return step
    for step in (own / 2.0**n for n in range(MOST_HALVED)):
        if _agree(of_kind, effects, step / 2.0, step, TOO_MUCH, TOO_MUCH_OF_IT):
            return step
    return own


def _agree(
    problem: Problem,
    effects: Sequence[EffectInstance],
    accurate_s: float,
    step_s: float,
    least: float,
    share: float,
) -> bool:
    """Returns whether two steps leave nearly the same on every joint, and neither breaks off."""
    kinds = list(problem.specs)
    accurate, other = (
        replace(problem, steps_s=dict.fromkeys(kinds, s)).predictions([effects])[0]
        for s in (accurate_s, step_s)
    )
    if any(p.diverged for p in (*accurate, *other)):
        return False
    left, others = (
        np.concatenate([problem.whitened(*row) for row in zip(problem.segments, told, strict=True)])
        for told in (accurate, other)
    )
    change, size = np.sqrt(problem.joint_costs(others - left)), np.sqrt(problem.joint_costs(left))
    return bool((change <= np.maximum(least, share * size)).all())
