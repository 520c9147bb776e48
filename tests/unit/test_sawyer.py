"""The cell against figures computed without MuJoCo, from the numbers alone."""

import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, UnknownNameError
from gfm.sim import sawyer_numbers as numbers
from gfm.sim.cell import object_rest_position
from gfm.sim.export import exported_models
from gfm.sim.sawyer import JOINT_NAMES, NEUTRAL, READY, sawyer_spec

MODELS = Path(__file__).parents[2] / "models"
GRAVITY = np.array([0.0, 0.0, -9.81])
POSES = [NEUTRAL, READY, *np.random.default_rng(0).uniform(-2.0, 2.0, size=(8, 7))]


def _rotation(axis, angle):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def _rpy(rpy):
    roll, pitch, yaw = rpy
    return _rotation((0, 0, 1), yaw) @ _rotation((0, 1, 0), pitch) @ _rotation((1, 0, 0), roll)


def _frames(q):
    """World rotations and origins of the seven link frames, by plain homogeneous products."""
    rotation, origin, frames = np.eye(3), np.zeros(3), []
    for joint, angle in zip(numbers.JOINTS, q, strict=True):
        origin = origin + rotation @ joint.xyz
        rotation = rotation @ _rpy(joint.rpy) @ _rotation((0, 0, 1), angle)
        frames.append((rotation, origin))
    return frames


def _hand_position(q):
    rotation, origin = _frames(q)[-1]
    return origin + rotation @ numbers.HAND_XYZ


def _moving_bodies(q):
    """(index of the joint that moves it, mass, world com, world inertia) of every moving body."""
    for index, ((rotation, origin), link) in enumerate(zip(_frames(q), numbers.LINKS, strict=True)):
        yield index, link.mass, origin + rotation @ link.com, _world_inertia(rotation, link)
        if index == 0:
            head = numbers.HEAD
            com = origin + rotation @ (np.array(numbers.HEAD_XYZ) + head.com)
            yield index, head.mass, com, _world_inertia(rotation, head)


def _world_inertia(rotation, link):
    xx, yy, zz, xy, xz, yz = link.inertia
    return rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T


def _mass_matrix_and_gravity(q):
    """Sums J^T m J and J^T m g over the bodies, with Jacobians from the axes and origins."""
    frames = _frames(q)
    mass_matrix = numbers.ARMATURE * np.eye(7)
    gravity = np.zeros(7)
    for last, mass, com, inertia in _moving_bodies(q):
        linear, angular = np.zeros((3, 7)), np.zeros((3, 7))
        for joint, (rotation, origin) in enumerate(frames[: last + 1]):
            axis = rotation[:, 2]
            angular[:, joint] = axis
            linear[:, joint] = np.cross(axis, com - origin)
        mass_matrix += mass * linear.T @ linear + angular.T @ inertia @ angular
        gravity -= linear.T @ (mass * GRAVITY)
    return mass_matrix, gravity


def _forward(model, q):
    data = mujoco.MjData(model)
    data.qpos[:7] = q
    mujoco.mj_forward(model, data)
    return data


@pytest.fixture(scope="module")
def arm():
    return sawyer_spec(command=CommandKind.POSITION).compile()


def test_hand_is_where_the_published_forward_kinematics_puts_it_at_neutral(arm):
    hand = _forward(arm, NEUTRAL).body("right_hand").xpos
    np.testing.assert_allclose(hand, [0.44960, 0.16030, 0.21575], atol=6e-6)


@pytest.mark.parametrize("q", POSES)
def test_hand_agrees_with_plain_homogeneous_products(arm, q):
    hand = _forward(arm, q).body("right_hand").xpos
    np.testing.assert_allclose(hand, _hand_position(q), atol=1e-12)


@pytest.mark.parametrize("q", POSES)
def test_mass_matrix_and_gravity_torque_agree_with_sums_over_the_bodies(arm, q):
    data = _forward(arm, q)
    dense = np.zeros((7, 7))
    mujoco.mj_fullM(arm, data, dense)
    mass_matrix, gravity = _mass_matrix_and_gravity(q)
    np.testing.assert_allclose(dense, mass_matrix, atol=1e-9)
    np.testing.assert_allclose(data.qfrc_bias, gravity, atol=1e-9)


def test_masses_add_up(arm):
    assert arm.body_mass.sum() == pytest.approx(20.7345, abs=1e-9)


@pytest.mark.parametrize("tool", ["none", "plate", "ball"])
def test_drives_carry_the_whole_gravity_with_every_tool(tool):
    model = sawyer_spec(command=CommandKind.EFFORT, end_effector=tool).compile()
    data = _forward(model, READY)
    np.testing.assert_allclose(data.qfrc_actuator, data.qfrc_bias, atol=1e-9)
    np.testing.assert_allclose(data.qacc, 0.0, atol=1e-9)


