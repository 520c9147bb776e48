"""Where a fit begins: forces where the model errs, as strong as needed, from the right causes."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, Trajectory
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings
from gfm.experiments.fit import COLD, WARM, environment_flags, force_model, training_error
from gfm.experiments.fit_warm import joint_errors, rollout_rmse, warm_start
from gfm.rl.learner_state import LearnerSettings
from gfm.rl.policy_numpy import GaussianPolicy
from gfm.rl.regression import RegressionSettings
from gfm.service import make_parser
from gfm.service.config import read_config
from gfm.service.environment_flags import add_environment_flags
from gfm.sim.hybrid import HybridModel
from gfm_learner.config import LearnerConfig

ARM = """
<mujoco><option timestep="0.002" integrator="RK4" gravity="0 0 0"/><worldbody>
  <body><joint name="a" axis="0 0 1" armature="0.5" damping="0.2"/>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body>
  <body><joint name="b" axis="0 0 1" armature="0.5" damping="{damping}"/>
    <inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body></worldbody>
  <actuator><position name="a" joint="a" kp="40" kv="4"/>
    <position name="b" joint="b" kp="40" kv="4"/></actuator>
</mujoco>"""
NOMINAL = mujoco.MjModel.from_xml_string(ARM.format(damping=0.2))
NOISE_RAD = 1e-4


def recording(seed: int, damping: float) -> Trajectory:
    """Returns 5 s of a robot whose second joint has another damping than the model's 0.2."""
    robot = mujoco.MjModel.from_xml_string(ARM.format(damping=damping))
    data = mujoco.MjData(robot)
    rng = np.random.default_rng(seed)
    time_s = 0.02 * np.arange(250)[:, None]
    waves = 2 * np.pi * rng.uniform(0.2, 0.9, (3, 2)) * time_s[:, None] + rng.uniform(0, 6, (3, 2))
    command = 0.2 * np.sin(waves).sum(axis=1)
    command *= np.minimum(1.0, np.maximum(0.0, time_s - 0.3))  # from rest
    position = []
    for setpoint in command:
        data.ctrl[:] = setpoint
        for _ in range(2):
            position.append(data.qpos.copy())
            mujoco.mj_step(robot, data, nstep=5)
    measured = np.array(position)
    stamp_ns = np.arange(len(measured)) * 10_000_000
    return Trajectory(
        name=f"motion_{seed}",
        joint_names=("a", "b"),
        stamp_ns=stamp_ns,
        position=measured + NOISE_RAD * rng.normal(size=measured.shape),
        velocity=None,
        effort=None,
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns[::2],
        command=command,
    )


def assets(damping: float) -> EnvironmentAssets:
    recordings = [recording(seed, damping) for seed in range(3)]
    return EnvironmentAssets(models={CommandKind.POSITION: NOMINAL}, trajectories=recordings)


SETTINGS = EnvironmentSettings(control_period_s=0.02, horizon=20)
QUICK = RegressionSettings(hidden=(32, 32), batch_size=32, epochs=20)
HASTY = RegressionSettings(hidden=(8,), epochs=2)


@pytest.fixture(scope="module")
def damped():
    return warm_start(SETTINGS, assets(3.2), seed=0, regression=QUICK)


def test_joints_err_where_the_model_does():
    model = HybridModel(models={CommandKind.POSITION: NOMINAL}, control_period_s=0.02)
    errors = joint_errors(model, assets(3.2).trajectories)
    assert errors[0] == pytest.approx(NOISE_RAD, rel=0.3)
    assert errors[1] > 100 * NOISE_RAD


def test_only_the_joint_that_errs_gets_a_force_and_it_predicts_the_robot(damped):
    assert damped.settings.forced_joints == ("b",)
    assert damped.problem.action_size == 1
    new = [recording(7, 3.2)]
    without = joint_errors(damped.problem.model, new)
    forces = force_model(damped.problem, damped.tensors)
    assert training_error(forces, new) < 0.1 * float(np.sqrt(np.square(without).mean()))


def test_the_force_begins_with_its_own_joint_alone(damped):
    assert "beginning with its joint's states and drive" in damped.about
    seen = (damped.tensors["first.weight"] != 0.0).any(axis=0)
    np.testing.assert_array_equal(seen, damped.problem.features.of_joint(1))


def test_a_single_recording_leaves_none_to_choose_by():
    alone = EnvironmentAssets(
        models={CommandKind.POSITION: NOMINAL}, trajectories=[recording(0, 3.2)]
    )
    begun = warm_start(SETTINGS, alone, seed=0, regression=HASTY)
    assert "smoothed" not in begun.about
    assert "of the missing force 100% remains" in begun.about


def test_policies_are_compared_by_what_they_leave_of_each_recording(damped):
    recordings = assets(3.2).trajectories
    policy = GaussianPolicy.from_weights(damped.tensors)
    each = rollout_rmse(damped.problem, policy, recordings)
    together = training_error(force_model(damped.problem, damped.tensors), recordings)
    assert np.sqrt(np.mean(each**2)) == pytest.approx(together)


def test_limits_grow_with_what_the_recordings_ask_for():
    """30 N m s/rad against a stiffness of 40 N m/rad: more than 5 N m, the least limit."""
    strong = warm_start(SETTINGS, assets(30.0), seed=0, regression=HASTY)
    assert 6.0 <= strong.settings.joint_nm <= 30.0
    assert (strong.problem.model.force_limit == strong.settings.joint_nm).all()


def test_without_a_gap_nothing_is_lacking(damped):
    begun = warm_start(SETTINGS, assets(0.2), seed=0, regression=HASTY)
    assert damped.lacking
    assert not begun.lacking
    assert len(begun.settings.forced_joints) == 1


def test_actors_and_learner_are_told_the_same_problem(damped):
    parser = make_parser("test", "Reads flags.")
    add_environment_flags(parser)
    given = vars(parser.parse_args(environment_flags(damped.settings)))
    assert given["environment.forced_joints"] == ["b"]
    assert given["environment.control_period_s"] == 0.02
    assert given["environment.joint_nm"] == damped.settings.joint_nm
    assert given["environment.horizon"] == 20
    np.testing.assert_array_equal(given["environment.scale"], damped.problem.scale)


def test_joints_without_forces_do_not_count(damped):
    np.testing.assert_array_equal(np.isfinite(damped.problem.scale), [False, True, False, True])
    assert (damped.problem.scale > 0.0).all()


def test_the_learner_understands_its_settings(tmp_path):
    warm, cold = (learning_settings(tmp_path, one.settings) for one in (WARM, COLD))
    assert warm.critic_first_steps == WARM.critic_first_steps
    assert cold.critic_first_steps == COLD.critic_first_steps < warm.critic_first_steps
    assert warm.policy_learning_rate < cold.policy_learning_rate < 1e-3


def learning_settings(tmp_path, text: str) -> LearnerSettings:
    path = tmp_path / "learner.toml"
    path.write_text(text, encoding="utf-8")
    return read_config(LearnerConfig, path, {}).learning


def test_without_epochs_nothing_is_known_of_the_forces(damped):
    """Where the paper begins: all inputs, any policy, and a scale that the nominal error sets."""
    cold = warm_start(SETTINGS, assets(3.2), seed=0, regression=RegressionSettings(epochs=0))
    assert cold.settings.forced_joints == damped.settings.forced_joints
    assert (cold.tensors["first.weight"] != 0.0).all()
    assert "everything observed; of the missing force 100% remains" in cold.about
    assert (cold.problem.scale[1::2] > 3.0 * damped.problem.scale[1::2]).all()
