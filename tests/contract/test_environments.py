"""What every environment promises."""

import gymnasium
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from gfm.core import (
    BadInputError,
    CommandKind,
    ConfigError,
    ObjectTrack,
    ShapeError,
    Trajectory,
    UnknownNameError,
)
from gfm.envs.registry import (
    ENVIRONMENT_NAMES,
    EnvironmentAssets,
    EnvironmentSettings,
    make_environment,
)

N, HORIZON = 3, 8
SETTINGS = EnvironmentSettings(horizon=HORIZON)

PUSHER = """
<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody>
  <geom type="plane" size="1 1 0.1"/>
  <body pos="0 0 0.5"><joint name="a" axis="0 0 1" armature="0.2"/><geom size="0.05"/></body>
  <body pos="0 0 1"><joint name="b" axis="0 1 0" armature="0.2"/><geom size="0.05"/></body>
  {free}
</worldbody><actuator>
  <position name="a" joint="a" kp="20" kv="3"/><position name="b" joint="b" kp="20" kv="3"/>
</actuator></mujoco>"""
FREE = """<body name="object" pos="0.3 0 0.03"><freejoint/>
  <geom type="box" size="0.03 0.03 0.03"/></body>"""


def _recording(model, *, tracked):
    """Three seconds of the model itself with a torque that it will not know."""
    data = mujoco.MjData(model)
    times, positions, poses, commands = [], [], [], []
    for step in range(600):
        if step % 10 == 0:
            data.ctrl[:] = 0.3 * np.sin(data.time * np.array([2.0, 3.0]))
            commands.append(data.ctrl.copy())
        data.qfrc_applied[0] = np.sin(4.0 * data.time)
        times.append(round(data.time * 1e9))
        positions.append(data.qpos[:2].copy())
        poses.append(data.qpos[2:].copy())
        mujoco.mj_step(model, data)
    pose = np.array(poses)
    stamps = np.array(times)
    return Trajectory(
        name="pusher",
        joint_names=("a", "b"),
        stamp_ns=stamps,
        position=np.array(positions),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamps[::10],
        command=np.array(commands),
        object_track=_track(stamps, pose) if tracked else None,
    )


def _track(stamps, pose):
    return ObjectTrack(stamp_ns=stamps, position=pose[:, :3], quaternion=pose[:, 3:])


def _fit_assets(*, free):
    model = mujoco.MjModel.from_xml_string(PUSHER.format(free=FREE if free else ""))
    return EnvironmentAssets(
        models={CommandKind.POSITION: model}, trajectories=[_recording(model, tracked=free)]
    )


ASSETS = {
    "point_mass": ("point_mass", EnvironmentAssets()),
    "joint_tracking": ("joint_tracking", EnvironmentAssets()),
    "position_matching": ("position_matching", EnvironmentAssets()),
    "pose_matching": ("pose_matching", EnvironmentAssets()),
    "gfm_fit": ("gfm_fit", _fit_assets(free=False)),
    "gfm_fit with an object": ("gfm_fit", _fit_assets(free=True)),
    "gymnasium": ("gymnasium:Pendulum-v1", EnvironmentAssets()),
}


@pytest.fixture(params=ASSETS)
def make(request):
    name, assets = ASSETS[request.param]
    return lambda seed=0: make_environment(name, SETTINGS, num_envs=N, seed=seed, assets=assets)


def _actions(env, steps, seed=0):
    shape = (steps, N, env.spec.action_size)
    return np.random.default_rng(seed).uniform(-1.5, 1.5, size=shape).astype(np.float32)


def test_every_registered_environment_is_under_contract():
    own = {name for name, _ in ASSETS.values() if not name.startswith("gymnasium:")}
    assert own == set(ENVIRONMENT_NAMES)


def test_shapes_and_types_are_those_of_the_spec(make):
    env = make()
    observation = env.reset()
    transition = env.step(_actions(env, 1)[0])
    for array in (observation, transition.observation):
        assert array.shape == (N, env.spec.observation_size)
        assert array.dtype == np.float32
    assert transition.reward.shape == transition.discount.shape == transition.ended.shape == (N,)
    assert transition.reward.dtype == transition.discount.dtype == np.float32
    assert transition.ended.dtype == bool


def test_rewards_and_observations_are_finite(make):
    env = make()
    env.reset()
    for action in _actions(env, HORIZON):
        transition = env.step(action)
        assert np.isfinite(transition.observation).all()
        assert np.isfinite(transition.reward).all()


@pytest.mark.parametrize("case", ["joint_tracking", "gfm_fit", "gfm_fit with an object"])
def test_rewards_for_how_near_one_is_are_in_the_unit_interval(case):
    name, assets = ASSETS[case]
    env = make_environment(name, SETTINGS, num_envs=N, seed=0, assets=assets)
    env.reset()
    for action in _actions(env, HORIZON):
        reward = env.step(action).reward
        assert ((reward > 0.0) & (reward <= 1.0)).all()


