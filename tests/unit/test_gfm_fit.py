"""The fitting problem on a hinge whose recording knows a torque that the model does not."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gfm.core import CommandKind, ConfigError, RecordingError, Trajectory
from gfm.envs.difference import closeness, rotation_difference, state_difference
from gfm.envs.fit_problem import make_fit_problem
from gfm.envs.gfm_fit import GfmFit
from gfm.envs.warm_start import warm_start_examples
from gfm.sim.features import Features
from gfm.sim.hybrid import ForceLimits, HybridModel
from gfm.sim.layout import make_layout
from gfm.sim.residual import residual_forces
from gfm.sim.sawyer import sawyer_spec

TORQUE, LIMIT = 1.5, 5.0
HINGE = """
<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body>
  <joint name="a" axis="0 0 1" armature="0.5" damping="0.2"/>
  <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
  <actuator><{kind} name="a" joint="a" {gains}/></actuator></mujoco>"""


def hinge():
    kinds = {
        CommandKind.POSITION: HINGE.format(kind="position", gains='kp="40" kv="4"'),
        CommandKind.VELOCITY: HINGE.format(kind="velocity", gains='kv="10"'),
    }
    models = {kind: mujoco.MjModel.from_xml_string(xml) for kind, xml in kinds.items()}
    return HybridModel(models=models, limits=ForceLimits(joint_nm=LIMIT))


def recording(model, kind, torque=TORQUE, seconds=4.0):
    """Made by the model itself with a constant torque, commands every 50 ms from the start."""
    data = mujoco.MjData(model.models[kind])
    data.qfrc_applied[0] = torque
    positions, commands = [], []
    for period in range(round(seconds / 0.05)):
        data.ctrl[0] = 0.4 * np.sin(0.1 * period)
        commands.append(data.ctrl[0])
        for _ in range(25):
            positions.append(data.qpos[0])
            mujoco.mj_step(model.models[kind], data)
    stamps = np.arange(len(positions)) * 2_000_000
    return Trajectory(
        name=str(kind),
        joint_names=("a",),
        stamp_ns=stamps,
        position=np.array(positions)[:, None],
        velocity=None,
        effort=None,
        command_kind=kind,
        command_stamp_ns=stamps[::25],
        command=np.array(commands)[:, None],
    )


@pytest.fixture(scope="module")
def model():
    return hinge()


@pytest.fixture(scope="module")
def recordings(model):
    return [recording(model, kind) for kind in model.models]


@pytest.fixture(scope="module")
def problem(model, recordings):
    return make_fit_problem(model, recordings)


def mean_reward(env, action):
    env.reset()
    full = np.full((env.num_envs, env.spec.action_size), action, np.float32)
    return np.mean([env.step(full).reward for _ in range(20)], axis=0)


def test_the_missing_force_earns_the_whole_reward(problem):
    env = GfmFit(problem, 16, seed=1)
    assert mean_reward(env, TORQUE / LIMIT).min() > 0.99
    assert mean_reward(env, 0.0).mean() < 0.7
    assert mean_reward(env, -TORQUE / LIMIT).max() < 0.4


def test_the_nominal_models_root_mean_square_difference_is_at_most_one(model, recordings):
    """Where random forces do less than the model's own error, it is exactly one."""
    problem = make_fit_problem(model, recordings, exploration=1e-6)
    env = GfmFit(problem, 200, seed=0)
    env.reset()
    exponents = [-np.log(env.step(np.zeros((200, 1), np.float32)).reward) for _ in range(20)]
    assert np.mean(exponents) == pytest.approx(1.0, rel=0.15)


def test_observation_holds_history_newest_first_then_the_drive_torque(problem):
    env = GfmFit(problem, 4, seed=0)
    first = env.reset()
    second = env.step(np.zeros((4, 1), np.float32)).observation
    assert env.spec.policy_size == 6 * 2 + 1
    assert first.shape == (4, env.spec.policy_size + 2 * 2)
    np.testing.assert_array_equal(second[:, 2:12], first[:, :10])


def test_the_critic_alone_sees_how_far_the_recorded_states_are(problem):
    env = GfmFit(problem, 50, seed=0)
    now, ahead = np.split(env.reset()[:, env.spec.policy_size :], 2, axis=1)
    np.testing.assert_array_equal(now, 0.0)  # episodes start at recorded states
    assert (np.abs(ahead).max(axis=1) > 0.0).all()
    for _ in range(20):
        transition = env.step(np.zeros((50, 1), np.float32))
        now = transition.observation[:, env.spec.policy_size :][:, :2]
        expected = np.exp(-np.square(now).sum(axis=1))
        np.testing.assert_allclose(transition.reward, expected, rtol=1e-4)


def test_what_follows_the_end_of_a_recording_is_not_the_next_one(problem):
    windows = problem.windows
    last = np.flatnonzero(np.diff(windows.recording, append=-1))
    np.testing.assert_array_equal(windows.following(last), last)
    np.testing.assert_array_equal(windows.following(last - 1), last)


def test_history_at_the_start_is_the_recorded_one(problem):
    env = GfmFit(problem, 50, seed=3)
    observation = env.reset()
    states = observation[:, :12].reshape(50, 6, 2)[:, ::-1]
    recorded = problem.windows.state
    for row in states:
        at = int(np.flatnonzero((recorded == row[-1]).all(axis=1))[0])
        np.testing.assert_array_equal(recorded[at - 5 : at + 1], row)
        assert len(set(problem.windows.recording[at - 5 : at + 21])) == 1


