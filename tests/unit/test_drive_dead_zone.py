"""A drive that gives nothing of small torques."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.inference.fitting import fit
from gfm.effects import EffectInstance, Motion, find_effect
from gfm.sim.plant import make_plant
from gfm.sim.predict import predict
from pendulum import MODEL, PERIOD_S, swung

NOISE, DEAD = 3e-4, 0.3
SPEC = mujoco.MjSpec.from_string(MODEL)


def dead(torque):
    values = {"torque": torque}
    return EffectInstance(effect=find_effect("drive_dead_zone"), joints=("j",), values=values)


def recording(seed, zone=DEAD):
    time_s = np.arange(0.0, 6.0, PERIOD_S)
    rng = np.random.default_rng(seed)
    waves = np.sin(np.outer(time_s, rng.uniform(1.0, 5.0, 3)) + rng.uniform(0.0, 6.0, 3))
    told = 0.4 * np.minimum(time_s, 1.0) * waves.sum(axis=1)
    return swung(told, seed=seed, noise=NOISE, dead=zone, finely=True)


def test_small_torques_are_lost_and_others_are_smaller_by_as_much():
    drive = np.array([-2.0, -0.1, 0.0, 0.3, 1.0])
    still = np.zeros(5)
    change = find_effect("drive_dead_zone").drive_change(
        Motion(position=still, velocity=still, drive=drive), {"torque": np.full(5, 0.3)}
    )
    assert drive + change == pytest.approx([-1.7, 0.0, 0.0, 0.0, 0.7])


def test_the_same_as_another_integrator_says_and_its_amount_is_recovered():
    problem = prepared(
        all_segments({CommandKind.POSITION: SPEC}, [recording(0), recording(1)], windows_s=WHOLE)
    )
    assert problem.settled(()).residuals([()])[0].std() > 2.0
    fitted = fit(problem.settled([dead(DEAD)]), [dead(0.1)])
    assert fitted.effects[0].values["torque"] == pytest.approx(DEAD, rel=0.03)
    assert fitted.cost == pytest.approx(1.0, abs=0.6)


def test_efforts_are_measured_behind_the_dead_zone():
    problem = prepared(
        all_segments({CommandKind.POSITION: SPEC}, [recording(0, zone=0.0)], windows_s=WHOLE)
    )
    plain, without = (
        predict([make_plant(SPEC, ("j",), effects)], problem.segments, efforts=True)[0][0]
        for effects in ([], [dead(1e3)])
    )
    assert np.abs(plain.effort).max() > 0.5
    assert without.effort == pytest.approx(np.zeros_like(without.effort), abs=1e-9)
