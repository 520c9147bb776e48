"""A drive that gives the less of its torque the stronger it is."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.data.segmentation import WHOLE, all_segments, prepared
from gfm.diagnosis.inference.fitting import fit
from gfm.effects import EffectInstance, Motion, find_effect
from gfm.effects.drive import MOST_LOST
from gfm.sim.plant import drive_dofs, make_plant
from gfm.sim.predict import predict
from pendulum import DAMPING, MODEL, PERIOD_S, STIFFNESS, swung

NOISE, LOSS = 3e-4, 0.15
SPEC = mujoco.MjSpec.from_string(MODEL)
SPECS = {CommandKind.POSITION: SPEC}


def lost(coefficient, joint="j"):
    values = {"coefficient": coefficient}
    return EffectInstance(effect=find_effect("drive_loss"), joints=(joint,), values=values)


def recording(seed, loss=LOSS):
    time_s = np.arange(0.0, 6.0, PERIOD_S)
    rng = np.random.default_rng(seed)
    waves = np.sin(np.outer(time_s, rng.uniform(1.0, 5.0, 3)) + rng.uniform(0.0, 6.0, 3))
    told = 0.4 * np.minimum(time_s, 1.0) * waves.sum(axis=1)
    return swung(told, seed=seed, noise=NOISE, loss=loss)


def test_what_is_lost_grows_with_the_square_and_is_a_half_at_most():
    drive = np.array([-2.0, 0.0, 1.0, 100.0])
    still = np.zeros(4)
    change = find_effect("drive_loss").drive_change(
        Motion(position=still, velocity=still, drive=drive), {"coefficient": np.full(4, 0.1)}
    )
    np.testing.assert_allclose(change, [0.4, 0.0, -0.1, -100.0 * MOST_LOST])


def test_the_same_as_another_integrator_says_and_its_amount_is_recovered():
    problem = prepared(all_segments(SPECS, [recording(0), recording(1)], windows_s=WHOLE))
    assert problem.settled(()).residuals([()])[0].std() > 2.0
    fitted = fit(problem.settled([lost(LOSS)]), [lost(0.05)])
    assert fitted.effects[0].values["coefficient"] == pytest.approx(LOSS, rel=0.05)
    assert fitted.cost == pytest.approx(1.0, abs=0.15)


def test_efforts_are_measured_with_the_loss():
    problem = prepared(all_segments(SPECS, [recording(0, loss=0.0)], windows_s=WHOLE))
    (segment,) = problem.segments
    ((told,),) = predict([make_plant(SPEC, ("j",), [lost(0.6)])], [segment])
    position = told.position[:, 0]
    velocity = np.gradient(position, segment.time_s)
    index = np.searchsorted(segment.command_time_s, segment.time_s, side="left") - 1
    servo = STIFFNESS * (segment.command[np.maximum(index, 0), 0] - position) - DAMPING * velocity
    given = servo * (1.0 - np.minimum(0.6 * np.abs(servo), MOST_LOST))
    off = np.abs(told.effort[5:-5, 0] - given[5:-5])
    assert np.median(off) < 0.05 * np.median(np.abs(servo - given))


def test_what_is_lost_is_lost_on_the_side_of_the_motor():
    play = EffectInstance(effect=find_effect("backlash"), joints=("j",), values={"gap": 0.2})
    plain, with_motor = (make_plant(SPEC, ("j",), e).model for e in ([], [play]))
    assert drive_dofs(plain, ("j",)) == plain.joint("j").dofadr
    assert drive_dofs(with_motor, ("j",)) == with_motor.joint("j_motor").dofadr
