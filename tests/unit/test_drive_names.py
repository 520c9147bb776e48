"""Drives go by the joints that they drive, whatever a file calls them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.api.models import command_kind
from gfm.core import CommandKind
from gfm.diagnosis.output.correction import corrected_model
from gfm.diagnosis.output.result import NamedEffect, ParameterEstimate
from gfm.effects import EffectInstance, find_effect
from gfm.excitation.limits import robot_limits
from gfm.service.model_files import read_model
from gfm.sim.drive_names import name_after_joints, name_as_found
from gfm.sim.layout import make_layout
from gfm.sim.plant import make_plant

ARM = """
<mujoco model="arm">
  <option timestep="0.002"/>
  <worldbody>
    <body name="upper"><joint name="wrist" axis="0 1 0"/><geom size="0.1" mass="1"/>
      <body name="lower" pos="0.3 0 0"><joint name="wrist_roll" axis="1 0 0"/>
        <geom size="0.1" mass="1"/>
        <body name="left"><joint name="left_finger" type="slide" axis="0 1 0"/>
          <geom size="0.01" mass="0.1"/></body>
        <body name="right"><joint name="right_finger" type="slide" axis="0 -1 0"/>
          <geom size="0.01" mass="0.1"/></body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="grip"><joint joint="left_finger" coef="1"/>
    <joint joint="right_finger" coef="1"/></fixed></tendon>
  <actuator>
    {drives}
    <general name="gripper" tendon="grip" gainprm="0.016" biastype="affine" biasprm="0 -100 -10"/>
  </actuator>
  <sensor><actuatorfrc name="load" actuator="{load}"/></sensor>
</mujoco>
"""
OTHER = """<position name="actuator1" joint="wrist" kp="50" kv="5"/>
    <position joint="wrist_roll" kp="20" kv="2"/>"""


def arm(drives: str = OTHER, load: str = "actuator1") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(ARM.format(drives=drives, load=load))


def names(spec: mujoco.MjSpec) -> list[str]:
    return [actuator.name for actuator in spec.actuators]


def test_drives_take_the_names_of_their_joints_and_get_their_own_back():
    spec = arm()
    assert name_after_joints(spec) == {"wrist": "actuator1", "wrist_roll": ""}
    assert names(spec) == ["wrist", "wrist_roll", "gripper"]
    assert spec.copy().compile().sensor_objid.tolist() == [0]
    name_as_found(spec)
    assert names(spec) == ["actuator1", "", "gripper"]
    assert spec.sensors[0].objname == "actuator1"
    spec.compile()


def test_names_that_are_right_stay():
    spec = arm(OTHER.replace("actuator1", "wrist"), load="wrist")
    assert name_after_joints(spec) == {"wrist_roll": ""}


def test_of_two_drives_of_a_joint_none_is_preferred():
    two = """<position name="p" joint="wrist" kp="50"/><velocity name="v" joint="wrist" kv="5"/>"""
    spec = arm(two, load="p")
    assert name_after_joints(spec) == {}
    assert names(spec) == ["p", "v", "gripper"]


def test_a_name_that_something_else_has_is_left_to_it():
    spec = arm(OTHER)
    spec.actuator("gripper").name = "wrist"
    assert name_after_joints(spec) == {"wrist_roll": ""}


def test_a_cogging_torque_is_no_drive():
    spec = arm()
    find_effect("cogging_torque").apply(
        spec, ("wrist",), {"amplitude": 0.1, "per_revolution": 7.0, "phase": 0.0}
    )
    assert name_after_joints(spec)["wrist"] == "actuator1"


def test_the_drive_of_a_motor_side_goes_by_the_joint():
    spec = arm()
    find_effect("joint_elasticity").apply(spec, ("wrist",), {"stiffness": 100.0})
    assert spec.actuator("actuator1").target == "wrist_motor"
    assert name_after_joints(spec)["wrist"] == "actuator1"


def test_a_gripper_on_a_tendon_has_no_say_in_what_commands_are(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(drives=OTHER, load="actuator1"))
    file = read_model(path)
    model = file.spec.copy().compile()
    assert command_kind(model, "arm") is CommandKind.POSITION
    assert robot_limits({CommandKind.POSITION: model}).joint_names == ("wrist", "wrist_roll")
    (line,) = file.about
    assert "actuator1 for wrist, an actuator without a name for wrist_roll" in line


def test_a_corrected_model_calls_drives_as_the_nominal_one():
    spec = arm()
    name_after_joints(spec)
    amount = {"coefficient": ParameterEstimate(value=0.3, unit="N m s/rad", ci95=None)}
    named = NamedEffect(
        effect="viscous_friction",
        joints=("wrist",),
        parameters=amount,
        confidence=0.99,
        native=True,
    )
    xml = corrected_model(spec, [named]).xml
    assert names(mujoco.MjSpec.from_string(xml)) == ["actuator1", "", "gripper"]
    assert names(spec) == ["wrist", "wrist_roll", "gripper"]


def test_a_joint_is_no_motor_side_of_one_whose_name_it_begins_with():
    spec = arm()
    name_after_joints(spec)
    layout = make_layout(spec.compile(), ("wrist", "wrist_roll"))
    assert layout.motor_dof.size == 0
    assert make_layout(spec.compile()).joint_names[:2] == ("wrist", "wrist_roll")
    assert make_layout(spec.compile(), ("wrist",)).motor_dof.size == 0


@pytest.mark.parametrize("joint", ["wrist", "wrist_roll"])
def test_the_cogging_of_one_joint_is_not_taken_off_the_drive_of_another(joint):
    spec = arm()
    name_after_joints(spec)
    cogging = EffectInstance(
        effect=find_effect("cogging_torque"),
        joints=(joint,),
        values={"amplitude": 0.7, "per_revolution": 3.0, "phase": 1.0},
    )
    plant = make_plant(spec, ("wrist", "wrist_roll"), (cogging,))
    data = mujoco.MjData(plant.model)
    data.ctrl[plant.actuator] = 0.2, -0.1
    mujoco.mj_forward(plant.model, data)
    np.testing.assert_allclose(plant.drive @ data.sensordata, [50 * 0.2, 20 * -0.1])
