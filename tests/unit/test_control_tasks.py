"""The control tasks: their constants, their success tests, and what a plain program achieves."""

import math

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gfm.core import CommandKind, ConfigError, ShapeError
from gfm.envs.arm import CONTROL_PERIOD_S, Arm, ArmProblem
from gfm.envs.control_settings import ControlSettings, Curriculum
from gfm.envs.history import History
from gfm.envs.joint_tracking import JointTracking, minimum_jerk
from gfm.envs.matching import Matching
from gfm.envs.matching_task import (
    FAILURE_REWARD,
    POSE_MATCHING,
    POSITION_MATCHING,
    check_goals,
)
from gfm.envs.matching_view import STATES
from gfm.envs.outcomes import Outcome, Outcomes
from gfm.envs.registry import (
    EnvironmentAssets,
    EnvironmentSettings,
    arm_problem,
    furnished,
    make_environment,
)
from gfm.sim import sawyer_numbers as numbers
from gfm.sim.cell import BALL_RADIUS_M
from gfm.sim.kinematics import SiteKinematics, body_axes, wrapped, yaw_of
from gfm.sim.randomised import randomised_models
from gfm.sim.sawyer import READY, sawyer_spec

CENTRE = np.array(numbers.BASKET_XYZ)
NOWHERE = EnvironmentAssets()


def problem(name="position_matching", **control):
    settings = EnvironmentSettings(control=ControlSettings(**control))
    return arm_problem(name, settings, NOWHERE)


def yawed(angle):
    half = np.asarray(angle) / 2.0
    zero = np.zeros_like(half)
    return body_axes(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1))


def placed(x, y, z=0.08):
    return CENTRE * [1, 1, 0] + np.array([[x, y, z]])


def test_the_papers_constants_hold():
    arm = problem()
    limits = np.array([joint.velocity for joint in numbers.JOINTS])
    np.testing.assert_allclose(arm.velocity_limit, 0.05 * limits)
    assert arm.model.timestep_s == 0.002
    assert CONTROL_PERIOD_S == 1 / 20 == arm.model.control_period_s
    assert STATES == 10
    assert (POSITION_MATCHING.steps, POSE_MATCHING.steps) == (400, 600)
    assert (POSITION_MATCHING.end_effector, POSE_MATCHING.end_effector) == ("plate", "ball")
    assert POSITION_MATCHING.tolerance_m == 0.025
    assert POSE_MATCHING.tolerance_m == 0.05
    assert POSE_MATCHING.tolerance_rad == math.radians(20.0)
    assert POSITION_MATCHING.free_object != POSE_MATCHING.free_object
    assert arm.model.force_limit.tolist() == [5.0] * 7 + [0.03] * 6


@pytest.mark.parametrize("task", [POSITION_MATCHING, POSE_MATCHING])
def test_ten_goals_lie_evenly_around_the_centre(task):
    goals = task.radial_goals()
    offset = goals[:, :2] - CENTRE[:2]
    np.testing.assert_allclose(np.linalg.norm(offset, axis=1), task.goal_radius_m)
    angles = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    np.testing.assert_allclose(np.diff(angles), 2 * np.pi / 10)
    assert (np.abs(goals[:, 2]) == task.goal_yaw_rad).all()


@pytest.mark.parametrize("task", [POSITION_MATCHING, POSE_MATCHING])
def test_random_goals_surround_the_radial_ones(task):
    goals = task.random_goals(2000, np.random.default_rng(0))
    radius = np.linalg.norm(goals[:, :2] - CENTRE[:2], axis=1)
    assert radius.max() <= 1.2 * task.goal_radius_m
    assert radius.max() > task.goal_radius_m
    assert np.abs(goals[:, :2].mean(axis=0) - CENTRE[:2]).max() < 0.005
    assert np.abs(goals[:, 2]).max() <= 1.2 * task.goal_yaw_rad
    if task.goal_yaw_rad:
        assert np.abs(goals[:, 2]).max() > task.goal_yaw_rad


@pytest.mark.parametrize(("offset", "expected"), [(0.0249, True), (0.0251, False)])
def test_a_position_is_reached_within_25_millimetres_whatever_the_yaw(offset, expected):
    goal = np.array([[CENTRE[0], CENTRE[1], 0.0]])
    for yaw in (0.0, 2.0):
        reached = POSITION_MATCHING.reached(placed(0.0, offset), yawed([yaw]), goal)
        assert reached.tolist() == [expected]


