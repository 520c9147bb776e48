"""A tilted base: gravity turns for everything, and a controller cancels the upright one."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind
from gfm.diagnosis.output.correction import model_pair
from gfm.effects import EffectInstance, find_effect
from gfm.effects.inertial import tilted_gravity
from gfm.envs.registry import nominal_cell
from gfm.report.files import model_texts, write_texts
from gfm.service.model_files import read_model
from gfm.sim.batch import HybridBatch
from gfm.sim.cell import OBJECT_BODY, object_rest_position
from gfm.sim.compensation import compensation_error
from gfm.sim.hybrid import HybridModel
from gfm.sim.plant import make_plant, native_spec, stepping_spec
from gfm.sim.predict import predict
from gfm.sim.sawyer import JOINT_NAMES, READY
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from two_joints import a_segment

ARM = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="RK4"/>
  <worldbody><body gravcomp="1">
    <joint name="a" axis="0 1 0" armature="0.05" damping="0.1" actuatorgravcomp="true"/>
    <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="1"/>
    <body pos="0.3 0 0" gravcomp="1">
      <joint name="b" axis="1 0 0" armature="0.02" damping="0.05" actuatorgravcomp="true"/>
      <geom type="capsule" fromto="0 0 0 0.1 0.2 0" size="0.02" mass="0.5"/>
    </body></body></worldbody>
  <actuator>
    <position name="a" joint="a" kp="30" kv="2"/><position name="b" joint="b" kp="15" kv="1"/>
  </actuator>
</mujoco>
"""
JOINTS = ("a", "b")
TASK = "position_matching"
BRICK_KG = 0.15


def effect(name, joints=(), **values):
    return EffectInstance(effect=find_effect(name), joints=tuple(joints), values=values)


TILT = effect("gravity_direction", tilt_x=0.1, tilt_y=-0.2)
SMALL_TILT = effect("gravity_direction", tilt_x=0.02, tilt_y=0.03)
PAYLOAD = effect("payload", "b", mass=0.3, com_x=0.1, com_y=0.05, com_z=0.02)
OFFSETS = (effect("encoder_offset", "a", offset=0.1), effect("encoder_offset", "b", offset=-0.2))


def holding(spec, qpos, gravity):
    """Returns the torques that hold all bodies of a model at rest, by MuJoCo's recursive sum."""
    model = spec.copy().compile()
    model.opt.gravity = gravity
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    return data.qfrc_bias.copy()


def error_at(effects, position):
    plant = make_plant(mujoco.MjSpec.from_string(ARM), JOINTS, effects)
    return plant, compensation_error(plant, np.array([position]))


@pytest.mark.parametrize("beside", [(), (PAYLOAD,), OFFSETS, (PAYLOAD, *OFFSETS)])
def test_the_controller_bears_what_it_knows_and_gravity_pulls_at_all(beside):
    """At rest: the arm upright and as reported, less everything tilted and as it is."""
    reported = np.array([0.3, -0.4])
    plant, error = error_at((TILT, *beside), reported)
    data = mujoco.MjData(plant.model)
    data.qpos[:] = reported  # MuJoCo's `ref` takes the offsets off
    mujoco.mj_forward(plant.model, data)
    left = data.qfrc_gravcomp - data.qfrc_bias + error.force[0]
    arm = mujoco.MjSpec.from_string(ARM)
    pulled = native_spec(arm, [one for one in beside if one.effect.name == "payload"])
    true = reported - sum(one.values.get("offset", 0.0) * _unit(one) for one in beside)
    down, aslant = [0.0, 0.0, -9.81], tilted_gravity(0.1, -0.2)
    assert left == pytest.approx(holding(arm, reported, down) - holding(pulled, true, aslant))


def _unit(one):
    return np.array([float(name in one.joints) for name in JOINTS])


def test_no_tilt_is_none():
    _, error = error_at((effect("gravity_direction", tilt_x=0.0, tilt_y=0.0),), [0.3, -0.4])
    assert error.force == pytest.approx(0.0, abs=1e-12)


