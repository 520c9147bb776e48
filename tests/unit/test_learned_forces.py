"""Fitted force models in files, and ensembles of them in episodes."""

from dataclasses import replace

import numpy as np
import pytest

from gfm.core import BadInputError, CommandKind, ConfigError, EnvironmentSpec, Trajectory, Weights
from gfm.envs.arm import Arm, ArmProblem
from gfm.envs.control_settings import ControlSettings
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings, arm_problem
from gfm.rl.learner_state import LearnerSettings, init_learner, policy_tensors
from gfm.service.assets import load_assets
from gfm.service.force_files import read_forces, write_forces
from gfm.sim.batch import HybridBatch
from gfm.sim.features import make_features
from gfm.sim.hybrid import HybridModel
from gfm.sim.learned import ForceEnsemble
from gfm.sim.replay import make_replay
from gfm.sim.rollout import rollouts
from gfm.sim.sawyer import JOINT_NAMES, READY, sawyer_spec

PERIOD_S = 0.05


@pytest.fixture(scope="module")
def arm_model():
    model = sawyer_spec(command=CommandKind.VELOCITY).compile()
    return HybridModel(models={CommandKind.VELOCITY: model}, forced_joints=JOINT_NAMES[2:5])


@pytest.fixture(scope="module")
def recording():
    """Two seconds of commands that change every period, and about the motion they give."""
    stamps = np.arange(201) * 10_000_000
    commands = 0.2 * np.sin(0.3 * np.arange(40)[:, None] + np.arange(7))
    ways = np.cumsum(np.repeat(commands, 5, axis=0) * 0.01, axis=0)
    return Trajectory(
        name="waves",
        joint_names=JOINT_NAMES,
        stamp_ns=stamps,
        position=READY + np.concatenate([np.zeros((1, 7)), ways]),
        velocity=None,
        effort=None,
        command_kind=CommandKind.VELOCITY,
        command_stamp_ns=stamps[:200:5],
        command=commands,
        object_track=None,
    )


def weights_of(size, actions, seed=0, bias=None):
    spec = EnvironmentSpec(name="gfm_fit", observation_size=size, action_size=actions)
    tensors = dict(policy_tensors(init_learner(spec, LearnerSettings(), seed)))
    tensors["mean.weight"] = tensors["mean.weight"] * 100.0
    if bias is not None:
        tensors["mean.weight"] = np.zeros_like(tensors["mean.weight"])
        tensors["mean.bias"] = np.full(actions, bias, np.float32)
    return Weights(version=3, created_ns=0, spec_digest="", tensors=tensors)


@pytest.fixture(scope="module")
def write(arm_model, recording, tmp_path_factory):
    features = make_features(arm_model.layout, [make_replay(arm_model, recording)], 5)
    folder = tmp_path_factory.mktemp("forces")

    def write(name, **how):
        path = folder / f"{name}.npz"
        write_forces(path, arm_model, features, weights_of(features.size, 3, **how))
        return path

    return write


class Asked:
    """A policy that counts how often it is asked."""

    def __init__(self, policy, asked):
        self._policy, self._asked = policy, asked
        self.observation_size, self.action_size = policy.observation_size, policy.action_size

    def mean_action(self, observation):
        self._asked.append(observation)
        return self._policy.mean_action(observation)


def test_forces_act_in_episodes_as_they_do_in_open_loop_predictions(arm_model, recording, write):
    forces = read_forces(write("random"))
    predicted = rollouts(
        arm_model, [recording], policy=forces.policy.mean_action, features=forces.features
    )[0]
    assert np.abs(predicted.force).max() > 0.5

    replay = make_replay(arm_model, recording)
    batch = HybridBatch(arm_model, 1)
    ensemble = ForceEnsemble([forces], arm_model, 1)
    ids, models = np.array([0]), [replay.model]
    qpos, qvel = replay.qpos[:1], replay.qvel[:1]
    batch.reset(ids, models, qpos, qvel, replay.command[0, :1])
    ensemble.reset(ids, models, qpos, qvel, np.random.default_rng(0))
    for period, force in enumerate(predicted.force):
        command = replay.command[period][None]
        got = ensemble.forces(batch.qpos, batch.qvel, command[:, 0])
        np.testing.assert_allclose(got[0], force, rtol=1e-4, atol=1e-5)
        batch.step(command, got)


