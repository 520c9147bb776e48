"""What an object lacks is found where it slides, and how far it is followed is told."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from gfm.core import CommandKind, ObjectTrack, Trajectory
from gfm.core.checks import Array
from gfm.envs.object_forces import object_forces
from gfm.envs.pushes import forces_of, make_pushes, object_errors
from gfm.envs.registry import EnvironmentAssets, EnvironmentSettings
from gfm.experiments.fit import force_model
from gfm.experiments.fit_warm import warm_start
from gfm.rl.regression import RegressionSettings
from gfm.sim.batch import HybridBatch
from gfm.sim.hybrid import ForceLimits, HybridModel

#: N, N and N m; the model knows none of them.
HIDDEN = np.array([0.06, -0.04, 1e-4])
MASS, PERIOD_S, LIMIT = 0.2, 0.02, 0.1
#: Hundredths of a second in which something holds the object.
HELD = 14
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


def recorded(model: HybridModel, force: Array, name: str = "one", held: int = 0) -> Trajectory:
    """Returns 2 s of the object under a force in the plane, its pose as good as exact.

    For so many hundredths of a second something holds it.
    """
    robot = model.any_model
    data = mujoco.MjData(robot)
    data.ctrl[0] = 0.1
    mujoco.mj_step(robot, data, nstep=500)  # it comes to rest
    data.qvel[:] = 0.0
    joints, poses = [], []
    for i in range(200):
        joints.append(data.qpos[:1].copy())
        poses.append(data.qpos[1:].copy())
        data.qfrc_applied[[1, 2, 6]] = force
        mujoco.mj_step(robot, data, nstep=5)
        if i < held:
            data.qpos[1:], data.qvel[1:] = poses[0], 0.0
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
    pushes = make_pushes(model, [recorded(model, HIDDEN, held=HELD)])
    known = np.zeros((1, 6))
    known[0, [0, 1, 5]] = HIDDEN
    without = object_errors(model, pushes)
    under = object_errors(model, pushes, lambda *_: known)
    time_s = PERIOD_S * np.arange(1, 92)
    way = 0.5 * np.linalg.norm(HIDDEN[:2]) / MASS * time_s**2
    assert without.place_m == pytest.approx(np.sqrt(np.mean(way**2)), rel=0.1)
    assert under.place_m < 0.1 * without.place_m
    assert under.yaw_rad < 0.1 * without.yaw_rad


def test_an_object_that_rests_says_nothing() -> None:
    model = table(lies=True)
    assert not make_pushes(model, [recorded(model, HIDDEN)])


def test_what_moves_from_the_first_moment_on_is_no_push_from_rest() -> None:
    model = table(lies=False)
    assert not make_pushes(model, [recorded(model, 10.0 * HIDDEN)])


def test_pushes_of_some_recordings_are_those_alone() -> None:
    model = table(lies=False)
    runs = [recorded(model, force, held=HELD) for force in (HIDDEN, 0.0 * HIDDEN, -HIDDEN)]
    pushes = make_pushes(model, runs)
    assert pushes.recording.tolist() == [0, 2]
    assert len(pushes.of([2])) == 1
    np.testing.assert_array_equal(pushes.of([2]).qpos[0], pushes.qpos[1])


def test_a_robot_moves_as_it_was_measured_whatever_its_drive_does() -> None:
    model = table(lies=False)
    pushes = make_pushes(model, [recorded(model, HIDDEN, held=HELD)])
    told = replace(pushes, command=100.0 * pushes.command)
    assert object_errors(model, told) == object_errors(model, pushes)
    batch = HybridBatch(model, 1)
    batch.carry(np.zeros((1, 7)), pushes.joints[:, 5], pushes.speeds[:, 5])
    assert batch.qpos[0, 0] == pushes.joints[0, 5, -1, 0]


def test_a_fit_learns_what_moves_an_object_and_gives_the_arm_nothing() -> None:
    """The force is the same everywhere: what is learned in two recordings holds in a third.

    While the object is held, forces seem to be none: where it rests half of the force is learned.
    """
    model = table(lies=False)
    runs = [recorded(model, HIDDEN, name, held=HELD) for name in ("one", "two")]
    assets = EnvironmentAssets(models=model.models, trajectories=runs)
    settings = EnvironmentSettings(control_period_s=PERIOD_S, horizon=20)
    how = RegressionSettings(hidden=(16,), batch_size=32, epochs=200)
    begun = warm_start(settings, assets, seed=0, regression=how)
    assert begun.lacking
    assert begun.object_errors is not None
    assert begun.settings.object_n == pytest.approx(1.2 * HIDDEN[0], rel=0.1)
    forces = force_model(begun.problem, begun.tensors)
    pushes = make_pushes(forces.model, [recorded(model, HIDDEN, "new", held=HELD)])
    known = forces_of(forces.policy, forces.features, forces.model, pushes)
    there = object_errors(forces.model, pushes, known)
    assert there.place_m < 0.75 * begun.object_errors.place_m
    assert "forces on the object" in begun.about


def test_where_nothing_is_lacking_an_object_gets_no_forces() -> None:
    model = table(lies=True)
    assets = EnvironmentAssets(models=model.models, trajectories=[recorded(model, HIDDEN)])
    begun = warm_start(EnvironmentSettings(control_period_s=PERIOD_S, horizon=20), assets, seed=0)
    assert not begun.lacking