def test_an_environment_of_gymnasium_is_that_environment():
    ours = make_environment("gymnasium:Pendulum-v1", SETTINGS, num_envs=1, seed=4)
    theirs = gymnasium.make("Pendulum-v1")
    np.testing.assert_array_equal(ours.reset()[0], theirs.reset(seed=4)[0])
    for action in np.linspace(-1.0, 1.0, HORIZON, dtype=np.float32)[:, None]:
        observation, reward, *_ = theirs.step(2.0 * action)  # its torques go to 2 N m
        step = ours.step(action[None])
        np.testing.assert_allclose(step.observation[0], observation, rtol=1e-6)
        np.testing.assert_allclose(step.reward[0], reward, rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("gymnasium:Maze-v9", "Maze-v9: Gymnasium does not know it"),
        ("gymnasium:CartPole-v1", "takes Discrete.*, expected vectors of numbers"),
        ("gymnasium:Endless-v0", "Endless-v0 has no limit of steps"),
    ],
)
def test_an_environment_of_gymnasium_that_cannot_be_used_is_refused(name, message, monkeypatch):
    monkeypatch.setattr(gymnasium.envs.registration, "registry", {**gymnasium.registry})
    gymnasium.register("Endless-v0", "gymnasium.envs.classic_control:PendulumEnv")
    with pytest.raises(ConfigError, match=message):
        make_environment(name, EnvironmentSettings(), num_envs=1, seed=0)


def test_equal_seeds_give_equal_episodes_and_other_seeds_others(make):
    first, second, other = make(5), make(5), make(6)
    starts = [env.reset() for env in (first, second, other)]
    np.testing.assert_array_equal(starts[0], starts[1])
    assert (starts[0] != starts[2]).any()
    for action in _actions(first, HORIZON):
        one, two = first.step(action), second.step(action)
        np.testing.assert_array_equal(one.observation, two.observation)
        np.testing.assert_array_equal(one.reward, two.reward)


def test_the_time_limit_ends_an_episode_without_terminating_it(make):
    env = make()
    env.reset()
    transitions = [env.step(action) for action in _actions(env, HORIZON)]
    assert [t.ended.all() for t in transitions] == [False] * (HORIZON - 1) + [True]
    assert all((t.discount == 1.0).all() for t in transitions)


def test_an_ended_instance_must_be_reset_before_the_next_step(make):
    env = make()
    with pytest.raises(RuntimeError, match=r"instances \[0, 1, 2\] have ended"):
        env.step(_actions(env, 1)[0])
    env.reset()
    for action in _actions(env, HORIZON):
        env.step(action)
    env.reset(np.array([0, 2]))
    with pytest.raises(RuntimeError, match=r"instances \[1\] have ended"):
        env.step(_actions(env, 1)[0])


def test_resetting_one_instance_leaves_the_others_alone(make):
    env = make()
    env.reset()
    for action in _actions(env, 3):
        before = env.step(action).observation
    after = env.reset(np.array([1]))
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    assert (after[1] != before[1]).any()


def test_actions_are_clipped(make):
    wild, tame = make(), make()
    wild.reset()
    tame.reset()
    action = 100.0 * _actions(wild, 1)[0]
    one, two = wild.step(action), tame.step(np.clip(action, -1.0, 1.0))
    np.testing.assert_array_equal(one.observation, two.observation)


def test_returned_observations_are_not_written_to_later(make):
    env = make()
    first = env.reset()
    kept = first.copy()
    second = env.step(_actions(env, 1)[0]).observation
    kept_second = second.copy()
    env.step(_actions(env, 1)[0])
    np.testing.assert_array_equal(first, kept)
    np.testing.assert_array_equal(second, kept_second)


def test_actions_of_the_wrong_shape_or_not_finite_are_refused(make):
    env = make()
    env.reset()
    with pytest.raises(ShapeError, match=r"action has shape \(1, 9\), expected \(3, "):
        env.step(np.zeros((1, 9), np.float32))
    action = _actions(env, 1)[0]
    action[1, 0] = np.nan
    with pytest.raises(BadInputError, match=r"actions of instances \[1\] are not finite"):
        env.step(action)


def test_an_unknown_environment_is_refused_with_the_known_ones():
    with pytest.raises(
        UnknownNameError, match="'maze'; available: gfm_fit, gymnasium:NAME, joint_tracking"
    ):
        make_environment("maze", SETTINGS, num_envs=1, seed=0)


def test_gfm_fit_without_recordings_is_refused():
    with pytest.raises(ConfigError, match="at least one recording, got none"):
        make_environment("gfm_fit", SETTINGS, num_envs=1, seed=0)


@pytest.mark.parametrize("name", ["horizon", "nthread"])
def test_settings_out_of_range_are_refused(name):
    with pytest.raises(ConfigError, match=f"{name} is 0, expected at least 1"):
        EnvironmentSettings(**{name: 0})


@pytest.mark.parametrize(
    ("env_id", "kwargs"),
    [
        ("PointMass-v0", {}),
        ("JointTracking-v0", {"settings": SETTINGS}),
        ("PositionMatching-v0", {"settings": SETTINGS}),
        ("PoseMatching-v0", {"settings": SETTINGS}),
        ("GfmFit-v0", {"settings": SETTINGS, "assets": ASSETS["gfm_fit"][1]}),
        ("GfmFit-v0", {"settings": SETTINGS, "assets": ASSETS["gfm_fit with an object"][1]}),
    ],
)
def test_gymnasiums_checker_passes(env_id, kwargs):
    env = gymnasium.make(f"gfm.envs.gymnasium_env:gfm/{env_id}", **kwargs)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=1)
    steps = [env.step(env.action_space.sample()) for _ in range(HORIZON if kwargs else 20)]
    assert [step[3] for step in steps] == [False] * (len(steps) - 1) + [True]
    assert not any(step[2] for step in steps)