def test_episodes_start_in_every_recording_and_replay_its_kind_of_command(problem):
    env = GfmFit(problem, 100, seed=0)
    assert mean_reward(env, TORQUE / LIMIT).min() > 0.99
    started = {int(problem.windows.recording[at]) for at in problem.windows.start}
    assert started == {0, 1}


def test_scale_can_be_given(model, recordings):
    problem = make_fit_problem(model, recordings, scale=[0.1, 0.5])
    np.testing.assert_array_equal(problem.scale, [0.1, 0.5])
    with pytest.raises(ConfigError, match="expected 2 positive numbers"):
        make_fit_problem(model, recordings, scale=[0.1])


def test_a_recording_shorter_than_history_and_horizon_is_refused(model):
    short = recording(model, CommandKind.POSITION, seconds=1.2)
    with pytest.raises(RecordingError, match=r"position: 23 control periods .* at least 25: 5 of"):
        make_fit_problem(model, [short])


def test_a_kind_of_command_without_a_model_is_refused(model, recordings):
    effort = replace(recordings[0], command_kind=CommandKind.EFFORT)
    with pytest.raises(ConfigError, match="effort commands; there are models for position, vel"):
        make_fit_problem(model, [effort])


def test_a_diverging_simulation_terminates_with_no_reward_and_a_finite_observation(model):
    """One time step of a hinge that gets 1e12 N m overflows within the episode."""
    wild = HybridModel(models=model.models, limits=ForceLimits(joint_nm=1e12))
    problem = make_fit_problem(wild, [recording(model, CommandKind.POSITION)], scale=[1.0, 1.0])
    env = GfmFit(problem, 2, seed=0)
    env.reset()
    transition = env.step(np.array([[1.0], [0.0]], np.float32))
    np.testing.assert_array_equal(transition.discount, [0.0, 1.0])
    np.testing.assert_array_equal(transition.ended, [True, False])
    assert transition.reward[0] == 0.0
    assert np.isfinite(transition.observation).all()
    assert env.diverged == 1


def warm_start(problem, recordings):
    return warm_start_examples(problem, [residual_forces(problem.model, r) for r in recordings])


def test_warm_start_gives_the_missing_force_everywhere(problem, recordings):
    observation, action = warm_start(problem, recordings)
    assert observation.shape == (len(action), problem.features.size)
    assert len(action) == 2 * (79 - 5)
    assert np.abs(action - TORQUE / LIMIT)[2:-2].max() < 0.02


def test_warm_start_observations_are_those_of_the_environment(problem, recordings):
    observation, _ = warm_start(problem, recordings)
    env = GfmFit(problem, 20, seed=0)
    for row in env.reset()[:, : env.spec.policy_size]:
        distance = np.abs(observation - row).max(axis=1)
        assert distance.min() < 1e-5


def test_sawyer_with_an_object_has_thirteen_forces_and_twenty_channels():
    spec = sawyer_spec(command=CommandKind.VELOCITY, free_object="brick")
    model = spec.compile()
    layout = make_layout(model)
    qpos, qvel = model.qpos0[None], np.zeros((1, model.nv))
    assert state_difference(layout, qpos, qvel, qpos, qvel).shape == (1, 20)
    hybrid = HybridModel(models={CommandKind.VELOCITY: model})
    assert hybrid.force_limit.shape == (13,)


def test_forces_act_on_the_chosen_joints_and_the_object_only():
    model = sawyer_spec(command=CommandKind.VELOCITY, free_object="brick").compile()
    chosen = ("right_j5", "right_j1")
    hybrid = HybridModel(models={CommandKind.VELOCITY: model}, forced_joints=chosen)
    dofs = [model.joint(name).dofadr[0] for name in ("right_j1", "right_j5")]
    assert hybrid.force_dof[:2].tolist() == dofs
    assert len(hybrid.force_dof) == len(hybrid.force_limit) == 8
    with pytest.raises(ConfigError, match="forced joints elbow: the measured ones are right_j0"):
        HybridModel(models={CommandKind.VELOCITY: model}, forced_joints=("elbow",))


def test_inputs_about_a_joint_are_its_states_and_its_drive():
    zeros = np.zeros(2)
    features = Features(history=1, mean=np.zeros(4), scale=np.ones(4), torque_scale=zeros + 1.0)
    observation = np.zeros((1, features.size), np.float32)
    states = np.array([[[0.0, 1.0, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0]]], np.float32)
    features.fill(observation, states)
    features.put_torque(observation, np.array([[0.0, 1.0]]))
    np.testing.assert_array_equal(observation[0] == 1.0, features.of_joint(1))
    np.testing.assert_array_equal(observation[0] == 0.0, features.of_joint(0))


unit_quaternions = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)


@given(unit_quaternions, unit_quaternions)
def test_rotation_difference_is_the_rotation_vector_of_the_quotient(p, q):
    p, q = (np.array(x) / np.linalg.norm(x) for x in (p, q))
    ours = rotation_difference(p, q)
    quotient = Rotation.from_quat(p[[1, 2, 3, 0]]) * Rotation.from_quat(q[[1, 2, 3, 0]]).inv()
    assert (Rotation.from_rotvec(ours) * quotient.inv()).magnitude() < 1e-7
    assert np.linalg.norm(ours) <= np.pi + 1e-9
    np.testing.assert_allclose(ours, -rotation_difference(q, p), atol=1e-9)


def test_closeness_is_one_at_no_difference_and_exp_minus_one_at_one_scale():
    difference = np.array([[0.0, 0.0], [0.2, 0.0], [1e9, 0.0]])
    reward = closeness(difference, np.array([0.2, 3.0]))
    np.testing.assert_allclose(reward[:2], [1.0, np.exp(-1.0)])
    assert reward[2] > 0.0
