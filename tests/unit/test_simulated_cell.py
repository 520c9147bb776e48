"""The simulated robot's cell: an object that falls, lies, slides and is pushed, and its cameras."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.core import ConfigError, RefusedError, UnknownNameError
from gfm.sim.sawyer import READY
from gfm_robot_bridge.simulated.arm import Arm
from gfm_robot_bridge.simulated.cell import Cell, cell_spec
from gfm_robot_bridge.simulated.config import SimulatedConfig
from gfm_robot_bridge.simulated.hidden import HiddenEffect, draw, object_names
from gfm_robot_bridge.simulated.robot import SimulatedRobot
from gfm_robot_bridge.simulated.tracker import Tracker, Tracking

STEP_S, GRAVITY = 5e-4, 9.81
#: Of the published object on the basket's floor.
FRICTION = 0.4
FAR_FROM_EVERYTHING = (0.0, 1.5, 1.0)


def hidden(effect, **parameters):
    return HiddenEffect(effect=effect, joints=(), parameters=parameters)


def passed(arm, seconds):
    """Lets time pass; returns where the object was after every step, shape (T, 7)."""
    poses = []
    for _ in range(round(seconds / STEP_S)):
        arm.step(STEP_S)
        poses.append(arm.object_pose)
    return np.array(poses)


def slid(*effects, speed=0.3):
    """How far an object slides that begins at a speed, m."""
    arm = Arm(READY, effects, Cell.POSITION)
    passed(arm, 0.1)
    start = arm.object_pose
    arm._v[7] = speed  # nobody pushes an object to an exact speed
    return float(passed(arm, 0.4)[-1, 0] - start[0])


@pytest.mark.parametrize("cell", [Cell.POSITION, Cell.POSE])
def test_what_lies_stays(cell):
    arm = Arm(READY, (), cell)
    before = arm.object_pose
    after = passed(arm, 0.5)[-1]
    np.testing.assert_allclose(after, before, atol=2e-5)
    np.testing.assert_allclose(arm.position, READY, atol=1e-9)


def test_what_is_let_go_falls():
    arm = Arm(READY, (), Cell.POSITION)
    pose = arm.object_pose
    pose[:3] = FAR_FROM_EVERYTHING
    arm.put_object(pose)
    fallen = pose[2] - passed(arm, 0.1)[-1, 2]
    assert fallen == pytest.approx(0.5 * GRAVITY * 0.1**2, rel=1e-9)


def test_what_slides_comes_to_rest_where_friction_says():
    assert slid() == pytest.approx(0.3**2 / (2.0 * FRICTION * GRAVITY), rel=0.02)


def test_hidden_friction_is_added_to_that_of_the_object():
    more = slid(hidden("object_friction", coefficient=0.3))
    assert more == pytest.approx(0.3**2 / (2.0 * (FRICTION + 0.3) * GRAVITY), rel=0.02)


def test_a_heavier_object_slides_as_far():
    assert slid(hidden("object_mass", mass=0.3)) == pytest.approx(slid(), rel=0.01)


def test_an_object_turns_about_its_own_centre_of_mass():
    """Thrown without gravity's help: its frame circles about the centre, that goes straight on."""
    arm = Arm(READY, (hidden("object_com", x=0.02, y=0.0, z=0.0),), Cell.POSITION)
    pose = arm.object_pose
    pose[:3] = FAR_FROM_EVERYTHING
    arm.put_object(pose)
    rate = 5.0
    arm._v[12] = rate  # about its z axis; its frame's speed is none, so its centre's is rate x 0.02
    after = passed(arm, 0.1)[-1]
    centre = np.array([0.02 * np.cos(rate * 0.1), 0.02 * np.sin(rate * 0.1)])
    np.testing.assert_allclose(after[:2] + centre - pose[:2], [0.02, 0.1 * rate * 0.02], atol=1e-5)


def test_in_free_flight_momentum_stays():
    """Linear momentum but for gravity, and angular momentum, of a body that tumbles."""
    arm = Arm(READY, (), Cell.POSE)
    pose = arm.object_pose
    pose[:3] = FAR_FROM_EVERYTHING
    arm.put_object(pose)
    arm._v[7:13] = [0.3, -0.2, 0.1, 6.0, -4.0, 9.0]
    data = mujoco.MjData(arm._model)
    subtree = arm._model.body("object").id

    def momenta():
        data.qpos[:], data.qvel[:] = arm._q, arm._v
        mujoco.mj_forward(arm._model, data)
        mujoco.mj_subtreeVel(arm._model, data)
        return data.subtree_linvel[subtree].copy(), data.subtree_angmom[subtree].copy()

    (linear, angular), _ = momenta(), passed(arm, 0.2)
    after_linear, after_angular = momenta()
    np.testing.assert_allclose(after_linear, linear - [0.0, 0.0, 0.2 * GRAVITY], atol=1e-6)
    np.testing.assert_allclose(after_angular, angular, rtol=1e-4)


