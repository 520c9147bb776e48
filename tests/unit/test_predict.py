"""Predictions of recordings: commands between time steps, interpolation, batches."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, UnknownNameError
from gfm.effects import EffectInstance, find_effect
from gfm.sim.commands import stepping_commands
from gfm.sim.plant import make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Segment

PENDULUM = """
<mujoco>
  <option timestep="{step}" integrator="RK4" gravity="0 0 0"/>
  <worldbody><body>
    <joint name="j" axis="0 1 0" armature="1" damping="0"/>
    <geom size="0.01" mass="1e-6"/>
  </body></worldbody>
  <actuator>{actuator}</actuator>
</mujoco>
"""
MOTOR = '<motor name="j" joint="j"/>'
SERVO = '<position name="j" joint="j" kp="100" kv="20"/>'


def plant(actuator=MOTOR, step=0.002, effects=()):
    spec = mujoco.MjSpec.from_string(PENDULUM.format(actuator=actuator, step=step))
    return make_plant(spec, ("j",), effects)


def segment(commands, times, *, kind=CommandKind.EFFORT, duration=1.0, gain=1.0):
    stamps = np.arange(0.0, duration, 0.01)
    return Segment(
        time_s=stamps,
        position=np.zeros((len(stamps), 1)),
        effort=None,
        kind=kind,
        command_time_s=np.asarray(times, dtype=float),
        command=np.asarray(commands, dtype=float)[:, None],
        initial_position=np.zeros(1),
        initial_velocity=np.zeros(1),
        servo_gain=np.array([gain]),
    )


def effect(name, **values):
    return EffectInstance(effect=find_effect(name), joints=("j",), values=values)


def test_a_constant_torque_moves_as_the_textbook_says():
    told = predict([plant()], [segment([0.5], [0.0])])[0][0]
    time_s = np.arange(0.0, 1.0, 0.01)
    assert told.position[:, 0] == pytest.approx(0.25 * time_s**2, abs=1e-5)
    assert told.effort == pytest.approx(0.5)
    assert not told.diverged


def test_a_command_between_two_steps_counts_by_its_share():
    shares = stepping_commands(plant(), segment([0.0, 1.0], [0.0, 0.0035]), 4)
    assert shares[:, 0] == pytest.approx([0.0, 0.25, 1.0, 1.0])


def test_a_delay_shifts_the_command_by_any_fraction_of_a_step():
    late = plant(effects=(effect("command_delay", delay=0.0015),))
    shares = stepping_commands(late, segment([0.0, 1.0], [0.0, 0.002]), 4)
    assert shares[:, 0] == pytest.approx([0.0, 0.25, 1.0, 1.0])


def test_a_lag_answers_a_step_exponentially():
    lagging = plant(effects=(effect("actuator_lag", time_constant=0.1),))
    means = stepping_commands(lagging, segment([0.0, 1.0], [0.0, 0.2]), 500)[:, 0]
    since = np.maximum(0.002 * np.arange(501) - 0.2, 0.0)
    integral = since - 0.1 * (1.0 - np.exp(-since / 0.1))
    assert means == pytest.approx(np.diff(integral) / 0.002, abs=1e-10)


def test_predictions_converge_with_the_step_and_are_accurate_at_two_milliseconds():
    steps = np.arange(0.0, 1.0, 0.05)
    run = segment(np.sin(6.0 * steps), steps, kind=CommandKind.POSITION)
    coarse, fine = (predict([plant(SERVO, step)], [run])[0][0].position for step in (0.002, 0.0002))
    assert np.abs(coarse - fine).max() < 1e-6


def test_a_batch_tells_the_same_as_one_by_one():
    plants = [plant(effects=(effect("viscous_friction", coefficient=c),)) for c in (0.0, 0.5, 1.0)]
    runs = [segment([0.5], [0.0]), segment([0.2, -0.2], [0.0, 0.4])]
    together = predict(plants, runs)
    for i, one in enumerate(plants):
        for k, run in enumerate(runs):
            alone = predict([one], [run])[0][0]
            assert np.array_equal(together[i][k].position, alone.position)


@pytest.mark.parametrize(
    ("name", "amount"), [("command_delay", "delay"), ("actuator_lag", "time_constant")]
)
def test_none_of_an_effect_is_simulated_beside_some_of_it(name, amount):
    plants = [plant(effects=(effect(name, **{amount: value}),)) for value in (0.0, 0.01)]
    run = segment([0.5, -0.5], [0.0, 0.4])
    (none,), _ = predict(plants, [run])
    ((nominal,),) = predict([plant()], [run])
    np.testing.assert_array_equal(none.position, nominal.position)


def test_a_servo_gain_of_zero_is_no_drive_at_all():
    run = segment([1.0], [0.0], kind=CommandKind.POSITION, gain=0.0)
    assert predict([plant(SERVO)], [run])[0][0].position == pytest.approx(0.0)


def test_dry_friction_that_grows_with_the_drive_slows_by_its_share():
    loaded = plant(effects=(effect("load_dependent_friction", coefficient=0.2),))
    told = predict([loaded], [segment([0.5], [0.0])])[0][0]
    free = predict([plant()], [segment([0.4], [0.0])])[0][0]
    assert told.position[-1, 0] == pytest.approx(free.position[-1, 0], rel=0.02)


def test_stribeck_friction_holds_below_its_level():
    stuck = plant(effects=(effect("stribeck_friction", static_excess=0.6, stribeck_velocity=0.1),))
    told = predict([stuck], [segment([0.5], [0.0])])[0][0]
    assert abs(told.position[-1, 0]) < 1e-3


def test_a_joint_that_is_not_there_is_told_with_those_that_are():
    spec = mujoco.MjSpec.from_string(PENDULUM.format(actuator=MOTOR, step=0.002))
    with pytest.raises(UnknownNameError, match="unknown joint 'elbow'; available: j"):
        make_plant(spec, ("elbow",))


def test_a_lag_remembers_what_was_commanded_before_the_stretch():
    lagged = plant(effects=(effect("actuator_lag", time_constant=0.1),))
    before = segment([0.0, 1.0, 0.0], [-1.0, -0.3, 0.0])
    shares = stepping_commands(lagged, before, 3)
    left = 1.0 - np.exp(-3.0)
    assert shares[0, 0] == pytest.approx(left * (1.0 - np.exp(-0.02)) / 0.02, rel=1e-9)


def test_models_with_more_bodies_of_collision_are_simulated_apart():
    surface = effect("surface_contact", height=-5.0, x=0.0, y=0.0, z=0.0, friction=0.3)
    plants = [plant(), plant(effects=(surface,)), plant()]
    told = predict(plants, [segment([0.5], [0.0])])
    assert len({one.layout for one in plants}) == 2
    for row in told[1:]:
        assert row[0].position == pytest.approx(told[0][0].position, abs=1e-9)