@pytest.mark.parametrize(
    ("offset", "degrees", "expected"),
    [(0.049, 19.9, True), (0.049, -19.9, True), (0.051, 0.0, False), (0.0, 20.1, False)],
)
def test_a_pose_is_reached_within_5_centimetres_and_20_degrees(offset, degrees, expected):
    goal = np.array([[CENTRE[0], CENTRE[1], math.pi]])  # across the seam of the angle
    axes = yawed([math.pi + math.radians(degrees)])
    assert POSE_MATCHING.reached(placed(offset, 0.0), axes, goal).tolist() == [expected]


@pytest.mark.parametrize("task", [POSITION_MATCHING, POSE_MATCHING])
def test_distance_is_one_at_the_edge_of_the_tolerance(task):
    goal = np.array([[CENTRE[0], CENTRE[1], 0.3]])
    edge = task.distance(placed(task.tolerance_m, 0.0), yawed([0.3]), goal)
    np.testing.assert_allclose(edge, 1.0)


@pytest.mark.parametrize("task", [POSITION_MATCHING, POSE_MATCHING])
def test_the_potential_is_zero_at_the_goal_and_grows_on_the_way_to_it(task):
    goal = np.array([[CENTRE[0], CENTRE[1], 0.3]])
    way = [(0.08, 0.9), (0.06, 0.8), (0.04, 0.6), (0.02, 0.4), (0.0, 0.3)]
    potentials = []
    for x, yaw in way:
        position = placed(x, 0.0)
        tip = task.tool_place(position - [[0.05, 0.0, 0.0]], position, yawed([yaw]), goal)
        potentials.append(task.potential(tip, position, yawed([yaw]), goal)[0])
    assert potentials[-1] == 0.0
    assert np.all(np.diff(potentials) > 0.5)


def test_two_centimetres_of_the_tool_are_worth_one_and_those_of_the_object_two():
    task, position = POSITION_MATCHING, placed(0.0, 0.0)
    goal = np.array([[CENTRE[0] + 0.08, CENTRE[1], 0.0]])
    tip = task.tool_place(position - [[0.05, 0.0, 0.0]], position, yawed([0.0]), goal)
    there = task.potential(tip, position, yawed([0.0]), goal)
    aside = np.array([[0.0, 0.02, 0.0]])
    tool_off = task.potential(tip + aside, position, yawed([0.0]), goal)
    np.testing.assert_allclose(there - tool_off, 1.0)
    away = np.array([[0.02, 0.0, 0.0]])
    further = task.potential(tip - away, position - away, yawed([0.0]), goal)
    np.testing.assert_allclose(there - further, 2.0)


@pytest.mark.parametrize("task", [POSITION_MATCHING, POSE_MATCHING])
def test_an_episodes_rewards_add_up_to_the_way_made_and_the_time_at_the_goal(task):
    env = Matching(task, problem(task.name), 3, seed=1, horizon=30)
    rng = np.random.default_rng(0)

    def potential():
        scene = env.scene()
        return task.potential(scene.tip, scene.position, scene.axes, env.goal)

    for ids in (None, np.array([0, 2])):  # the second time one instance goes on
        env.reset(ids)
    begun, total = potential(), np.zeros(3)
    for _ in range(30):
        total += env.step(rng.uniform(-1, 1, size=(3, 7)).astype(np.float32)).reward
        scene = env.scene()
        total -= 0.5 * task.reached(scene.position, scene.axes, env.goal)
    np.testing.assert_allclose(total, potential() - begun, atol=1e-4)


