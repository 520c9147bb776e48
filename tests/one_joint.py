"""The smallest problem there is: one joint, one stretch, a model that is not asked."""

import numpy as np

from gfm.core import CommandKind
from gfm.diagnosis.inference.fitting import Fit
from gfm.diagnosis.residuals.problem import Problem
from gfm.diagnosis.residuals.rollouts import Noise
from gfm.effects import EffectInstance, effect_library
from gfm.sim.segment import Segment

TIME_S = 0.01 * np.arange(40.0)


def instance(name, **values):
    return EffectInstance(effect=effect_library()[name], joints=("joint",), values=values)


def fitted(cost, *effects):
    residual = np.full(len(TIME_S), np.sqrt(cost))
    return Fit(effects=effects, jacobian=residual.reshape(-1, 1)[:, :0], residual=residual)


def problem(position, outlying_from=np.inf):
    segment = Segment(
        time_s=TIME_S,
        position=position,
        effort=None,
        kind=CommandKind.POSITION,
        command_time_s=TIME_S,
        command=position,
        initial_position=position[0],
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    return Problem(
        specs={},
        joints=("joint",),
        segments=(segment,),
        noise=Noise(position=np.full(1, 0.5), effort=None),
        outlying_from=outlying_from,
    )
