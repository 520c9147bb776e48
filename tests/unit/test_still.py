"""What a model drives beside the recorded joints stands still while it is simulated."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.sim.still import unrecorded, with_still_joints

ARM = """
<mujoco>
  <compiler angle="degree"/>
  <worldbody>
    <body name="upper"><joint name="shoulder" axis="0 1 0"/><geom size="0.1" mass="1"/>
      <body name="lower" pos="0.3 0 0"><joint name="wrist" axis="0 1 0" ref="30"/>
        <geom pos="0.1 0 0" size="0.1" mass="1"/>
        <body name="left"><joint name="left_finger" type="slide" axis="0 1 0"/>
          <geom size="0.01" mass="0.1"/></body>
        <body name="right"><joint name="right_finger" type="slide" axis="0 -1 0"/>
          <geom size="0.01" mass="0.1"/>
          <body name="pad"><joint name="pad" type="slide" axis="0 0 1"/>
            <geom size="0.01" mass="0.01"/></body></body>
        <body name="lamp"><joint name="lamp" axis="1 0 0"/><geom size="0.01" mass="0.1"/></body>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="grip"><joint joint="left_finger" coef="1"/></fixed></tendon>
  <equality>
    <joint joint1="left_finger" joint2="right_finger"/>
    {more}
  </equality>
  <actuator>
    <position name="shoulder" joint="shoulder" kp="50" kv="5"/>
    <position name="wrist" joint="wrist" kp="20" kv="2"/>
    <position name="grip" tendon="grip" kp="100"/>
  </actuator>
  <sensor><jointpos joint="wrist"/></sensor>
  <keyframe><key name="home" qpos="0.1 0.2 0 0 0 0"/></keyframe>
</mujoco>
"""
FINGERS = {"left_finger": 0.0, "right_finger": 0.0}


def arm(more: str = "") -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(ARM.format(more=more))


def joints(spec: mujoco.MjSpec) -> list[str]:
    return [joint.name for joint in spec.joints]


def test_a_gripper_that_nobody_recorded_stands_still():
    assert unrecorded(arm(), ("shoulder", "wrist")) == FINGERS


def test_so_does_a_joint_where_its_model_has_it_by_default():
    found = unrecorded(arm(), ("shoulder",))
    assert found == {"wrist": pytest.approx(np.pi / 6.0), **FINGERS}


def test_what_nothing_drives_swings_on():
    assert "lamp" not in unrecorded(arm(), ("shoulder", "wrist"))


def test_bodies_that_are_held_together_stand_still_together():
    held = arm('<weld body1="pad" body2="left"/>')
    assert set(unrecorded(held, ("shoulder", "wrist"))) == {*FINGERS, "pad"}


def test_what_a_recorded_joint_moves_does_not_stand_still():
    coupled = arm('<joint joint1="right_finger" joint2="wrist"/>')
    assert unrecorded(coupled, ("shoulder", "wrist")) == {}


def test_nothing_stands_still_where_everything_was_recorded():
    all_driven = ("shoulder", "wrist", "left_finger", "right_finger")
    assert unrecorded(arm(), all_driven) == {}
    assert joints(with_still_joints(arm(), ())) == joints(arm())


def test_still_joints_are_fixed_where_they_are_by_default():
    """The same inertia about the shoulder, and nothing left that moves or refers to them."""
    spec = arm()
    still = with_still_joints(spec, unrecorded(spec, ("shoulder",)))
    assert joints(still) == ["shoulder", "pad", "lamp"]
    assert joints(spec) == joints(arm())
    before, after = spec.compile(), still.compile()
    assert (after.nu, after.neq, after.ntendon, after.nkey) == (1, 0, 0, 0)
    inertias = []
    for model in (before, after):
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        inertias.append(data.M[model.M_rowadr[0]])
    assert inertias[0] == pytest.approx(inertias[1])
