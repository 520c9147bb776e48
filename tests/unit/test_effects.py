"""Every effect acts as its law says, natively or step by step."""

import math

import mujoco
import numpy as np
import pytest

from gfm.core import ConfigError, UnknownNameError
from gfm.effects import EffectInstance, Scales, Scope, effect_library, find_effect
from gfm.effects.elements import let_friction_hold
from gfm.sim.plant import make_plant, native_spec

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <worldbody>
    <body name="upper">
      <joint name="a" axis="0 1 0" armature="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
      <body name="lower" pos="0.3 0 0">
        <joint name="b" axis="0 1 0" armature="0.02"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="a" kp="50" kv="5"/>
    <position name="b" joint="b" kp="20" kv="2"/>
  </actuator>
</mujoco>
"""
OBJECT = """
    <body name="block" pos="0 1 0.03"><freejoint/>
      <geom type="box" size="0.05 0.04 0.03" mass="0.2" friction="0.4 0.005 0.0001"/></body>
    <geom type="plane" size="3 3 0.1" friction="0.3 0.005 0.0001"/>
  </worldbody>"""
SCALES = Scales(
    torque_nm=2.0,
    excess_nm=0.5,
    velocity_rad_s=1.0,
    position_rad=0.7,
    peak_nm=5.0,
    servo_nm=5.0,
    inertia=0.1,
    cogging_per_revolution=(12,),
    lowest_m=((0.2, 0.0, 0.0, -0.1),),
)
#: Fields of a model in which effects show.
WRITTEN = (
    *("geom_pos", "pair_friction", "pair_dim"),
    *("geom_friction", "geom_priority", "geom_condim", "actuator_trnid", "actuator_gear"),
    *("body_mass", "body_inertia", "body_ipos", "body_pos", "qpos0", "qpos_spring"),
    *("jnt_stiffness", "dof_damping", "dof_dampingpoly", "dof_armature", "dof_frictionloss"),
    *("dof_solref", "dof_solimp", "tendon_damping", "tendon_stiffness", "tendon_range"),
    *("tendon_solref_lim", "tendon_limited", "actuator_gainprm", "actuator_biasprm"),
    *("actuator_forcerange", "actuator_delay", "actuator_dynprm", "actuator_dyntype"),
)
STATE = {"qpos": (0.4, -0.7), "qvel": (0.8, -1.1), "ctrl": (0.5, 0.1)}


def instance(name, joints=("a",), **values):
    return EffectInstance(effect=find_effect(name), joints=joints, values=values)


def acceleration_torque(*effects):
    """Returns the generalized force that the effects add to the motion at STATE, shape (2,)."""
    forces = []
    for added in ((), effects):
        model = make_plant(mujoco.MjSpec.from_string(ARM), ("a", "b"), added).model
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = STATE["qpos"], STATE["qvel"], STATE["ctrl"]
        mujoco.mj_forward(model, data)
        forces.append(data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias)
    return forces[1] - forces[0]


@pytest.mark.parametrize(
    ("effect", "expected"),
    [
        (instance("viscous_friction", coefficient=0.3), (-0.3 * 0.8, 0.0)),
        (instance("quadratic_drag", coefficient=0.3), (-0.3 * 0.8**2, 0.0)),
        (instance("joint_spring", stiffness=2.0, rest_angle=0.1), (-2.0 * 0.3, 0.0)),
        (instance("torque_offset", torque=0.25), (0.25, 0.0)),
        (instance("asymmetric_friction", difference=0.4), (-0.2, 0.0)),
        (instance("coupled_friction", ("a", "b"), viscous=0.2), (-0.2 * 1.9, 0.2 * 1.9)),
        (
            instance("cogging_torque", amplitude=0.3, per_revolution=7.0, phase=0.2),
            (0.3 * math.sin(7 * 0.4 + 0.2), 0.0),
        ),
        (instance("actuator_gain", scale=1.5), (0.5 * (50 * (0.5 - 0.4) - 5 * 0.8), 0.0)),
    ],
    ids=lambda value: value.effect.name if isinstance(value, EffectInstance) else "",
)
def test_adds_the_torque_of_its_law(effect, expected):
    assert acceleration_torque(effect) == pytest.approx(expected, abs=2e-6)


def test_two_springs_on_one_joint_add_up():
    both = (
        instance("joint_spring", stiffness=2.0, rest_angle=0.1),
        instance("torque_offset", torque=0.25),
    )
    assert acceleration_torque(*both)[0] == pytest.approx(-2.0 * 0.3 + 0.25, abs=2e-6)


def test_a_spring_in_degrees_rests_at_the_same_angle():
    spec = mujoco.MjSpec.from_string(ARM.replace('<compiler angle="radian"/>', ""))
    model = make_plant(
        spec, ("a",), [instance("joint_spring", stiffness=2.0, rest_angle=0.1)]
    ).model
    assert model.qpos_spring[0] == pytest.approx(0.1)


def test_coulomb_friction_is_a_friction_loss_on_top_of_what_is_there():
    spec = mujoco.MjSpec.from_string(ARM.replace('armature="0.05"', 'frictionloss="0.1"'))
    model = native_spec(spec, [instance("coulomb_friction", torque=0.3)]).compile()
    assert model.dof_frictionloss == pytest.approx([0.4, 0.0])


RUBBING = """
<mujoco><option timestep="0.002" integrator="RK4" gravity="0 0 0"/><worldbody><body>
  <joint name="a" axis="0 0 1" frictionloss="0.3" {settings}/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.05 0.05 0.05"/></body></worldbody>
