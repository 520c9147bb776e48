"""A pendulum that answers late, and a model that says too much of its joint."""

from functools import cache

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import make_problem
from gfm.diagnosis.inference.fitting import fit
from gfm.effects import EffectInstance, find_effect
from pendulum import MODEL, PERIOD_S, ROTOR, swung

NOISE = 1e-4
#: The robot: late, and its rotor and damping are a part of what its model says.
DELAY, SAID_ROTOR, SAID_DAMPING, DAMPING = 0.02, 0.05, 0.6, 0.2
SAID = MODEL.replace(
    f'armature="{ROTOR}"', f'armature="{SAID_ROTOR}" damping="{SAID_DAMPING}" frictionloss="0.01"'
)
SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(SAID)}


def steps(seed):
    """Returns targets that step every second, 14 s."""
    levels = np.random.default_rng(seed).uniform(-0.5, 0.5, 14)
    return np.repeat(levels, round(1.0 / PERIOD_S))


def waves(seed):
    time_s = PERIOD_S * np.arange(1400)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    pairs = zip((0.3, 0.8, 1.7), phases, strict=True)
    return sum(0.2 * np.sin(2 * np.pi * hertz * time_s + phase) for hertz, phase in pairs)


def law(_q, v):
    """The robot's own damping, and a drag that the model lacks."""
    return -DAMPING * v - 0.15 * v * abs(v)


@cache
def recordings(delay):
    made = [(waves(1), 1), (steps(2), 2), (waves(3), 3), (steps(4), 4)]
    return [  # shared between tests: never changed
        swung(told, seed=seed, noise=NOISE, torque=law, delay=delay, start=told[0])
        for told, seed in made
    ]


def instance(name, value):
    effect = find_effect(name)
    values = {effect.parameters[0].name: value}
    return EffectInstance(effect=effect, joints=("j",), values=values)


def fitted_by_rollouts(runs):
    """Returns the problem of recordings, and the gain that explains them best alone."""
    problem = make_problem(SPECS, runs)
    return problem, fit(problem.robust(()), (instance("actuator_gain", 1.0),))
