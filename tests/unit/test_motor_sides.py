"""A motor behind a spring or play bears what its link bears, compensation included."""

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.effects import EffectInstance, effect_library
from gfm.sim.plant import make_plant
from gfm.sim.predict import predict
from gfm.sim.segment import Segment

MASS, LENGTH, STIFFNESS, KP, GAP = 1.2, 0.5, 40.0, 100.0, 0.02
#: Of a lever that is held level, N m.
LOAD = MASS * LENGTH * 9.81
LEVER = """
<mujoco><option timestep="0.002" integrator="RK4" gravity="0 0 -9.81"/><worldbody>
  <body name="lever" gravcomp="{gravcomp}">
    <joint name="j" axis="0 -1 0" armature="0.05" damping="0.1" actuatorgravcomp="{counted}"/>
    <inertial pos="{length} 0 0" mass="{mass}" diaginertia="1e-6 1e-6 1e-6"/></body>
</worldbody><actuator><position name="j" joint="j" kp="{kp}" kv="5"/></actuator></mujoco>
"""


def effect(name, **values):
    return EffectInstance(effect=effect_library()[name], joints=("j",), values=values)


def held(link, command, *effects, gravcomp=0):
    """Returns what is predicted of a lever that rests at `link` while `command` is commanded."""
    counted = "true" if gravcomp else "false"
    text = LEVER.format(gravcomp=gravcomp, counted=counted, length=LENGTH, mass=MASS, kp=KP)
    time_s = 0.01 * np.arange(60.0)
    run = Segment(
        time_s=time_s,
        position=np.full((len(time_s), 1), link),
        effort=None,
        kind=CommandKind.POSITION,
        command_time_s=time_s,
        command=np.full((len(time_s), 1), command),
        initial_position=np.array([link]),
        initial_velocity=np.zeros(1),
        servo_gain=np.ones(1),
    )
    plant = make_plant(mujoco.MjSpec.from_string(text), ("j",), effects)
    return predict([plant], [run])[0][0]


def test_a_spring_is_bent_by_its_load_from_the_start():
    told = held(0.0, LOAD / STIFFNESS + LOAD / KP, effect("joint_elasticity", stiffness=STIFFNESS))
    np.testing.assert_allclose(told.position, 0.0, atol=1e-6)
    np.testing.assert_allclose(told.effort, LOAD, rtol=1e-5)


def test_play_is_taken_up_by_its_load_from_the_start():
    told = held(0.0, 0.5 * GAP + LOAD / KP, effect("backlash", gap=GAP))
    np.testing.assert_allclose(told.position, 0.0, atol=1e-3)  # the stop is soft: 3e-4


@pytest.mark.parametrize("gravcomp", [0, 1])
def test_a_stiff_drive_holds_its_link_with_or_without_compensation(gravcomp):
    command = 0.0 if gravcomp else LOAD / KP
    told = held(0.0, command, effect("joint_elasticity", stiffness=1e4), gravcomp=gravcomp)
    np.testing.assert_allclose(told.position, 0.0, atol=1.5 * LOAD / 1e4)
    np.testing.assert_allclose(told.effort, LOAD, rtol=0.02)


def test_gravity_is_cancelled_by_the_drive_so_that_the_link_sags():
    told = held(
        -LOAD / STIFFNESS,
        0.0,
        effect("joint_elasticity", stiffness=STIFFNESS),
        gravcomp=1,
    )
    # The compensation is that of the link's angle, where the lever is shorter.
    sag = LOAD * np.cos(LOAD / STIFFNESS) / STIFFNESS
    rest = told.position[-1, 0]
    assert rest == pytest.approx(-LOAD * np.cos(rest) / STIFFNESS, rel=0.02)
    assert rest == pytest.approx(-sag, rel=0.05)
