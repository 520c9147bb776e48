"""A model as URDF: MuJoCo reads it back as the same arm."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError
from gfm.sim.sawyer import JOINT_NAMES, sawyer_spec
from gfm.sim.urdf import urdf


def test_the_arm_that_is_read_back_has_the_same_places_and_mass_matrix() -> None:
    model = sawyer_spec(command=CommandKind.EFFORT).compile()
    model.dof_armature[:] = 0.0
    options = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco></robot>'
    text = urdf(model, root="base", efforts=dict.fromkeys(JOINT_NAMES, 9.0))
    back = mujoco.MjModel.from_xml_string(text.replace("</robot>", options))
    assert [back.joint(i).name for i in range(back.njnt)] == list(JOINT_NAMES)
    np.testing.assert_allclose(back.jnt_range, model.jnt_range, rtol=1e-11)
    ours, theirs = mujoco.MjData(model), mujoco.MjData(back)
    rng = np.random.default_rng(0)
    for _ in range(5):
        ours.qpos[:] = theirs.qpos[:] = rng.uniform(-2.0, 2.0, model.nq)
        for one, data in ((model, ours), (back, theirs)):
            mujoco.mj_forward(one, data)
        for name in ("right_l0", "right_l3", "right_l6", "right_hand", "head"):
            np.testing.assert_allclose(ours.body(name).xpos, theirs.body(name).xpos, atol=1e-9)
            np.testing.assert_allclose(ours.body(name).xmat, theirs.body(name).xmat, atol=1e-9)
        inertias = np.zeros((2, 7, 7))
        for inertia, (one, data) in zip(inertias, ((model, ours), (back, theirs)), strict=True):
            mujoco.mj_fullM(one, data, inertia)
        np.testing.assert_allclose(*inertias, atol=1e-8)


def test_a_capsule_becomes_a_cylinder_and_two_spheres_at_its_ends() -> None:
    arm = '<geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.05"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="link">{arm}</body></worldbody></mujoco>'
    )
    text = urdf(model, root="base")
    assert text.count('<sphere radius="0.05" />') == 2
    assert '<cylinder radius="0.05" length="0.4" />' in text
    places = {visual.find("origin").get("xyz") for visual in Xml.fromstring(text).iter("visual")}
    assert places == {"0 0 0", "0 0 0.2", "0 0 0.4"}


@pytest.mark.parametrize(
    "joint", ['type="slide"', 'type="hinge" pos="0 0 1"', 'type="hinge"/><joint type="hinge"']
)
def test_other_joints_are_refused(joint: str) -> None:
    body = f'<body name="link"><joint {joint}/><geom size="0.1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(ConfigError, match="body link: expected at most one hinge"):
        urdf(model, root="base")
