"""Time steps on which a diagnosis simulates: as long as what is predicted hardly depends on them.

Models come with steps that suit their own integrators. Integrated to fourth order, most do with
longer ones; a stiff servo on a light link needs a shorter one, or its rollouts run away. Where the
link is lighter still (arms that are modelled without rotors), no step is short enough for that, and
the model is integrated implicitly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.core.checks import Array
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.rollouts import Stepping
from gfm.effects import EffectInstance

#: Longest step that is taken, s.
LONGEST_S = 2e-3
#: Times that a model's own step is halved at most.
MOST_HALVED = 4
#: By how much a longer step may change what a joint leaves RMS: in noises, and a share, if more.
HARDLY = (0.25, 0.02)
#: The same of the model's own step, halved, from which on it is too long while something else does
#: better, and from which on it is in any case.
MUCH, TOO_MUCH = (0.5, 0.1), (10.0, 0.3)
#: Recorded time, s, and segments on which steps are compared at least: one may show nothing.
COMPARED_S, COMPARED = 6.0, 3


def with_suitable_steps(problem: Problem, effects: Sequence[EffectInstance] = ()) -> Problem:
    """Returns the problem with the time steps that suit its models with `effects` in them.

    As it is where a motor is apart from its link: those are simulated on steps of their own.
    """
    if problem.motors_apart([effects]):
        return problem
    groups = _compared(problem, effects)
    stepping = {
        kind: _suitable([problem.subset(group) for group in groups], kind, spec, effects)
        for kind, spec in problem.specs.items()
    }
    return replace(problem, stepping=stepping)


def _compared(problem: Problem, effects: Sequence[EffectInstance]) -> list[list[int]]:
    """Returns the segments on which steps are compared: of all, and where `effects` change most.

    A servo comes to its limit now and then only, and only there is a step far too long for that.
    """
    compared_s = max(COMPARED_S, *(COMPARED * float(one.time_s[-1]) for one in problem.segments))
    chosen = problem.sample(compared_s)
    if not effects:
        return [chosen]
    without, beside = problem.coarse().residuals([(), tuple(effects)])
    change = [np.mean((beside - without)[rows] ** 2) for rows in problem.slices()]
    return [chosen, problem.first(np.argsort(change)[::-1].tolist(), compared_s)]


def _suitable(
    parts: Sequence[Problem],
    kind: CommandKind,
    spec: mujoco.MjSpec,
    effects: Sequence[EffectInstance],
) -> Stepping:
    """Returns what suits the model of one kind of command, in each part of the recordings."""
    own = Stepping(step_s=float(spec.option.timestep))
    of_kind = [
        part.subset([i for i, s in enumerate(part.segments) if s.kind is kind]) for part in parts
    ]
    trials = [_Trial(part, effects) for part in of_kind if part.segments]
    if not trials:
        return own

    def agree(finer: Stepping, coarser: Stepping, most: tuple[float, float]) -> bool:
        usual, *most_changed = trials
        # There, joints may come to rest or just not, whatever the step.
        return usual.agree(finer, coarser, most) and all(
            trial.agree(finer, coarser, TOO_MUCH) for trial in most_changed
        )

    methods = (True,) if parts[0].is_implicit(kind) else (False, True)
    longer = int(np.log2(max(LONGEST_S / own.step_s, 1.0)) + 1e-9)
    for n in range(longer, 0, -1):
        one = Stepping(step_s=own.step_s * 2.0**n, implicit=methods[0])
        if agree(replace(own, implicit=methods[0]), one, HARDLY):
            return one
    shorter = [
        Stepping(step_s=own.step_s / 2.0**n, implicit=implicit)
        for n in range(MOST_HALVED)
        for implicit in methods
    ]
    for most in (MUCH, TOO_MUCH):
        for one in shorter:
            if agree(one.halved(), one, most):
                return one
    return shorter[-1]


@dataclass
class _Trial:
    """What a model leaves when it is simulated in several ways, each of them once."""

    problem: Problem
    effects: Sequence[EffectInstance]
    left: dict[Stepping, Array | None] = field(default_factory=dict)

    def agree(self, finer: Stepping, coarser: Stepping, most: tuple[float, float]) -> bool:
        """Returns whether two leave nearly the same on every joint, and neither breaks off."""
        told, others = self._left(finer), self._left(coarser)
        if told is None or others is None:
            return False
        change = np.sqrt(self.problem.joint_costs(others - told))
        size = np.sqrt(self.problem.joint_costs(told))
        return bool((change <= np.maximum(most[0], most[1] * size)).all())

    def _left(self, stepping: Stepping) -> Array | None:
        """Returns what is left, in units of the noise; None where the simulation breaks off."""
        if stepping not in self.left:
            kinds = dict.fromkeys(self.problem.specs, stepping)
            told = replace(self.problem, stepping=kinds).predictions([self.effects])[0]
            off = any(prediction.diverged for prediction in told)
            self.left[stepping] = None if off else np.concatenate(self.problem.whitened(told))
        return self.left[stepping]