def test_a_file_holds_all_that_is_needed(write):
    path = write("constant", bias=0.5)
    forces = read_forces(path)
    assert forces.forced_joints == JOINT_NAMES[2:5]
    assert forces.joint_names == JOINT_NAMES
    assert not forces.on_object
    assert forces.control_period_s == PERIOD_S
    assert forces.force_limit.tolist() == [5.0, 5.0, 5.0]
    assert forces.features.history == 5
    rows = np.zeros((2, forces.features.size), np.float32)
    np.testing.assert_array_equal(forces.policy.mean_action(rows), np.full((2, 3), 0.5))


def test_each_episode_of_a_control_task_draws_one_member(write):
    settings = EnvironmentSettings(
        control=ControlSettings(
            ensemble=(str(write("up", bias=0.8)), str(write("down", bias=-0.8)))
        )
    )
    assets = load_assets(settings)
    problem = arm_problem("position_matching", settings, assets)
    arm = Arm(problem, 32, np.random.default_rng(0), 1)
    rest = problem.model.layout.as_qpos(np.tile(READY, (32, 1)))
    arm.reset(np.arange(32), rest)
    forces = arm._learned_forces(np.zeros((32, 7)))
    assert forces.shape == (32, 13)
    up = forces[:, 2] > 0.0
    assert 0 < up.sum() < 32
    np.testing.assert_allclose(forces[:, 2:5], np.where(up, 4.0, -4.0)[:, None] * np.ones(3))
    assert (forces[:, [0, 1, *range(5, 13)]] == 0.0).all()
    for _ in range(3):
        arm.step(np.zeros((32, 7), np.float32))
    moved = arm.qpos[:, 2] - READY[2]
    assert (np.sign(moved) == np.where(up, 1, -1)).all()


def test_members_are_drawn_again_for_new_episodes(write):
    settings = EnvironmentSettings(
        control=ControlSettings(
            ensemble=(str(write("up", bias=0.8)), str(write("down", bias=-0.8)))
        )
    )
    problem = arm_problem("joint_tracking", settings, load_assets(settings))
    arm = Arm(problem, 1, np.random.default_rng(0), 1)
    signs = set()
    for _ in range(20):
        arm.reset(np.array([0]), READY[None])
        signs.add(float(np.sign(arm._learned_forces(np.zeros((1, 7)))[0, 2])))
    assert signs == {1.0, -1.0}


def test_forces_that_do_not_go_with_the_model_are_refused(arm_model, write):
    forces = read_forces(write("constant", bias=0.5))
    settings = EnvironmentSettings(forced_joints=JOINT_NAMES[:3])
    problem = arm_problem("joint_tracking", settings, EnvironmentAssets(ensemble=(forces,)))
    with pytest.raises(ConfigError, match=r"acts on right_j3, right_j4; forces are allowed on"):
        Arm(problem, 1, np.random.default_rng(0), 1)
    slow = HybridModel(models=arm_model.models, control_period_s=0.03)
    with pytest.raises(ConfigError, match=r"every 0\.03 s, expected a whole .* within 0\.05 s"):
        ArmProblem(model=slow)


def test_forces_are_decided_as_often_as_they_were_fitted(write):
    slow = read_forces(write("constant", bias=0.5))
    fast = replace(slow, control_period_s=0.02)
    assets = EnvironmentAssets(ensemble=(slow, fast))
    problem = arm_problem("joint_tracking", EnvironmentSettings(), assets)
    assert problem.model.control_period_s == pytest.approx(0.01)
    assert problem.repeats == 5
    for forces, every in ((slow, 5), (fast, 2)):
        asked = []
        policy = Asked(forces.policy, asked)
        ensemble = ForceEnsemble([replace(forces, policy=policy)], problem.model, 1)
        batch = HybridBatch(problem.model, 1)
        ids, models, rest = np.array([0]), [problem.nominal], np.zeros((1, 7))
        ensemble.reset(ids, models, READY[None], rest, np.random.default_rng(0))
        for call in range(10):
            got = ensemble.forces(batch.qpos, batch.qvel, rest)
            assert got[0, 2] == 2.5
            assert len(asked) == 1 + call // every


def test_a_file_that_is_something_else_is_refused(tmp_path, write):
    path = tmp_path / "forces.npz"
    path.write_bytes(write("constant", bias=0.5).read_bytes()[:2000])
    with pytest.raises(BadInputError, match=r"damaged or no gfm\.forces/1 file"):
        read_forces(path)
    with pytest.raises(BadInputError, match=r"no such file, expected gfm\.forces/1"):
        read_forces(tmp_path / "absent.npz")
