"""When nothing is left to explain, and when a rival is wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.residuals.problem import Problem
from gfm.effects import EffectInstance

#: Mean squared residual, in units of the noise, at which nothing is left to explain.
ADEQUATE = 1.15
#: Share of the nominal model's misfit that is left to the inexactness of abrupt laws.
INEXACT = 0.001
#: RMSE of a joint, in units of its noise, up to which a model is adequate there: time steps and
#: integrators alone differ by as much. An effect must explain at least as much more than noise.
ADEQUATE_RATIO = 1.25
LEAST_SEEN = ADEQUATE_RATIO**2 - 1.0
#: Cost of a rival, as a multiple of that of a best that leaves noise, from which on it is wrong.
RULED_OUT = 1.5
#: Share of what something leaves that another leaves at most where it leaves far less.
FAR_LESS = 0.5


def enough(nominal: float, effects: Sequence[EffectInstance]) -> float:
    """Returns the cost at which nothing is left to explain beside `effects`.

    Laws with a kink are not quite exact: of a large misfit they leave more than noise.
    """
    inexact = INEXACT if any(e.effect.abrupt for e in effects) else 0.0
    return max(ADEQUATE, 1.0 + inexact * (nominal - 1.0))


def is_enough(problem: Problem, fitted: Fit, nominal: float = 1.0) -> bool:
    """Returns whether nothing is left to explain beside what was fitted.

    A joint that is quieter than its noise counts as noise: it would hide what another one misses.
    """
    left = np.mean(np.maximum(problem.joint_costs(fitted.residual), 1.0))
    return bool(left <= enough(nominal, fitted.effects))


def ruled_out(rival: Fit, best: Fit) -> bool:
    """Returns whether a rival leaves clearly more than a best that leaves hardly more than noise.

    Then it is wrong, however much of what was missing it explains.
    """
    return best.cost <= ADEQUATE_RATIO**2 and rival.cost >= RULED_OUT * best.cost