def test_a_free_arm_moves_as_under_the_difference_of_the_two_gravities():
    """Which MuJoCo can say of an arm whose bodies are all borne: the two ways must agree."""
    plain = mujoco.MjSpec.from_string(ARM)
    for body in plain.bodies:
        body.gravcomp = 0.0
    plain.option.gravity = np.array(tilted_gravity(0.1, -0.2)) - [0.0, 0.0, -9.81]
    run = a_segment()
    expected = predict([make_plant(plain, JOINTS)], [run])[0][0]
    run = replace(run, position=expected.position)  # the error is taken where it was measured
    tilted = predict([make_plant(mujoco.MjSpec.from_string(ARM), JOINTS, [TILT])], [run])[0][0]
    assert tilted.position == pytest.approx(expected.position, abs=2e-5)
    borne = [
        holding(mujoco.MjSpec.from_string(ARM), q, [0.0, 0.0, -9.81]) for q in expected.position
    ]
    assert tilted.effort == pytest.approx(expected.effort + borne, abs=2e-3)


@pytest.fixture(scope="module")
def cell(tmp_path_factory) -> HybridModel:
    """Returns the cell under a tilt, as it was written for a policy and read back."""
    folder = tmp_path_factory.mktemp("tilted")
    tilted = native_spec(nominal_cell(TASK), [SMALL_TILT])
    given = [replace(SMALL_TILT, in_model=True)]
    write_texts(folder, model_texts("corrected", model_pair(tilted, given)))
    file = read_model(folder / "corrected.xml")
    return HybridModel(
        models={CommandKind.VELOCITY: stepping_spec(file.spec, file.effects).compile()},
        joint_names=JOINT_NAMES,
        control_period_s=0.05,
        effects=file.effects,
    )


def left_alone(model: HybridModel, periods: int) -> HybridBatch:
    batch = HybridBatch(model, 1)
    start = model.any_model.qpos0.copy()
    start[model.layout.qpos] = READY
    batch.reset(np.array([0]), [model.any_model], start[None], np.zeros((1, model.any_model.nv)))
    still = np.zeros((1, len(JOINT_NAMES)))
    for _ in range(periods):
        batch.step(still, np.zeros((1, len(model.force_limit))))
    return batch


def test_an_object_in_a_tilted_cell_keeps_its_weight_and_its_place(cell):
    data = mujoco.MjData(cell.any_model)
    data.qpos[:] = left_alone(cell, 40).qpos[0]
    thing = cell.any_model.joint(OBJECT_BODY)
    place = data.qpos[thing.qposadr[0] :][:3]
    assert place == pytest.approx(object_rest_position("brick"), abs=2e-3)  # friction holds it
    assert cell.any_model.body(OBJECT_BODY).mass[0] == pytest.approx(BRICK_KG)
    mujoco.mj_forward(cell.any_model, data)
    borne = data.qfrc_constraint[thing.dofadr[0] :][:3]
    assert borne == pytest.approx(-BRICK_KG * cell.any_model.opt.gravity, abs=0.02)
    assert np.linalg.norm(cell.any_model.opt.gravity) == pytest.approx(9.81)


def test_the_arm_in_a_tilted_cell_sinks_as_the_robot_that_hides_the_tilt(cell):
    """Two engines: the robot's own controller, and the corrected pair with the error beside it."""
    tilt = HiddenEffect(
        effect="gravity_direction", joints=(), parameters={"tilt_x": 0.02, "tilt_y": 0.03}
    )
    robot = Arm(READY, (tilt,), Cell.POSITION)
    robot.servo.command(CommandKind.VELOCITY, np.zeros(len(JOINT_NAMES)), READY)
    for _ in range(2000):
        robot.step(5e-4)
    sunk = robot.position - READY
    assert np.abs(sunk).max() > 0.01
    model = left_alone(cell, 20)
    assert model.qpos[0, cell.layout.qpos] - READY == pytest.approx(sunk, abs=2e-4)
