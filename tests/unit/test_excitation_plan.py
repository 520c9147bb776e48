"""Plans keep to what a model allows: ranges, speeds, torques, and nothing touches."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ConfigError, UnknownNameError
from gfm.excitation.limits import Wishes, robot_limits
from gfm.excitation.motion import Purpose
from gfm.excitation.plan import Request, make_plan
from gfm.excitation.programme import FAMILIES, families_for, shown_by
from gfm.excitation.room import find_room
from gfm.excitation.safety import Fault, FaultKind, SafetyCheck, refined

POSITION, VELOCITY, EFFORT = CommandKind.POSITION, CommandKind.VELOCITY, CommandKind.EFFORT


def arm(
    *,
    wall: float = 9.0,
    actuators: str = "",
    extra: str = "",
    link: str = "",
    joint: str = "",
    end: str = "",
):
    """Returns two links of 0.4 m in the vertical plane, and a wall at x = `wall`."""
    actuators = actuators or (
        '<position name="shoulder" joint="shoulder" kp="100" forcerange="-30 30"/>'
        '<position name="elbow" joint="elbow" kp="50" forcerange="-10 10"/>'
    )
    xml = f"""
    <mujoco model="arm"><compiler angle="radian" autolimits="true"/>
      <default><joint axis="0 1 0" {joint}/><geom size="0.03" mass="1"/></default>
      <worldbody>
        <geom name="wall" type="box" size="1 1 1" pos="{wall + 1} 0 0"/>
        <body name="upper" {link}><joint name="shoulder" range="-2 2"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.4"/>
          <body name="lower" pos="0 0 -0.4" {link}><joint name="elbow" range="-2.5 2.5"/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.4"/></body></body>
        {extra}
      </worldbody>
      <actuator>{actuators}</actuator>{end}
    </mujoco>"""
    return mujoco.MjModel.from_xml_string(xml)


def plan_of(model, *, wishes=None, kinds=(POSITION,), **asked):
    limits = robot_limits({POSITION: model}, wishes)
    return make_plan(model, limits, Request(kinds=kinds, seconds=8.0, **asked))


@pytest.fixture(scope="module")
def plan():
    return plan_of(arm(wall=0.5))


def test_every_motion_keeps_to_range_speed_acceleration_and_torque(plan):
    limits = plan.limits
    assert len(plan.motions) == len(FAMILIES)
    for one in plan.motions:
        position = one.motion.position
        assert (position >= limits.lower - 1e-9).all()
        assert (position <= limits.upper + 1e-9).all()
        speed = np.abs(np.diff(position, axis=0)).max(axis=0) / one.motion.period_s
        assert (speed <= limits.speed * (1 + 1e-6)).all()
        assert (np.abs(one.torque) <= limits.effort).all()


def test_nothing_touches_along_any_path_though_the_wall_is_in_reach(plan):
    model = arm(wall=0.5)
    data = mujoco.MjData(model)
    for one in plan.motions:
        for position in refined(one.motion.position, one.motion.period_s):
            data.qpos[:] = position
            mujoco.mj_fwdPosition(model, data)
            assert data.ncon == 0
    assert any("lower and world would come within 10 mm" in note for note in plan.notes)
    free = plan_of(arm())
    assert not any("touches" in note for note in free.notes)
    assert free.room.upper[0] > plan.room.upper[0] or free.room.lower[0] < plan.room.lower[0]


def test_motions_begin_and_end_at_rest_where_they_should(plan):
    for one in plan.motions:
        ends = one.motion.position[[0, 1, -2, -1]] - plan.limits.start
        np.testing.assert_allclose(ends, 0.0, atol=2e-3)
    np.testing.assert_allclose(plan.limits.start, plan.room.middle)


def test_the_way_from_the_pose_to_where_motions_begin_is_free(plan):
    model = arm(wall=0.5)
    pose = robot_limits({POSITION: model})
    assert np.abs(plan.limits.start - pose.start).max() > 0.3
    assert SafetyCheck(model, pose).way(pose.start, plan.limits.start) is None
    through_the_wall = np.array([-1.88, 0.0])
    assert SafetyCheck(model, pose).way(pose.start, through_the_wall) is not None


def test_training_comes_first_and_something_is_held_out(plan):
    purposes = [one.motion.purpose for one in plan.motions]
    assert purposes == sorted(purposes, key=lambda one: one is Purpose.HELDOUT)
    assert purposes.count(Purpose.HELDOUT) == 2
    assert len({one.motion.name for one in plan.motions}) == len(plan.motions)


def test_a_pose_that_touches_is_refused_with_the_bodies_names():
    with pytest.raises(ConfigError, match="where motions begin, upper and world touch"):
        plan_of(arm(wall=0.02))


def test_a_body_without_a_name_is_named_by_its_number():
    pillar = '<body pos="0 0 -0.2"><geom type="sphere" size="0.05"/></body>'
    with pytest.raises(ConfigError, match="body 3 and upper touch"):
        plan_of(arm(extra=pillar))


def test_no_room_is_an_error_that_says_why():
    box = '<geom type="box" size="0.2 0.2 0.01" pos="0 0 -0.85"/>'
    walls = "".join(
        f'<geom type="box" size="0.01 0.2 0.4" pos="{x} 0 -0.45"/>' for x in (-0.055, 0.055)
    )
    with pytest.raises(ConfigError, match=r"no room around where motions begin: .* within 10 mm"):
        plan_of(arm(extra=box + walls))


def servos(shoulder: float, elbow: float) -> str:
    servo = '<position name="{0}" joint="{0}" kp="100" forcerange="-{1} {1}"/>'
    return servo.format("shoulder", shoulder) + servo.format("elbow", elbow)


def test_weak_drives_get_slower_motions_and_the_note_says_why():
    plan = plan_of(arm(actuators=servos(5.0, 1.5)), effects=("torque_saturation",))
    assert all((np.abs(one.torque) <= 0.9 * np.array([5.0, 1.5])).all() for one in plan.motions)
    slower = [one for one in plan.motions if any("would need" in note for note in one.notes)]
    assert slower
    strong = {one.motion.name: one for one in plan_of(arm()).motions}
    for one in slower:
        assert np.abs(one.torque).max() < np.abs(strong[one.motion.name].torque).max()


def test_drives_that_cannot_hold_the_arm_where_it_begins_are_refused():
    key = '<keyframe><key name="out" qpos="1.5 0"/></keyframe>'
    model = arm(actuators=servos(3.0, 1.0), end=key)
    with pytest.raises(
        ConfigError, match=r"no room where motions begin: shoulder would need 7.83 N m of the 2.7"
    ):
        plan_of(model)


def test_only_the_joints_that_are_asked_for_move():
    plan = plan_of(arm(), wishes=Wishes(joints=("elbow",)))
    for one in plan.motions:
        np.testing.assert_array_equal(one.motion.position[:, 0], 0.0)
        assert np.ptp(one.motion.position[:, 1]) > 0.05
        assert [row.joint for row in one.reach] == ["elbow"]


def test_only_motions_for_the_effects_that_are_asked_for_are_made():
    plan = plan_of(arm(), effects=("cogging_torque",))
    labels = [one.family.label for one in plan.motions]
    assert labels == ["sweep", "waypoints", "four_sines"]


def test_what_even_the_motions_cannot_show_is_foreseen():
    strong = plan_of(arm(actuators=servos(300.0, 300.0)), effects=("torque_saturation",))
    spot = strong.blind_spots[0]
    assert (spot.effect, spot.joints) == ("torque_saturation", ("shoulder", "elbow"))
    assert "of 300 N m" in spot.why
    narrow = Wishes(ranges={"shoulder": (-0.2, 0.2), "elbow": (-1.0, 1.0)})
    plan = plan_of(arm(), wishes=narrow, effects=("cogging_torque",))
    assert [(one.effect, one.joints) for one in plan.blind_spots] == [
        ("cogging_torque", ("shoulder",))
    ]
    alone = Wishes(joints=("elbow",))
    assert all("shoulder" not in one.joints for one in plan_of(arm(), wishes=alone).blind_spots)


def test_links_without_geometry_are_pointed_out_first():
    model = arm()
    model.geom_contype[1:] = 0
    model.geom_conaffinity[1:] = 0
    first = plan_of(model).notes[0]
    assert first.startswith("the moving links have no geometry that can collide")


def test_torque_motions_carry_the_torques_of_the_model():
    motor = '<motor name="{0}" joint="{0}" ctrlrange="-40 40"/>'
    model = arm(actuators=motor.format("shoulder") + motor.format("elbow"))
    limits = robot_limits({EFFORT: model})
    plan = make_plan(model, limits, Request(kinds=(EFFORT,), seconds=8.0))
    holds = next(one for one in plan.motions if one.family.label == "holds")
    tracking = holds.motion.tracking
    assert tracking is not None
    data = mujoco.MjData(model)
    still = (np.abs(np.diff(holds.motion.position, axis=0)).max(axis=1) < 1e-12).nonzero()[0]
    middle = still[len(still) // 2]
    data.qpos[:] = holds.motion.position[middle]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(tracking.torque[middle], data.qfrc_bias, atol=1e-6)


def test_gravity_compensation_takes_the_load_off_the_drive():
    model = arm()
    limits = robot_limits({POSITION: model})
    bent = np.full((5, 2), 0.7)
    assert np.abs(SafetyCheck(model, limits).torque(bent, 0.02)).max() > 1.0
    for attribute in ("", 'actuatorgravcomp="true"'):
        model = arm(link='gravcomp="1"', joint=attribute)
        np.testing.assert_allclose(SafetyCheck(model, limits).torque(bent, 0.02), 0.0, atol=1e-9)


def test_a_contact_blames_the_joints_that_would_part_the_bodies():
    model = arm(wall=0.5)
    check = SafetyCheck(model, robot_limits({POSITION: model}))
    fault = check.contact(np.array([[0.0, 0.0], [-1.2, 0.0], [-1.4, 0.0]]))
    assert fault is not None
    assert fault.kind is FaultKind.CONTACT
    assert fault.joints.tolist() == [True, False]
    assert check.contact(np.array([[1.2, 0.0]])) is None


def test_the_clearance_is_kept():
    model = arm(wall=0.5)
    limits = robot_limits({POSITION: model})
    reach = np.array([[-np.arcsin((0.5 - 0.03 - 0.02) / 0.8), 0.0]])
    assert SafetyCheck(model, limits, clearance_m=0.01).contact(reach) is None
    assert SafetyCheck(model, limits, clearance_m=0.04).contact(reach) is not None


def test_a_path_is_looked_at_every_few_milliseconds():
    path = np.array([[0.0, 1.0], [0.2, 1.0], [0.4, 0.0]])
    fine = refined(path, 0.02)
    assert len(fine) == 9
    np.testing.assert_allclose(fine[::4], path)
    np.testing.assert_allclose(np.diff(fine[:, 0]), 0.05)


def test_limits_come_from_the_model_with_a_margin():
    model = arm()
    servo = arm(
        actuators='<velocity name="shoulder" joint="shoulder" ctrlrange="-3 3" kv="10"/>'
        '<velocity name="elbow" joint="elbow" ctrlrange="-2 2" kv="10"/>'
    )
    limits = robot_limits({POSITION: model, VELOCITY: servo})
    np.testing.assert_allclose(limits.speed, [1.35, 0.9])
    np.testing.assert_allclose(limits.acceleration, [10.0, 9.0])
    np.testing.assert_allclose(limits.upper, [2.0 - 0.12, 2.5 - 0.15])
    np.testing.assert_allclose(limits.effort, [27.0, 9.0])
    assert limits.notes == ()


def test_what_the_model_does_not_say_is_assumed_and_said():
    limits = robot_limits({POSITION: arm(actuators='<position name="elbow" joint="elbow"/>')})
    assert limits.joint_names == ("elbow",)
    np.testing.assert_allclose(limits.speed, 1.0)
    assert np.isinf(limits.effort).all()
    assert [note.split(":")[0] for note in limits.notes] == [
        "no velocity limit in the model",
        "no torque limit in the model, so none was kept to",
    ]


def test_a_slide_needs_a_range_and_is_slow():
    xml = """
    <mujoco><worldbody><body><joint name="rail" type="slide" {}/><geom size="0.1"/></body>
    </worldbody><actuator><position name="rail" joint="rail" {}/></actuator></mujoco>"""
    unknown = mujoco.MjModel.from_xml_string(xml.format("", ""))
    with pytest.raises(ConfigError, match="rail slides without a range; expected --range rail=LO"):
        robot_limits({POSITION: unknown})
    for known in (
        xml.format('range="-1 1" limited="true"', ""),
        xml.format("", 'ctrlrange="-1 1"'),
    ):
        limits = robot_limits({POSITION: mujoco.MjModel.from_xml_string(known)})
        np.testing.assert_allclose(limits.speed, 0.1)
        np.testing.assert_allclose(limits.upper, 0.94)


def test_wishes_come_before_the_model():
    wishes = Wishes(
        ranges={"elbow": (-1.0, 0.5)}, speed={"": 0.4, "elbow": 0.2}, acceleration={"": 2.0}
    )
    limits = robot_limits({POSITION: arm()}, wishes)
    np.testing.assert_allclose(limits.lower[1], -0.95)
    np.testing.assert_allclose(limits.upper[1], 0.45)
    np.testing.assert_allclose(limits.speed, [0.4, 0.2])
    np.testing.assert_allclose(limits.acceleration, 2.0)


@pytest.mark.parametrize(
    ("wishes", "error", "message"),
    [
        (Wishes(joints=("wrist",)), UnknownNameError, "unknown joint 'wrist'"),
        (Wishes(pose="home"), UnknownNameError, "unknown keyframe 'home'; available: none"),
        (Wishes(speed={"": -1.0}), ConfigError, "velocity of shoulder is -1, expected more than 0"),
        (Wishes(ranges={"elbow": (1.0, 2.0)}), ConfigError, "joint elbow begins at 0, expected"),
    ],
)
def test_wishes_that_cannot_be_are_refused(wishes, error, message):
    with pytest.raises(error, match=message):
        robot_limits({POSITION: arm()}, wishes)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"seconds": 2.0}, "seconds is 2, expected 8 to 600"),
        ({"period_s": 1.0}, "period_s is 1, expected 0.002 to 0.1"),
        ({"seed": -1}, "seed is -1, expected 0 to"),
    ],
)
def test_requests_out_of_range_are_refused(asked, message):
    with pytest.raises(ConfigError, match=message):
        Request(kinds=(POSITION,), **asked)


def test_every_effect_of_the_library_that_joints_can_show_has_a_motion():
    from gfm.effects import effect_library

    joints = {name for name in effect_library() if not name.startswith("object_")}
    # No motion is proposed that runs onto things.
    assert {name for name in joints if not shown_by(name)} == {"surface_contact"}
    shown = {effect for family in FAMILIES for effect in family.shows}
    assert shown <= set(effect_library())


def test_an_effect_that_no_motion_is_there_for_gets_all_of_them():
    plan = plan_of(arm(), effects=("my_effect", "cogging_torque"))
    assert len(plan.motions) == len(FAMILIES)
    assert "no motion is there for my_effect: all of them are proposed" in plan.notes
    assert families_for(("my_effect",)) == FAMILIES
    assert families_for(()) == FAMILIES


def test_where_what_is_to_blame_stands_still_all_others_come_nearer():
    limits = robot_limits({POSITION: arm()})
    room, _ = find_room(SafetyCheck(arm(), limits, clearance_m=0.01), limits)
    away = np.array([0.0, 0.5])
    fault = Fault(
        kind=FaultKind.CONTACT,
        words="elbow and wall touch",
        position=limits.start + away,
        joints=np.array([True, False]),
    )
    less = room.smaller(limits, fault)
    np.testing.assert_array_equal(less.lower, room.lower)
    assert less.upper[0] == room.upper[0]
    assert limits.start[1] < less.upper[1] < room.upper[1]


def test_two_boxes_are_kept_apart_where_an_edge_comes_near_a_corner():
    model = mujoco.MjModel.from_xml_string(
        """
        <mujoco><worldbody>
          <geom name="wall" type="box" size="0.2 0.2 0.01" margin="0.05"/>
          <body name="plate" pos="0.1 0.2 0.1">
            <joint name="slide" type="slide" axis="0 0 1" range="-1 1"/>
            <geom type="box" size="0.06 0.005 0.08" euler="30 15 30" mass="1"/></body>
        </worldbody><actuator><position name="slide" joint="slide" kp="100"/></actuator></mujoco>
        """
    )
    data, missed = mujoco.MjData(model), 0
    limits = replace(robot_limits({POSITION: model}), start=np.array([0.5]))
    check = SafetyCheck(model, limits, clearance_m=0.03)
    for height in np.linspace(-0.01, 0.1, 56):
        data.qpos[:] = height
        mujoco.mj_kinematics(model, data)
        mujoco.mj_collision(model, data)
        distance_m = mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None)
        assert distance_m > 0.0
        missed += distance_m < 0.03 and data.ncon == 0
        fault = check.contact(np.array([[height]]))
        assert (fault is not None) is (distance_m < 0.03)
    assert missed
