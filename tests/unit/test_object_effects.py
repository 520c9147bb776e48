"""Object effects change the free body of a model as their laws say."""

import mujoco
import numpy as np
import pytest

from gfm.core import ConfigError
from gfm.effects import EffectInstance, find_effect
from gfm.sim.plant import native_spec

BLOCK = """
<mujoco>
  <option timestep="0.001" cone="elliptic" integrator="implicitfast"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 0.1" {floor}/>
    <body name="block" pos="0 0 0.03"><freejoint/>
      <geom name="box" type="box" size="0.05 0.04 0.03" mass="0.2" {box}/></body>
  </worldbody>
</mujoco>
"""


def model(name, *, floor="", box="", gravity=True, **values):
    spec = mujoco.MjSpec.from_string(BLOCK.format(floor=floor, box=box))
    if not gravity:
        spec.option.gravity = [0.0, 0.0, 0.0]
    added = EffectInstance(effect=find_effect(name), joints=(), values=values)
    return native_spec(spec, [added]).compile()


def after(compiled, qvel, time_s):
    """Returns qpos and qvel of a block that rested, was given a velocity, and was let go."""
    data = mujoco.MjData(compiled)
    mujoco.mj_step(compiled, data, nstep=200)
    data.qvel[:] = qvel
    data.qpos[:2] = 0.0
    mujoco.mj_step(compiled, data, nstep=round(time_s / compiled.opt.timestep))
    return data.qpos.copy(), data.qvel.copy()


@pytest.mark.parametrize(
    ("floor", "box", "before"),
    [
        ('friction="0.2"', 'friction="0.3"', 0.3),  # the larger one counts
        ('friction="0.4"', 'friction="0.3"', 0.4),
        ('friction="0.9"', 'friction="0.3" priority="1"', 0.3),  # the first one counts
        ('friction="0.5" priority="2"', 'friction="0.3"', 0.5),
    ],
)
def test_friction_is_added_to_what_there_is_between_object_and_floor(floor, box, before):
    compiled = model("object_friction", floor=floor, box=box, coefficient=0.1)
    slid, _ = after(compiled, [0.6, 0.0, 0.0, 0.0, 0.0, 0.0], 0.5)
    assert slid[0] == pytest.approx(0.6**2 / (2.0 * (before + 0.1) * 9.81), rel=0.01)


def test_friction_can_be_taken_off():
    compiled = model("object_friction", box='friction="0.5" priority="1"', coefficient=-0.3)
    slid, _ = after(compiled, [0.4, 0.0, 0.0, 0.0, 0.0, 0.0], 0.5)
    assert slid[0] == pytest.approx(0.4**2 / (2.0 * 0.2 * 9.81), rel=0.01)


def test_damping_brakes_a_flying_object_along_and_about_every_axis():
    compiled = model("object_damping", gravity=False, linear=0.3, angular=1e-4)
    # From well above the floor, which it does not touch.
    data = mujoco.MjData(compiled)
    data.qpos[2], data.qvel[:] = 1.0, [0.3, -0.2, 0.1, 0.0, 0.0, 2.0]
    mujoco.mj_step(compiled, data, nstep=400)
    spin = 0.2 * (0.05**2 + 0.04**2) / 3.0
    left = np.exp(-0.3 / 0.2 * 0.4), np.exp(-1e-4 / spin * 0.4)
    assert data.qvel[:3] == pytest.approx(np.array([0.3, -0.2, 0.1]) * left[0], rel=1e-3)
    assert data.qvel[5] == pytest.approx(2.0 * left[1], rel=1e-3)


def test_damping_takes_no_command():
    compiled = model("object_damping", linear=0.3, angular=1e-4)
    assert (compiled.nu, compiled.na) == (0, 0)


def test_mass_grows_with_its_inertia_and_the_centre_stays():
    compiled, nominal = (model("object_mass", mass=mass) for mass in (0.1, 0.0))
    assert compiled.body("block").mass[0] == pytest.approx(0.3)
    assert compiled.body("block").inertia == pytest.approx(1.5 * nominal.body("block").inertia)
    assert compiled.body("block").ipos == pytest.approx(nominal.body("block").ipos)


def test_the_centre_of_mass_is_moved_in_the_frame_of_the_object():
    compiled = model("object_com", x=0.01, y=-0.02, z=0.003)
    assert compiled.body("block").ipos == pytest.approx([0.01, -0.02, 0.003])
    assert compiled.body("block").mass[0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("object_friction", {"coefficient": 0.1}),
        ("object_mass", {"mass": 0.1}),
        ("object_com", {"x": 0.01, "y": -0.02, "z": 0.003}),
    ],
)
def test_an_object_is_the_same_beside_an_arm_that_bears_a_payload(name, values):
    arm = """<body name="arm"><joint name="hinge" axis="0 0 1"/>
      <geom type="capsule" size="0.02 0.1" mass="3" friction="0.7"/></body>"""
    text = BLOCK.format(floor='friction="0.4"', box="").replace("<body", arm + "<body", 1)
    effects = [
        EffectInstance(
            effect=find_effect("payload"),
            joints=("hinge",),
            values={"mass": 0.5, "com_x": 0.0, "com_y": 0.0, "com_z": 0.1},
        ),
        EffectInstance(effect=find_effect(name), joints=(), values=values),
    ]
    both, alone = (
        native_spec(mujoco.MjSpec.from_string(text), own).compile()
        for own in (effects, effects[1:])
    )
    for attribute in ("mass", "inertia", "ipos"):
        ours, wanted = (getattr(m.body("block"), attribute) for m in (both, alone))
        np.testing.assert_array_equal(ours, wanted)
    np.testing.assert_array_equal(both.geom("box").friction, alone.geom("box").friction)
    assert both.geom("box").priority == alone.geom("box").priority
    assert both.body("block").mass[0] == pytest.approx(0.2 + values.get("mass", 0.0))


@pytest.mark.parametrize("name", ["object_friction", "object_mass", "object_com", "object_damping"])
def test_a_model_without_a_free_body_is_refused(name):
    effect = find_effect(name)
    values = {p.name: 0.1 for p in effect.parameters}
    with pytest.raises(ConfigError, match=f"{name}: the model has no free body"):
        effect.apply(mujoco.MjSpec(), (), values)


def test_two_free_bodies_are_refused():
    spec = mujoco.MjSpec.from_string(BLOCK.format(floor="", box=""))
    spec.worldbody.add_body(name="ball").add_freejoint()
    with pytest.raises(ConfigError, match=r"2 free bodies \(block, ball\), expected at most one"):
        find_effect("object_mass").apply(spec, (), {"mass": 0.1})