</mujoco>
"""


def crept(spec):
    """Returns how far a joint goes in two seconds under a torque below its friction, rad."""
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[0] = 0.27
    mujoco.mj_step(model, data, nstep=1000)
    return data.qpos[0]


def test_dry_friction_of_a_model_is_made_to_hold():
    spec = mujoco.MjSpec.from_string(RUBBING.format(settings=""))
    before = crept(spec.copy())
    let_friction_hold(spec)
    assert before > 0.01
    assert 0.0 <= crept(spec) < 0.1 * before


def test_friction_whose_settings_were_chosen_is_left_as_it_is():
    chosen = RUBBING.format(settings='solreffriction="0.05 1"')
    spec = mujoco.MjSpec.from_string(chosen)
    let_friction_hold(spec)
    assert spec.to_xml() == mujoco.MjSpec.from_string(chosen).to_xml()


def test_a_payload_adds_its_weight_and_leaves_the_names():
    spec = mujoco.MjSpec.from_string(ARM)
    load = instance("payload", ("b",), mass=0.7, com_x=0.1, com_y=0.0, com_z=0.0)
    model = native_spec(spec, [load]).compile()
    assert model.body_mass.sum() == pytest.approx(1.5 + 0.7)
    assert [model.joint(i).name for i in range(model.njnt)] == ["a", "b"]


def test_a_payload_pulls_where_its_centre_is_told_to_be():
    load = instance("payload", ("b",), mass=0.7, com_x=0.1, com_y=0.0, com_z=0.3)
    model = native_spec(mujoco.MjSpec.from_string(ARM), [load]).compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    hand = data.body(model.jnt_bodyid[model.joint("b").id])
    there = hand.xpos + hand.xmat.reshape(3, 3) @ [0.1, 0.0, 0.3]
    assert data.xipos[model.body("payload").id] == pytest.approx(there)


def test_a_surface_stops_its_point_and_nothing_else():
    surface = instance("surface_contact", ("b",), height=-0.1, x=0.2, y=0.0, z=0.0, friction=0.3)
    ends = []
    for effects in ((), (surface,)):
        model = native_spec(mujoco.MjSpec.from_string(ARM), effects).compile()
        data = mujoco.MjData(model)
        data.ctrl[:] = (0.4, 0.3)
        mujoco.mj_step(model, data, nstep=4000)
        hand = data.body("lower")
        ends.append((hand.xpos + hand.xmat.reshape(3, 3) @ [0.2, 0.0, 0.0])[2])
    assert ends[0] < -0.15
    assert ends[1] == pytest.approx(-0.1, abs=3e-3)
    assert data.ncon == 1


def test_tilted_gravity_keeps_its_size():
    spec = native_spec(
        mujoco.MjSpec.from_string(ARM), [instance("gravity_direction", (), tilt_x=0.1, tilt_y=-0.2)]
    )
    assert np.linalg.norm(spec.option.gravity) == pytest.approx(9.81)
    assert spec.option.gravity[1] == pytest.approx(9.81 * math.sin(0.1))


def test_a_delay_is_kept_in_the_drive_and_never_shorter_than_told():
    spec = native_spec(mujoco.MjSpec.from_string(ARM), [instance("command_delay", delay=0.0123)])
    model = spec.compile()
    assert model.actuator_delay[0] == pytest.approx(0.0123)
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    mujoco.mj_step(model, data, nstep=10)
    assert data.actuator_force[0] == pytest.approx(0.0, abs=1.0)


def test_saturation_never_widens_a_limit():
    spec = mujoco.MjSpec.from_string(ARM.replace('kp="50"', 'kp="50" forcerange="-1 3"'))
    model = native_spec(spec, [instance("torque_saturation", limit=2.0)]).compile()
    assert model.actuator_forcerange[0] == pytest.approx([-1.0, 2.0])


def test_an_encoder_offset_shifts_the_reported_position_of_the_same_pose():
    spec = native_spec(mujoco.MjSpec.from_string(ARM), [instance("encoder_offset", offset=0.1)])
    plain, shifted = mujoco.MjSpec.from_string(ARM).compile(), spec.compile()
    tips = []
    for model, angle in ((plain, 0.3), (shifted, 0.4)):
        data = mujoco.MjData(model)
        data.qpos[0] = angle
        mujoco.mj_forward(model, data)
        tips.append(data.body("lower").xpos.copy())
    assert tips[0] == pytest.approx(tips[1])


@pytest.mark.parametrize("name", ["backlash", "joint_elasticity"])
def test_a_separated_motor_takes_armature_and_drive_with_it(name):
    values = {"gap": 0.01} if name == "backlash" else {"stiffness": 300.0}
    model = native_spec(mujoco.MjSpec.from_string(ARM), [instance(name, **values)]).compile()
    motor = model.joint("a_motor")
    assert model.dof_armature[motor.dofadr[0]] == pytest.approx(0.05)
    assert model.dof_armature[model.joint("a").dofadr[0]] == 0.0
    assert model.actuator_trnid[model.actuator("a").id, 0] == motor.id


def test_a_very_stiff_elasticity_changes_nothing():
    ends = []
    for effects in ((), (instance("joint_elasticity", stiffness=2e4),)):
        model = native_spec(mujoco.MjSpec.from_string(ARM), effects).compile()
        model.opt.timestep = 1e-4
        data = mujoco.MjData(model)
        data.ctrl[:] = STATE["ctrl"]
        mujoco.mj_step(model, data, nstep=5000)
        ends.append(data.joint("a").qpos[0])
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


@pytest.mark.parametrize("effect", effect_library().values(), ids=lambda e: e.name)
def test_a_model_with_an_effect_is_the_same_after_it_was_written_and_read(effect):
    joints = {Scope.JOINT: ("a",), Scope.LAST: ("b",), Scope.PAIR: ("a", "b")}
    values = effect.probes(SCALES)[0][0]
    there = joints.get(effect.scope, ("a", "b") if effect.shares_joints else ())
    xml = ARM.replace("</worldbody>", OBJECT) if effect.scope is Scope.OBJECT else ARM
    spec = native_spec(mujoco.MjSpec.from_string(xml), [instance(effect.name, there, **values)])
    before = spec.compile()
    after = mujoco.MjModel.from_xml_string(spec.to_xml())
    for name in WRITTEN:
        expected = getattr(before, name)
        np.testing.assert_allclose(getattr(after, name), expected, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["cogging_torque", "payload", "coupled_friction", "joint_spring"])
def test_an_effect_can_be_added_to_a_model_that_has_it(name):
    effect = effect_library()[name]
    joints = {Scope.LAST: ("b",), Scope.PAIR: ("a", "b")}.get(effect.scope, ("a",))
    added = instance(name, joints, **effect.probes(SCALES)[0][0])
    once, twice = (
        acceleration_torque(*([added] * count)) - acceleration_torque() for count in (1, 2)
    )
    assert np.abs(once).max() > 1e-4
    assert twice == pytest.approx(2.0 * once, rel=0.05)


def test_friction_and_inertia_of_a_separated_motor_are_on_its_side():
    spec = native_spec(mujoco.MjSpec.from_string(ARM), [instance("backlash", gap=0.01)])
    before, motor = spec.compile(), spec.joint("a_motor").id
    added = [
        instance("coulomb_friction", torque=0.3),
        instance("viscous_friction", coefficient=0.4),
        instance("armature", inertia=0.02),
    ]
    after = native_spec(spec, added).compile()
    gained = [
        getattr(after, name).ravel() - getattr(before, name).ravel()
        for name in ("dof_frictionloss", "dof_damping", "dof_armature")
    ]
    dof = before.jnt_dofadr[motor]
    assert [one[dof] for one in gained] == pytest.approx([0.3, 0.4, 0.02])
    assert [np.count_nonzero(one) for one in gained] == [1, 1, 1]


def test_a_second_motor_side_is_refused():
    spec = native_spec(mujoco.MjSpec.from_string(ARM), [instance("backlash", gap=0.01)])
    with pytest.raises(ConfigError, match="elasticity on a: the model has a motor side a_motor"):
        native_spec(spec, [instance("joint_elasticity", stiffness=100.0)])


def test_lags_add_up():
    lag = instance("actuator_lag", time_constant=0.02)
    model = native_spec(mujoco.MjSpec.from_string(ARM), [lag, lag]).compile()
    assert model.actuator_dynprm[0, 0] == pytest.approx(0.04)


@pytest.mark.parametrize("effect", effect_library().values(), ids=lambda e: e.name)
def test_probes_have_every_parameter_and_units_are_told(effect):
    names = {p.name for p in effect.parameters}
    for group in effect.probes(SCALES):
        assert all(set(values) == names for values in group)
    assert all(p.unit and p.lower < p.upper for p in effect.parameters)
    assert effect.shown_by


def test_amounts_that_say_how_much_there_is_of_an_effect():
    told = {name: effect.how_much for name, effect in effect_library().items()}
    assert told["gravity_direction"] == ("tilt_x", "tilt_y")
    assert told["payload"] == ("mass",)
    assert told["joint_spring"] == ("stiffness",)
    assert told["actuator_gain"] == told["torque_saturation"] == told["surface_contact"] == ()


SINGLE = [e for e in effect_library().values() if len(e.probes(SCALES)[0]) == 1]


@pytest.mark.parametrize("effect", SINGLE, ids=lambda e: e.name)
def test_a_probe_changes_the_answer_of_a_group_of_one_in_proportion(effect):
    values = effect.combine(effect.probes(SCALES)[0], [0.9])
    assert values is not None
    assert effect.admissible(values)


def test_negative_friction_is_not_admissible():
    effect = find_effect("coulomb_friction")
    assert effect.combine([{"torque": 0.5}], [-0.2]) is None


def test_an_unknown_effect_is_told_with_those_that_exist():
    with pytest.raises(UnknownNameError, match=r"unknown effect 'glue'; available: .*backlash"):
        find_effect("glue")


def test_a_load_that_shows_by_its_moment_alone_is_looked_for_nearby():
    payload = effect_library()["payload"]
    (group,) = payload.probes(SCALES)
    # Joints with parallel axes: no answer to the mass at the frame, a moment along -z.
    told = payload.combine(group, [0.0, 0.0, 0.0, -20.0])
    assert told["mass"] * told["com_z"] == pytest.approx(-20.0 * 0.05 * 0.1)
    assert told["mass"] > 0.0
    assert told["com_z"] == pytest.approx(-0.2)
