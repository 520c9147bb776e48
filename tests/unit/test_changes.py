"""What changed between sets of recordings, on a pendulum that SciPy integrates."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.diagnose import diagnose
from gfm.diagnosis.output.changes import random_effects
from pendulum import LENGTH, MODEL, PERIOD_S, swung

NOISE = 3e-4
FRICTION, TOOL = 0.2, 0.1


def dry(level):
    return lambda _q, v: -level * np.tanh(v / 1e-3)


def motion(seed, torque, duration=12.0, size=0.25, **truth):
    time_s = np.arange(0.0, duration, PERIOD_S)
    rng = np.random.default_rng(seed)
    speeds, phases = rng.uniform(1.0, 5.0, 3), rng.uniform(0.0, 6.0, 3)
    waves = np.sin(np.outer(time_s, speeds) + phases).sum(axis=1)
    told = size * np.minimum(time_s, 1.0) * waves
    return swung(told, seed=seed, noise=NOISE, torque=torque, **truth)


def changes(*sets):
    """What changed over sets, each given by what acts on its robot (and what it has besides)."""
    runs = []
    for k, (torque, truth) in enumerate(sets):
        runs.append([motion(10 * k + i, torque, **truth) for i in range(2)])
    *since, now = runs
    held = motion(99, sets[-1][0], **sets[-1][1])
    specs = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
    return diagnose(specs, now, [held], since=since).changes


def test_nothing_changed_where_nothing_did():
    told = changes((dry(FRICTION), {}), (dry(FRICTION), {}))
    assert told.sentence == "Nothing changed."
