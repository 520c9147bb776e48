"""Amounts by rollouts and by measured torques together, on a pendulum that SciPy integrates."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import WHOLE, make_problem
from gfm.diagnosis.data.signals import smooth_states
from gfm.diagnosis.former.witnesses import borne_out
from gfm.diagnosis.inference.fitting import fit
from gfm.effects import EffectInstance, find_effect
from pendulum import DAMPING, MODEL, PERIOD_S, STIFFNESS, swung

SPECS = {CommandKind.POSITION: mujoco.MjSpec.from_string(MODEL)}
VISCOUS, NOISE = 0.3, 1e-4


def driven(seed, spring=0.0):
    """A swing with friction that the model lacks, and a spring of the third order."""
    stamps = np.arange(0.0, 8.0, PERIOD_S)
    speeds, phases = np.random.default_rng(seed).uniform(1.0, 5.0, (2, 3))
    told = 0.4 * np.minimum(stamps, 1.0) * np.sin(np.outer(stamps, speeds) + phases).sum(axis=1)
    return swung(
        told, seed=seed, noise=NOISE, torque=lambda q, v: -VISCOUS * v - spring * np.sign(q) * q**2
    )


def with_effort(recording, wrong=0.0):
    """The same with the servo's torque as measured, `wrong` times the velocity beside it."""
    q, v, _ = smooth_states(recording.time_s, recording.position)
    return replace(recording, effort=STIFFNESS * (recording.command - q) - (DAMPING - wrong) * v)


def by_rollouts(runs):
    problem = make_problem(SPECS, runs, windows_s=WHOLE)
    viscous = find_effect("viscous_friction")
    return problem, fit(
        problem, [EffectInstance(effect=viscous, joints=("j",), values={"coefficient": 0.1})]
    )


def coefficient(fitted):
    (instance,) = fitted.effects
    return instance.values["coefficient"]


def test_an_amount_that_both_bear_out_stays():
    runs = [driven(seed) for seed in range(2)]
    problem, fitted = by_rollouts(runs)
    both = borne_out(problem, [with_effort(run) for run in runs], fitted)
    assert coefficient(fitted) == pytest.approx(VISCOUS, rel=0.01)
    assert coefficient(both) == pytest.approx(VISCOUS, rel=0.01)


def test_an_amount_lies_between_what_the_two_say():
    runs = [driven(seed, spring=3.0) for seed in range(2)]
    problem, fitted = by_rollouts(runs)
    told = [
        coefficient(borne_out(problem, [with_effort(run, w) for run in runs], fitted))
        for w in (-0.4, 0.4)
    ]
    assert told[0] < coefficient(fitted) < told[1]
    assert told[1] - told[0] < 0.8


def test_both_together_leave_less_than_where_rollouts_alone_decide():
    runs = [driven(seed, spring=3.0) for seed in range(2)]
    problem, fitted = by_rollouts(runs)
    both = borne_out(problem, [with_effort(run, 0.4) for run in runs], fitted)
    assert fitted.cost < both.cost < 2.0 * fitted.cost


def test_rollouts_decide_where_no_torque_was_measured_or_none_has_the_effect():
    runs = [driven(0)]
    problem, fitted = by_rollouts(runs)
    assert borne_out(problem, runs, fitted) is fitted
    play = EffectInstance(effect=find_effect("backlash"), joints=("j",), values={"half_gap": 0.01})
    apart = replace(fitted, effects=(*fitted.effects, play))
    assert borne_out(problem, [with_effort(run) for run in runs], apart) is apart
