"""An object beside a joint, pushed by a force that the model does not know, as a recording."""

from __future__ import annotations

import mujoco
import numpy as np

from gfm.core import CommandKind, ObjectTrack, Trajectory
from gfm.core.checks import Array
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