def test_the_tool_is_drawn_over_the_object_to_its_far_side_and_then_against_it():
    task, position = POSITION_MATCHING, placed(0.0, 0.0)
    goal = np.array([[CENTRE[0] + 0.08, CENTRE[1], 0.0]])
    x = task.pusher.contact_m[0]
    beside, clear = position[0, 2], position[0, 2] + 0.06
    tips = {(0.1, 0.0): clear, (0.1, 0.06): clear, (-x - 0.015, 0.06): beside}
    for (offset, height), wanted in tips.items():
        tip = position + np.array([offset, 0.0, height])
        place = task.tool_place(tip, position, yawed([0.0]), goal)[0]
        assert place[2] == pytest.approx(wanted)
        assert place[0] < position[0, 0] - x + 0.025
        assert place[1] == pytest.approx(position[0, 1])
    low = position - np.array([x, 0.0, 0.0])
    pressed = task.tool_place(low, position, yawed([0.0]), goal)[0]
    assert pressed[2] == pytest.approx(beside)
    assert pressed[0] - low[0, 0] == pytest.approx(0.02)
    here, there = (
        task.potential(tip, position, yawed([0.0]), goal) for tip in (low, 2.0 * position - low)
    )
    assert here > there


def test_a_push_that_turns_passes_the_centre_on_the_side_that_turns_it_there():
    position = placed(0.0, 0.0, 0.025)
    behind = position - [[0.1, 0.0, 0.0]]
    for yaw, sign in ((1.0, 1.0), (-1.0, -1.0)):
        goal = np.array([[CENTRE[0] + 0.06, CENTRE[1], yaw]])
        push = POSE_MATCHING.pusher.push(behind, position, yawed([0.0]), goal)
        np.testing.assert_allclose(push.way, [[1.0, 0.0]], atol=1e-12)
        lever = np.array([0.0, push.lateral[0]])  # its moment about the centre: lever x way
        assert np.sign(lever[0] * push.way[0, 1] - lever[1] * push.way[0, 0]) == sign
    straight = np.array([[CENTRE[0] + 0.06, CENTRE[1], 0.0]])
    push = POSE_MATCHING.pusher.push(behind, position, yawed([0.0]), straight)
    assert push.lateral[0] == 0.0
    assert push.contact[0] == pytest.approx(0.05 + BALL_RADIUS_M)  # the bar's end
    push = POSE_MATCHING.pusher.push(behind, position, yawed([math.pi / 2]), straight)
    assert push.contact[0] == pytest.approx(0.04 + BALL_RADIUS_M)  # its flat side


def test_success_is_the_goal_held_for_ten_steps_in_a_row():
    outcomes = Outcomes(3)
    running = np.zeros(3, np.int64)
    for step in range(12):
        reached = np.array([True, step != 5, False])
        outcomes.judge(reached, running, np.full(3, step == 11))
        if step == 8:
            assert outcomes.now.tolist() == [Outcome.RUNNING] * 3
        if step == 9:
            assert outcomes.now.tolist() == [Outcome.REACHED, Outcome.RUNNING, Outcome.RUNNING]
    assert outcomes.now.tolist() == [Outcome.REACHED, Outcome.OUT_OF_TIME, Outcome.OUT_OF_TIME]
    assert outcomes.gauges() == {"success_rate": pytest.approx(1 / 3)}


def test_a_success_stays_one_and_a_failure_too():
    outcomes = Outcomes(2)
    failure = np.array([Outcome.RUNNING, Outcome.DIVERGED])
    for step in range(10):
        outcomes.judge(np.ones(2, bool), failure if step == 3 else 0 * failure, np.zeros(2, bool))
    late = np.array([Outcome.TOOL_LEFT_WORKSPACE] * 2)
    outcomes.judge(np.zeros(2, bool), late, np.ones(2, bool))
    assert outcomes.now.tolist() == [Outcome.REACHED, Outcome.DIVERGED]
    outcomes.start(np.array([1]))
    assert outcomes.now.tolist() == [Outcome.REACHED, Outcome.RUNNING]


def test_leaving_the_workspace_terminates_and_costs():
    goals = POSITION_MATCHING.radial_goals()[:2]
    arm = problem(curriculum=Curriculum(gains=(6.0,)))
    env = Matching(POSITION_MATCHING, arm, 2, goals=goals)
    env.reset()
    action = np.zeros((2, 7), np.float32)
    action[1, 3] = -1.0  # the elbow stretches: the tool goes forwards and up
    for _ in range(40):
        transition = env.step(action)
        if transition.ended[1]:
            break
    assert transition.ended.tolist() == [False, True]
    assert transition.discount.tolist() == [1.0, 0.0]
    assert transition.reward[1] == FAILURE_REWARD < transition.reward[0]
    assert env.outcome.tolist() == [Outcome.RUNNING, Outcome.TOOL_LEFT_WORKSPACE]


