"""The simulated robot in Drake: the published numbers, its own contacts, the same controller."""

from __future__ import annotations

import subprocess
import sys
from functools import cache

import mujoco
import numpy as np
import pytest

from gfm.core import Command, CommandKind, ConfigError, ManualClock, RefusedError
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm.transport import MemoryHub, MemoryTransport
from gfm_robot_bridge.simulated.__main__ import build
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell, cell_model
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import HiddenEffect, draw, names, object_names
from gfm_robot_bridge.simulated.robot import Sensors, SimulatedRobot
from gfm_wire import SetPayload

pytest.importorskip("pydrake", reason="needs the extra `drake`")

from gfm_robot_bridge.simulated.drake_arm import DrakeArm
from gfm_robot_bridge.simulated.drake_cell import STEP_S, DrakeCell

GRAVITY = 9.81
#: Of the published object on the basket's floor.
FRICTION = 0.4
FAR_FROM_EVERYTHING = (0.0, 1.5, 1.0)
APART = ("backlash", "joint_elasticity")
SPEED = 0.3
#: Drake's steps are of first order: the arm is ahead by what it goes in about one of them.
ONE_STEP_RAD = 1.2 * SPEED * STEP_S
QUIET = Sensors(position_noise=0.0, velocity_noise=0.0, effort_noise=0.0, encoder_step=1e-12)


def hidden(effect, **parameters):
    return HiddenEffect(effect=effect, joints=(), parameters=parameters)


def passed(arm, seconds):
    """Lets time pass; returns where the object was after every step, shape (T, 7)."""
    poses = []
    for _ in range(round(seconds / STEP_S)):
        arm.step(STEP_S)
        poses.append(arm.object_pose)
    return np.array(poses)


# The same numbers as in MuJoCo


def poses(seed=0, count=4):
    return READY + 0.5 * np.random.default_rng(seed).standard_normal((count, len(READY)))


@pytest.mark.parametrize(
    ("cell", "name"),
    [
        *((cell, "none") for cell in Cell),
        *((Cell.NONE, name) for name in ("payload", "gravity_direction", "armature")),
        *((Cell.POSE, name) for name in ("object_mass", "object_com", "tool_offset")),
    ],
)
def test_both_engines_have_the_same_bodies(cell, name):
    """Where they are, what they weigh, what gravity does to them and how hard they are to move."""
    model = cell_model(cell, draw(name, 1, READY))
    data, drake = mujoco.MjData(model), DrakeCell(model)
    plant, context = drake._plant, drake._context
    assert plant.CalcTotalMass(context) == pytest.approx(model.body_mass.sum(), rel=1e-12)
    for q in poses():
        data.qpos[:7] = drake.position = q
        mujoco.mj_forward(model, data)
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        own = plant.CalcMassMatrix(context)[:7, :7]
        np.testing.assert_allclose(own, inertia[:7, :7], atol=1e-12)
        np.testing.assert_allclose(drake.weight(), -data.qfrc_bias[:7], atol=1e-12)
        for number in range(1, model.nbody):
            body = plant.GetBodyByName(model.body(number).name)
            pose = plant.EvalBodyPoseInWorld(context, body)
            np.testing.assert_allclose(pose.translation(), data.xpos[number], atol=1e-12)
            turned = pose.rotation().matrix().ravel()
            np.testing.assert_allclose(turned, data.xmat[number], atol=1e-12)
            own = body.CalcSpatialInertiaInBodyFrame(context)
            assert own.get_mass() == pytest.approx(model.body_mass[number], rel=1e-12)
            if model.body_mass[number] > 0.0:
                np.testing.assert_allclose(own.get_com(), model.body_ipos[number], atol=1e-12)