def test_the_tool_pushes_the_object():
    """Wherever the plate's mounting is, the object goes where it is driven to."""
    arm = Arm(READY, (), Cell.POSITION)
    pose = arm.object_pose
    model = arm._model
    data = mujoco.MjData(model)
    data.qpos[:] = arm._q
    mujoco.mj_forward(model, data)
    tip = data.site("end_effector").xpos
    pose[:3] = tip - np.array([0.0, 0.0, 0.02])
    arm.put_object(pose)  # in the plate: it is pushed out
    away = passed(arm, 0.05)[-1, :3] - pose[:3]
    assert np.linalg.norm(away) > 0.005


def test_the_tools_mounting_can_be_off():
    spots = []
    for effects in ((), (hidden("tool_offset", x=0.01, y=-0.005),)):
        model = Arm(READY, effects, Cell.POSE)._model
        spots.append(model.body("ball").pos.copy())
    np.testing.assert_allclose(spots[1] - spots[0], [0.01, -0.005, 0.0], atol=1e-12)


def test_contacts_are_not_those_of_any_nominal_model():
    spec = cell_spec(Cell.POSITION)
    assert spec.option.timestep == STEP_S
    assert {tuple(geom.solref) for geom in spec.geoms} == {(0.006, 1.0)}


def test_an_arm_alone_has_no_object():
    arm = Arm(READY)
    assert arm.object_pose is None
    with pytest.raises(RefusedError, match="no object"):
        arm.put_object(np.zeros(7))


@pytest.mark.parametrize("name", object_names())
def test_object_effects_are_drawn_by_seed(name):
    assert draw(name, 3, READY) == draw(name, 3, READY) != draw(name, 4, READY)


def test_several_effects_are_hidden_together():
    both = draw("payload+object_friction", 0, READY)
    assert [effect.effect for effect in both] == ["payload", "object_friction"]
    with pytest.raises(UnknownNameError, match="wings"):
        draw("payload+wings", 0, READY)
    with pytest.raises(ConfigError, match="no object"):
        SimulatedConfig(hidden_effect="payload+object_mass")


def looked(tracking, seconds, pose):
    """Everything that is known at every millisecond of some time."""
    tracker = Tracker(tracking, np.random.default_rng(0))
    told = []
    for now_ns in range(0, round(seconds * 1e9), 1_000_000):
        while tracker.next_ns <= now_ns:
            tracker.look(pose)
        told.append((now_ns, tracker.known(now_ns)))
    return told


def test_poses_are_told_late_now_and_then_not_and_with_noise():
    pose = np.array([0.5, 0.1, 0.2, 1.0, 0.0, 0.0, 0.0])
    told = looked(Tracking(), 40.0, pose)
    known = {one.stamp_ns: (now_ns, one) for now_ns, one in reversed(told) if one is not None}
    looks = 40.0 * 30.0
    assert 0.96 * looks < len(known) < looks  # 2 % are lost, two are under way
    late = [now_ns - stamp for stamp, (now_ns, _) in known.items()]
    assert 50_000_000 <= min(late) <= max(late) < 51_000_001
    poses = np.array([one.pose for _, one in known.values()])
    np.testing.assert_allclose(poses[:, :3].std(axis=0), 1e-3, rtol=0.1)
    np.testing.assert_allclose(2.0 * poses[:, 4:].std(axis=0), 1e-2, rtol=0.1)
    np.testing.assert_allclose(np.linalg.norm(poses[:, 3:], axis=1), 1.0, atol=1e-12)


def test_reports_carry_the_pose_that_is_known_and_its_own_time():
    robot = SimulatedRobot(READY, cell=Cell.POSITION, tracking=Tracking(lost=0.0))
    reports = robot.advance(None, 500_000_000)
    assert reports[0].object_position is None
    stamps = [one.object_stamp_ns for one in reports if one.object_position is not None]
    assert stamps == sorted(stamps)
    assert len(set(stamps)) == 14  # every 33 ms, 50 ms late
    assert all(
        50_000_000 <= one.stamp_ns - one.object_stamp_ns < 90_000_000
        for one in reports
        if one.object_position is not None
    )