def test_the_object_begins_at_the_centre_and_rests_there():
    env = Matching(POSE_MATCHING, problem("pose_matching"), 4, seed=3)
    env.reset()
    start = env.scene()
    assert np.abs(start.position - POSE_MATCHING.rest_position).max() <= 0.005 + 1e-9
    assert np.ptp(start.position[:, 0]) > 0.0
    for _ in range(10):
        env.step(np.zeros((4, 7), np.float32))
    np.testing.assert_allclose(env.scene().position, start.position, atol=5e-4)


def test_an_action_of_one_moves_a_joint_at_its_limit_times_the_gain():
    for gain in (1.0, 6.0):
        arm = problem(curriculum=Curriculum(gains=(gain,)))
        arms = Arm(arm, 1, np.random.default_rng(0), 1)
        arms.reset(np.array([0]), arm.model.layout.as_qpos(READY[None], None))
        for _ in range(8):
            arms.step(np.array([[0, 0, 0, 0, 0, 0, 1.0]], np.float32))
        assert arms.qvel[0, 6] == pytest.approx(gain * 0.05 * 4.545, rel=0.03)


def test_the_curriculum_comes_down_in_stages_and_reaches_only_new_episodes():
    curriculum = Curriculum(gains=(6.0, 5.0, 1.0), stage_steps=100)
    assert [curriculum.gain(n) for n in (0, 99, 100, 199, 200, 10**6)] == [6, 6, 5, 5, 1, 1]
    env = Matching(POSITION_MATCHING, problem(curriculum=curriculum), 2)
    env.reset()
    env.set_progress(250)
    assert env.gauges()["curriculum_gain"] == 6.0
    env.reset(np.array([1]))
    assert env.gauges()["curriculum_gain"] == 3.5


def test_a_gain_that_is_not_positive_is_refused():
    with pytest.raises(ConfigError, match=r"gains are \[6\.0, 0\.0\], expected positive"):
        Curriculum(gains=(6.0, 0.0))


def test_perturbations_move_the_object_and_stay_within_the_force_limits():
    quiet, shaken = (
        Matching(POSITION_MATCHING, problem(perturbation=share), 1) for share in (0.0, 1.0)
    )
    ends = []
    for env in (quiet, shaken):
        env.reset()
        for _ in range(20):
            env.step(np.zeros((1, 7), np.float32))
        ends.append(env.qpos[0, :7])
    assert np.abs(ends[0] - ends[1]).max() > 1e-3
    arms = Arm(problem(perturbation=0.5), 3, np.random.default_rng(0), 1)
    forces = np.array([arms._random_forces() for _ in range(200)])
    limit = problem().model.force_limit
    assert (np.abs(forces) <= 0.5 * limit).all()
    assert (np.abs(forces).max(axis=(0, 1)) > 0.45 * limit).all()


def test_randomised_models_differ_within_their_spread_and_keep_the_kinematics():
    nominal = problem().nominal
    variants = randomised_models(nominal, 8, 0.5, np.random.default_rng(0))
    body = nominal.body("object").id
    ratios = np.array([v.body_mass[body] / nominal.body_mass[body] for v in variants])
    assert ((ratios >= 1 / 1.5) & (ratios <= 1.5)).all()
    assert np.ptp(ratios) > 0.2
    gains = np.array([v.actuator_gainprm[:, 0] / nominal.actuator_gainprm[:, 0] for v in variants])
    biases = np.array([v.actuator_biasprm[:, 2] / nominal.actuator_biasprm[:, 2] for v in variants])
    np.testing.assert_allclose(gains, biases)
    for variant in variants:
        np.testing.assert_array_equal(variant.body_pos, nominal.body_pos)
    assert nominal.body_mass[body] == pytest.approx(0.15)


def test_episodes_draw_different_variants():
    env = Matching(POSITION_MATCHING, problem(randomisation=0.5, variants=4), 16)
    env.reset()
    for _ in range(3):
        env.step(np.ones((16, 7), np.float32))
    assert len(np.unique(env.qpos[:, 0].round(9))) > 1