def test_an_object_is_as_hard_to_turn_as_in_mujoco():
    model = cell_model(Cell.POSE, draw("object_com", 1, READY))
    data, drake = mujoco.MjData(model), DrakeCell(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    # Speeds of a free body: MuJoCo has those along the axes first, Drake those about them.
    swapped = np.roll(np.arange(7, 13), 3)
    own = drake._plant.CalcMassMatrix(drake._context)[7:, 7:]
    np.testing.assert_allclose(own, inertia[np.ix_(swapped, swapped)], atol=1e-12)


# The object


@pytest.mark.parametrize("cell", [Cell.POSITION, Cell.POSE])
def test_what_lies_stays(cell):
    arm = DrakeArm(READY, (), cell)
    before = arm.object_pose
    after = passed(arm, 0.3)[-1]
    np.testing.assert_allclose(after, before, atol=2e-5)
    np.testing.assert_allclose(arm.position, READY, atol=1e-7)


@pytest.mark.parametrize("cell", [Cell.POSITION, Cell.POSE])
def test_nothing_but_the_object_touches_anything_at_first(cell):
    """The tool's rod sticks in the link that holds it: that is no contact."""
    arm = DrakeArm(READY, (), cell)
    passed(arm, 0.005)
    plant = arm._cell._plant
    touching = plant.get_contact_results_output_port().Eval(arm._cell._context)
    assert touching.num_point_pair_contacts() == 0
    assert touching.num_hydroelastic_contacts() == (1 if cell is Cell.POSITION else 2)


def test_what_is_let_go_falls():
    arm = DrakeArm(READY, (), Cell.POSITION)
    pose = arm.object_pose
    pose[:3] = FAR_FROM_EVERYTHING
    arm.put_object(pose)
    fallen = pose[2] - passed(arm, 0.1)[-1, 2]
    # Speeds are advanced first, places with them: half a step more than the parabola.
    assert fallen == pytest.approx(0.5 * GRAVITY * 0.1 * (0.1 + STEP_S), rel=1e-9)


def slid(*effects, speed=0.3):
    """How far an object slides that begins at a speed, m."""
    arm = DrakeArm(READY, effects, Cell.POSITION)
    passed(arm, 0.02)
    start = arm.object_pose
    cell = arm._cell
    pushed = np.array([0.0, 0.0, 0.0, speed, 0.0, 0.0])  # nobody pushes to an exact speed
    cell._plant.SetVelocities(cell._context, cell._thing, pushed)
    return float(passed(arm, 0.12)[-1, 0] - start[0])


@pytest.mark.parametrize("more", [0.0, 0.3])
def test_what_slides_comes_to_rest_where_friction_says(more):
    effects = (hidden("object_friction", coefficient=more),) if more else ()
    assert slid(*effects) == pytest.approx(0.3**2 / (2.0 * (FRICTION + more) * GRAVITY), rel=0.02)


def test_more_friction_than_drake_can_have_is_refused():
    with pytest.raises(ConfigError, match=r"friction is 2\.4, expected less than 2 in Drake"):
        DrakeArm(READY, (hidden("object_friction", coefficient=2.0),), Cell.POSITION)


def test_the_tool_pushes_the_object():
    arm = DrakeArm(READY, (), Cell.POSITION)
    plant, context = arm._cell._plant, arm._cell._context
    plate = plant.EvalBodyPoseInWorld(context, plant.GetBodyByName("plate"))
    pose = arm.object_pose
    pose[:3] = plate @ np.array([0.0, 0.034, 0.2])  # touches the flat side by a millimetre
    arm.put_object(pose)
    away = plate.inverse() @ passed(arm, 0.05)[-1, :3]
    assert away[1] > 0.0355


def test_an_arm_alone_has_no_object():
    arm = DrakeArm(READY)
    assert arm.object_pose is None
    with pytest.raises(RefusedError, match="no object"):
        arm.put_object(np.zeros(7))


# The arm


def moved(mechanics, *effects, seconds=0.6):
    """Positions of an arm that swings, every 10 ms, shape (T, J)."""
    robot = SimulatedRobot(READY, effects=effects, sensors=QUIET, mechanics=mechanics)
    reports = []
    for _ in range(round(seconds / 0.02)):
        swing = SPEED * np.cos(2.0 * np.pi * robot.time_ns * 1e-9)
        command = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINT_NAMES,
            values=swing * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]),
            stamp_ns=robot.time_ns,
        )
        reports += robot.advance(command, 20_000_000)
    return np.array([report.position for report in reports])


