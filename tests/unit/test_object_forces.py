"""What an object lacks is found where it slides, and how far it is followed is told."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ObjectTrack, Trajectory
from gfm.core.checks import Array
from gfm.envs.fit_problem import make_fit_problem
from gfm.envs.following import moving_windows, object_errors, with_recordings
from gfm.envs.object_forces import object_forces
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings
from gfm.experiments.fit import force_model
from gfm.experiments.fit_warm import warm_start
from gfm.rl.regression import RegressionSettings
from gfm.sim.hybrid import ForceLimits, HybridModel

#: N, N and N m; the model knows none of them.
HIDDEN = np.array([0.06, -0.04, 1e-4])
MASS, PERIOD_S, LIMIT = 0.2, 0.02, 0.1
TABLE = """
<mujoco><option timestep="0.002" integrator="implicitfast" gravity="0 0 {gravity}"/><worldbody>
  <geom type="plane" size="5 5 0.1"/>
  <body pos="0 0 2"><joint name="a" axis="0 0 1" armature="0.5" damping="0.2"/>
    <inertial pos="0 0 0" mass="0.1" diaginertia="1e-4 1e-4 1e-4"/></body>
  <body name="object" pos="0 0 {height}"><freejoint/>
    <geom type="box" size="0.05 0.03 0.03" mass="{mass}"/></body></worldbody>
  <actuator><velocity name="a" joint="a" kv="10"/></actuator></mujoco>"""


def table(*, lies: bool) -> HybridModel:
    """Returns an object that lies on a table, or that weighs nothing and floats above it."""
    text = TABLE.format(mass=MASS, gravity=-9.81 if lies else 0.0, height=0.03 if lies else 0.1)
    return HybridModel(
        models={CommandKind.VELOCITY: mujoco.MjModel.from_xml_string(text)},
        control_period_s=PERIOD_S,
        limits=ForceLimits(object_n=LIMIT, object_nm=LIMIT),
    )


def recorded(model: HybridModel, force: Array, name: str = "one") -> Trajectory:
    """Returns 2 s of the object under a force in the plane, its pose as good as exact."""
    robot = model.any_model
    data = mujoco.MjData(robot)
    data.ctrl[0] = 0.1
    mujoco.mj_step(robot, data, nstep=500)  # it comes to rest
    data.qvel[:] = 0.0
    joints, poses = [], []
    for _ in range(200):
        joints.append(data.qpos[:1].copy())
        poses.append(data.qpos[1:].copy())
        data.qfrc_applied[[1, 2, 6]] = force
        mujoco.mj_step(robot, data, nstep=5)
    stamp_ns, pose = np.arange(200) * 10_000_000, np.array(poses)
    return Trajectory(
        name=name,
        joint_names=("a",),
        stamp_ns=stamp_ns,
        position=np.array(joints),
        velocity=None,
        effort=None,
        command_kind=CommandKind.VELOCITY,
        command_stamp_ns=stamp_ns[::2],
        command=np.full((100, 1), 0.1),
        object_track=ObjectTrack(stamp_ns=stamp_ns, position=pose[:, :3], quaternion=pose[:, 3:]),
    )


def test_the_force_that_moves_an_object_is_found() -> None:
    model = table(lies=False)
    (found,) = object_forces(model, [recorded(model, HIDDEN)])
    assert found.shape == (99, 6)
    np.testing.assert_allclose(found[:, [0, 1]], np.tile(HIDDEN[:2], (99, 1)), atol=4e-3)
    np.testing.assert_allclose(found[:, 5], HIDDEN[2], atol=2e-5)
    assert not found[:, 2:5].any()


def test_where_nothing_is_lacking_none_is_found() -> None:
    model = table(lies=False)
    (found,) = object_forces(model, [recorded(model, 0.0 * HIDDEN)])
    assert abs(found).max() < 1e-3


def test_an_object_that_friction_holds_needs_none() -> None:
    model = table(lies=True)
    (found,) = object_forces(model, [recorded(model, HIDDEN)])
    assert abs(found).max() < 2e-2  # the weight is 2 N


def test_an_object_is_followed_as_far_as_its_forces_are_known() -> None:
    model = table(lies=False)
    problem = make_fit_problem(model, [recorded(model, HIDDEN)], horizon=20, scale=[1.0] * 8)
    known = np.zeros((1, problem.action_size), np.float32)
    known[0, [1, 2, 6]] = HIDDEN / LIMIT
    without = object_errors(problem, None)
    under = object_errors(problem, lambda seen: np.repeat(known, len(seen), axis=0))
    time_s = PERIOD_S * np.arange(1, 21)
    way = 0.5 * np.linalg.norm(HIDDEN[:2]) / MASS * time_s**2
    assert without.place_m == pytest.approx(np.sqrt(np.mean(way**2)), rel=0.1)
    assert under.place_m < 0.1 * without.place_m
    assert under.yaw_rad < 0.1 * without.yaw_rad


def test_an_object_that_rests_says_nothing() -> None:
    model = table(lies=True)
    problem = make_fit_problem(model, [recorded(model, HIDDEN)], horizon=20, scale=[1.0] * 8)
    assert not len(moving_windows(problem))


def test_other_recordings_are_seen_by_the_same_scales() -> None:
    model = table(lies=False)
    one, other = recorded(model, HIDDEN), recorded(model, -HIDDEN, "other")
    problem = make_fit_problem(model, [one], horizon=20, scale=[1.0] * 8)
    same = with_recordings(problem, [one])
    np.testing.assert_array_equal(same.windows.state, problem.windows.state)
    assert with_recordings(problem, [other]).features is problem.features


def test_a_fit_learns_what_moves_an_object_and_gives_the_arm_nothing() -> None:
    """The force is the same everywhere: what is learned in two recordings holds in a third."""
    model = table(lies=False)
    runs = [recorded(model, HIDDEN, name) for name in ("one", "two")]
    assets = EnvironmentAssets(models=model.models, trajectories=runs)
    settings = EnvironmentSettings(control_period_s=PERIOD_S, horizon=20)
    how = RegressionSettings(hidden=(16,), batch_size=32, epochs=200)
    begun = warm_start(settings, assets, seed=0, regression=how)
    assert begun.lacking
    assert begun.object_errors is not None
    assert begun.settings.object_n == pytest.approx(1.2 * HIDDEN[0], rel=0.1)
    forces = force_model(begun.problem, begun.tensors)
    problem = with_recordings(begun.problem, [recorded(model, HIDDEN, "new")])
    assert object_errors(problem, forces.policy).place_m < 0.3 * begun.object_errors.place_m
    assert "forces on the object" in begun.about