def test_history_holds_the_same_states_in_another_form():
    rng = np.random.default_rng(0)
    states = rng.normal(size=(5, 2, 3))
    history = History(2, 4, 3)
    history.fill(np.arange(2), states[0])
    for state in states[1:]:
        history.push(state)
    seen = history.observed(0.1).reshape(2, 4, 3).astype(float)
    rebuilt = seen[:, 0][:, None] - 0.1 * np.cumsum(
        np.concatenate([np.zeros((2, 1, 3)), seen[:, 1:]], axis=1), axis=1
    )
    np.testing.assert_allclose(rebuilt, states[:0:-1].transpose(1, 0, 2), atol=1e-6)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_body_axes_are_columns_of_the_rotation(q):
    quaternion = np.array([q]) / np.linalg.norm(q)
    matrix = Rotation.from_quat(quaternion[0], scalar_first=True).as_matrix()
    axes = body_axes(quaternion)[0]
    np.testing.assert_allclose(axes, [*matrix[:, 0], *matrix[:, 2]], atol=1e-12)


@given(st.floats(-3.1, 3.1))
def test_yaw_is_read_back(angle):
    np.testing.assert_allclose(yaw_of(yawed([angle])), [angle], atol=1e-12)
    assert -np.pi <= wrapped(np.array([5.0 * angle]))[0] < np.pi


def test_the_tip_is_where_mujoco_has_it():
    model = problem().nominal
    data = mujoco.MjData(model)
    data.qpos[:7] = READY + 0.1
    mujoco.mj_forward(model, data)
    tip = SiteKinematics(model, "end_effector").positions(data.qpos[None])
    np.testing.assert_allclose(tip[0], data.site("end_effector").xpos, atol=1e-12)


def test_the_tip_moves_as_its_jacobian_says():
    tip = SiteKinematics(problem().nominal, "end_effector")
    qpos = problem().nominal.qpos0.copy()
    qpos[:7] = READY
    step = np.zeros((7, len(qpos)))
    step[:, :7] = 1e-6 * np.eye(7)
    differences = (tip.positions(qpos + step) - tip.positions(qpos - step)) / 2e-6
    jacobian = tip.jacobian(qpos)
    np.testing.assert_allclose(jacobian[:, :7], differences.T, atol=1e-8)
    np.testing.assert_array_equal(jacobian[:, 7:], 0.0)


def test_the_objects_own_friction_counts_in_contacts():
    model = problem().nominal
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("ready").id)
    mujoco.mj_forward(model, data)
    for _ in range(20):
        mujoco.mj_step(model, data)
    assert data.ncon > 0
    assert {round(float(contact.friction[0]), 6) for contact in data.contact} == {0.4}


def test_a_minimum_jerk_way_is_smooth_and_passes_its_points():
    points = np.array([[[0.0], [1.0], [-0.5]]])
    way = minimum_jerk(points, 400)[0, :, 0]
    assert way[[0, 400, 800]].tolist() == [0.0, 1.0, -0.5]
    speed = np.diff(way) * 400
    assert speed.max() == pytest.approx(1.875, rel=1e-3)
    assert abs(speed[0]) < 1e-3
    assert abs(speed[400]) < 1e-3


def test_tracking_is_possible_at_the_speed_limit_and_perfect_tracking_earns_all():
    env = JointTracking(problem("joint_tracking"), 4, seed=1)
    env.reset()
    limit, rewards = problem("joint_tracking").velocity_limit, []
    for _ in range(200):
        before = env.reference
        env_ahead = env._reference[np.arange(4), env._at + 1]
        wanted = (env_ahead - before) / CONTROL_PERIOD_S + 4.0 * (before - env.position)
        rewards.append(env.step((wanted / limit).astype(np.float32)).reward)
    assert np.abs(wanted / limit).max() < 1.0
    assert np.mean(rewards) > 0.95


def test_a_bare_arm_is_furnished_for_the_task_and_a_whole_cell_is_left_alone():
    bare = sawyer_spec(command=CommandKind.VELOCITY)
    text = bare.compile() and bare.to_xml()
    model = furnished("pose_matching", mujoco.MjSpec.from_string(text)).compile()
    whole = problem("pose_matching").nominal
    assert model.nq == whole.nq
    assert model.geom("ball").id >= 0
    assert model.opt.integrator == whole.opt.integrator
    env = make_environment(
        "pose_matching",
        EnvironmentSettings(),
        num_envs=1,
        seed=0,
        assets=EnvironmentAssets(models={CommandKind.VELOCITY: model}),
    )
    reference = make_environment("pose_matching", EnvironmentSettings(), num_envs=1, seed=0)
    np.testing.assert_allclose(env.reset(), reference.reset(), atol=1e-4)  # MJCF has six digits
    spec = sawyer_spec(command=CommandKind.VELOCITY, end_effector="ball", free_object="tee")
    bodies = len(spec.bodies)
    assert len(furnished("pose_matching", spec).bodies) == bodies