@cache
def nominal():
    return moved(Arm)


def test_with_nothing_hidden_both_engines_move_the_arm_alike():
    np.testing.assert_allclose(moved(DrakeArm), nominal(), atol=ONE_STEP_RAD)


@pytest.mark.parametrize("name", [name for name in names() if name not in APART])
def test_what_hides_in_the_arm_does_the_same_in_both_engines(name):
    effects = draw(name, 2, READY)
    ours, theirs = moved(DrakeArm, *effects), moved(Arm, *effects)
    difference = np.abs(theirs - nominal()).max()
    assert difference > 2.0 * ONE_STEP_RAD
    assert np.abs(ours - theirs).max() < ONE_STEP_RAD + 0.02 * difference


def test_a_payload_that_the_controller_was_told_of_bends_nothing():
    load = hidden("payload", mass=1.5, com_x=0.05, com_y=0.02, com_z=0.1)
    unaware, told = DrakeArm(READY, (load,)), DrakeArm(READY, (load,))
    told.carry(SetPayload(mass_kg=1.5, com_m=np.array([0.05, 0.02, 0.1])))
    for arm in (unaware, told):
        passed(arm, 0.1)
    assert np.abs(unaware.position - READY).max() > 1e-3
    assert told.position == pytest.approx(READY, abs=1e-6)


@pytest.mark.parametrize("name", APART)
def test_motors_apart_from_their_links_are_refused(name):
    with pytest.raises(ConfigError, match=f"hidden effects are {name}: expected none of backlash"):
        DrakeArm(READY, draw(name, 0, READY))


def test_dry_friction_holds_for_good():
    level = HiddenEffect(effect="coulomb_friction", joints=(0,), parameters={"torque": 2.0})
    arm = DrakeArm(READY, (level,))
    arm.servo.command(CommandKind.EFFORT, np.array([1.9, *np.zeros(6)]), arm.position)
    passed(arm, 0.2)
    held = arm.position[0]
    passed(arm, 0.5)
    assert arm.position[0] == pytest.approx(READY[0], abs=5e-5)
    assert arm.position[0] == pytest.approx(held, abs=1e-9)


def test_how_time_is_cut_does_not_matter():
    whole, cut = DrakeArm(READY), DrakeArm(READY)
    for arm in (whole, cut):
        arm.servo.command(CommandKind.VELOCITY, np.full(7, 0.2), arm.position)
    whole.step(0.03)
    for _ in range(90):
        cut.step(0.03 / 90)
    np.testing.assert_array_equal(whole.position, cut.position)


# The process


def robot(**settings):
    clock = ManualClock()
    config = SimulatedConfig(name="robot", engine="drake", **settings)
    return build(config, MemoryTransport(MemoryHub(), clock=clock), clock)


def test_the_same_seed_gives_the_same_reports():
    one, again, other = (
        robot(task="position", seed=seed)._robot.advance(None, 60_000_000) for seed in (1, 1, 2)
    )
    assert [list(r.position) for r in one] == [list(r.position) for r in again]
    assert [list(r.position) for r in one] != [list(r.position) for r in other]


@pytest.mark.parametrize("name", object_names())
def test_what_hides_in_the_cell_is_hidden_in_drake_too(name):
    assert robot(task="position", hidden_effect=name).status().role == "robot"


def test_what_is_refused_leaves_no_sealed_file(tmp_path):
    with pytest.raises(ConfigError, match="expected none of backlash"):
        robot(hidden_effect="backlash", sealed=str(tmp_path / "sealed.json"))
    assert list(tmp_path.iterdir()) == []


def test_without_drake_the_extra_is_named():
    code = (
        "import sys; sys.modules['pydrake'] = None\n"
        "from gfm_robot_bridge.simulated.__main__ import _engine\n"
        "from gfm.core import ConfigError\n"
        "try:\n    _engine('drake')\nexcept ConfigError as error:\n    print(error)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    expected = (
        "engine is drake, which needs the package pydrake, not installed; expected it: "
        "pip install 'gfm-sim2real[drake]'"
    )
    assert told.stdout.strip() == expected