def test_limits_are_the_published_ones(arm):
    np.testing.assert_array_equal(
        arm.jnt_range[:, 1], [3.0503, 2.2736, 3.0426, 3.0439, 2.9761, 2.9761, 4.7124]
    )
    np.testing.assert_array_equal(
        arm.jnt_range[:, 0], [-3.0503, -3.8095, -3.0426, -3.0439, -2.9761, -2.9761, -4.7124]
    )
    np.testing.assert_array_equal(arm.actuator_forcerange[:, 1], [80, 80, 40, 40, 9, 9, 9])


def test_joints_are_ideal_apart_from_the_declared_damping(arm):
    assert not arm.dof_frictionloss.any()
    np.testing.assert_array_equal(arm.dof_damping, 0.1)
    np.testing.assert_array_equal(arm.dof_armature, 1.0)


@pytest.mark.parametrize("kind", CommandKind)
def test_every_joint_has_one_actuator_of_its_name_and_the_asked_kind(kind):
    model = sawyer_spec(command=kind).compile()
    assert tuple(model.actuator(i).name for i in range(model.nu)) == JOINT_NAMES
    expected = {
        CommandKind.POSITION: ([800.0, 800.0, 800.0, 800.0, 500.0, 500.0, 500.0], -80.0),
        CommandKind.VELOCITY: ([50.0] * 7, -50.0),
        CommandKind.EFFORT: ([1.0] * 7, 0.0),
    }
    gains, first_damping = expected[kind]
    np.testing.assert_array_equal(model.actuator_gainprm[:, 0], gains)
    assert model.actuator_biasprm[0, 2] == first_damping


@pytest.mark.parametrize(("key", "tool"), [("neutral", "none"), ("ready", "plate")])
def test_nothing_but_the_object_touches_anything_in_the_named_poses(key, tool):
    spec = sawyer_spec(command=CommandKind.POSITION, end_effector=tool, free_object="brick")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    mujoco.mj_forward(model, data)
    brick = model.body("object").id
    assert all(brick in model.geom_bodyid[contact.geom] for contact in data.contact)


@pytest.mark.parametrize("kind", ["brick", "tee"])
def test_object_rests_in_the_basket(kind):
    model = sawyer_spec(command=CommandKind.VELOCITY, free_object=kind).compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, nstep=1000)
    np.testing.assert_allclose(data.body("object").xpos, object_rest_position(kind), atol=1e-3)
    assert np.abs(data.qvel[7:]).max() < 1e-3


def test_object_slides_back_from_the_walls_into_the_basket():
    model = sawyer_spec(command=CommandKind.VELOCITY, free_object="brick").compile()
    model.geom_friction[:, 0] = 0.1
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[7:10] = [0.6, 0.3, 0.25]
    mujoco.mj_step(model, data, nstep=2000)
    assert np.abs(data.qpos[7:9] - numbers.BASKET_XYZ[:2]).max() < 0.2


@pytest.mark.parametrize(("tool", "length"), [("none", 0.0), ("plate", 0.24), ("ball", 0.17)])
def test_end_effector_site_is_at_the_tip_of_the_tool(tool, length):
    model = sawyer_spec(command=CommandKind.VELOCITY, end_effector=tool).compile()
    data = _forward(model, NEUTRAL)
    offset = data.site("end_effector").xpos - data.body("right_hand").xpos
    axis = data.body("right_hand").xmat.reshape(3, 3)[:, 2]
    np.testing.assert_allclose(offset, length * axis, atol=1e-12)


def test_unknown_tool_is_refused_with_the_known_ones():
    with pytest.raises(UnknownNameError, match="unknown end effector 'hook'; available: ball"):
        sawyer_spec(command=CommandKind.VELOCITY, end_effector="hook")


def test_discretisation_error_is_far_below_an_encoder_step(arm):
    """Half a second towards a step of 0.1 rad, against the same at a tenth of the time step."""
    fine = sawyer_spec(command=CommandKind.POSITION)
    fine.option.timestep /= 10
    ends = []
    for model, steps in ((arm, 250), (fine.compile(), 2500)):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.ctrl += 0.1
        mujoco.mj_step(model, data, nstep=steps)
        ends.append(data.qpos.copy())
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


@pytest.mark.parametrize("name", ["sawyer_position.xml", "sawyer_velocity.xml"])
def test_exported_model_is_current(name):
    assert (MODELS / name).read_text() == exported_models()[name], (
        "run: python -m gfm.sim.export models"
    )


def test_exported_model_behaves_as_the_built_one(arm):
    model = mujoco.MjModel.from_xml_path(str(MODELS / "sawyer_position.xml"))
    built, loaded = _forward(arm, READY), _forward(model, READY)
    np.testing.assert_allclose(loaded.qfrc_bias, built.qfrc_bias, atol=1e-3)
    np.testing.assert_allclose(
        loaded.body("right_hand").xpos, built.body("right_hand").xpos, atol=1e-6
    )