def test_models_that_cannot_serve_are_refused():
    hinge = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body name='link'><joint name='a'/><geom size='.1'/></body></worldbody>"
        "<actuator><velocity name='a' joint='a' ctrlrange='-1 1'/></actuator></mujoco>"
    )
    with pytest.raises(ConfigError, match="neither a body 'object' nor a body 'right_hand'"):
        furnished("position_matching", hinge)
    hinge.option.timestep = 0.002
    model = hinge.compile()
    for name, message in (
        ("joint_tracking", "the model has 1 joints, expected 7"),
        ("position_matching", "1 joints and no object, expected a Sawyer's 7"),
    ):
        assets = EnvironmentAssets(models={CommandKind.VELOCITY: model})
        with pytest.raises(ConfigError, match=message):
            make_environment(name, EnvironmentSettings(), num_envs=1, seed=0, assets=assets)
    assets = EnvironmentAssets(models={CommandKind.POSITION: model})
    with pytest.raises(ConfigError, match="need a velocity model, got one for position"):
        make_environment("joint_tracking", EnvironmentSettings(), num_envs=1, seed=0, assets=assets)


def test_a_goal_outside_the_basket_is_refused_and_all_of_the_tasks_are_inside():
    arm, goals = problem(), POSITION_MATCHING.radial_goals()[:2]
    with pytest.raises(ShapeError, match=r"goals has shape \(2, 3\), expected \(1, 3\)"):
        Matching(POSITION_MATCHING, arm, 1, goals=goals)
    goals[1, 0] += 0.2
    with pytest.raises(ConfigError, match=r"goal 1 is at x 0\.865 m, y 0\.047 m, expected a place"):
        Matching(POSITION_MATCHING, arm, 2, goals=goals)
    for task in (POSITION_MATCHING, POSE_MATCHING):
        check_goals(task.radial_goals(), 10)
        check_goals(task.random_goals(500, np.random.default_rng(0)), 500)


def follow(arm: ArmProblem, task, scene, goal, qpos):
    """Goes where the reward wants the tool, upright, at 8 cm/s at most; knows nothing else."""
    place = task.tool_place(scene.tip, scene.position, scene.axes, goal[None])
    velocity = 2.0 * (place - scene.tip)[0]
    velocity *= min(1.0, 0.08 / np.linalg.norm(velocity))
    return _towards(arm.nominal, mujoco.MjData(arm.nominal), qpos, velocity, arm.velocity_limit)


def _towards(model, data, qpos, velocity, limit):
    """Joint velocities in units of their limits that move the tip and keep the tool upright."""
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    jacobian = np.zeros((6, model.nv))
    site = model.site("end_effector").id
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
    turn = 0.5 * np.cross(
        data.site_xmat[site].reshape(3, 3).T, [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    ).sum(axis=0)
    scaled = jacobian[:, :7] * limit
    wanted = np.concatenate([velocity, 2.0 * turn])
    action = scaled.T @ np.linalg.solve(scaled @ scaled.T + 1e-5 * np.eye(6), wanted)
    return action / max(np.abs(action).max(), 1.0)


@pytest.mark.parametrize(
    ("task", "number"),
    [
        *((POSITION_MATCHING, number) for number in (0, 3, 7)),
        (POSE_MATCHING, 0),
        (POSE_MATCHING, 3),
    ],
)
def test_to_follow_the_reward_is_to_reach_the_goal_in_time_without_a_gain(task, number):
    arm, goal = problem(task.name), task.radial_goals()[number]
    env = Matching(task, arm, 1, goals=goal[None])
    env.reset()
    while env.outcome[0] == Outcome.RUNNING:
        action = follow(arm, task, env.scene(), goal, env.qpos[0])
        env.step(action[None].astype(np.float32))
    assert env.outcome[0] == Outcome.REACHED
