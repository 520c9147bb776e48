"""The object alone, pushed by a robot that moves as it was measured.

The robot is made so heavy that nothing the object does can disturb it, its drives are taken away,
and every step it gets the force that carries it along the measured motion: its part is no question
here, and its contacts still have the speed that they had.

Shape letters: S segments, K time steps, R joints of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from gfm.core.checks import Array
from gfm.effects import EffectInstance
from gfm.effects.objects import free_body
from gfm.sim.layout import SCALAR
from gfm.sim.plant import native_spec
from gfm.sim.processors import processors

#: Inertia of every joint of the robot, kg m^2: forces of a hand's push move it by nanometres.
IMMOVABLE = 1e5
#: MuJoCo measures its solver's progress by the inertia of all bodies: the robot's is made up.
SOLVER_TOLERANCE = 1e-15
#: Longest time step, s: contacts of small objects are stiff.
LONGEST_STEP_S = 0.002
#: So many groups of segments are simulated, each as long as its longest takes.
LENGTHS = 4
#: Of contype and conaffinity, by which robot and object see each other.
ROBOT_BIT = 1 << 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """A compiled model of the object and the robot that moves by itself.

    Attributes:
        model: Without drives.
        qpos: Of the robot's joints in qpos, shape (R,).
        dof: Of the same in qvel, shape (R,).
        object_qpos: The object's pose in qpos.
        object_dof: Its velocity in qvel.
    """

    model: mujoco.MjModel
    qpos: NDArray[np.intp]
    dof: NDArray[np.intp]
    object_qpos: slice
    object_dof: slice

    @property
    def timestep_s(self) -> float:
        """The integration step."""
        return float(self.model.opt.timestep)

    @property
    def inertia(self) -> tuple[float, float]:
        """The object's mass, kg, and largest moment of inertia, kg m^2."""
        body = int(self.model.dof_bodyid[self.object_dof.start])
        return float(self.model.body_mass[body]), float(np.max(self.model.body_inertia[body]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """How a segment begins, and how the robot moves in it.

    Attributes:
        pose: The object's, position m and quaternion w x y z, shape (7,).
        velocity: Its own, m/s in the world and rad/s in its frame, shape (6,).
        robot: The robot's joints one time step before the start, at the start, and at the end of
            every time step, rad, shape (K + 2, R).
    """

    pose: Array
    velocity: Array
    robot: Array


def make_stage(
    spec: mujoco.MjSpec, effects: Sequence[EffectInstance] = (), *, robot_touches: bool = True
) -> Stage:
    """Returns the stage of a model with effects of the object in it.

    Args:
        spec: With one free body.
        effects: Of the object.
        robot_touches: Whether the robot can push; without, it is air.
    """
    body = free_body(spec)
    if body is None:
        raise AssertionError("checked by who looks for objects")
    bare = spec.copy()
    _take_drives_away(bare)
    changed = native_spec(bare, effects)
    changed.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    changed.option.timestep = min(changed.option.timestep, LONGEST_STEP_S)
    changed.option.tolerance = SOLVER_TOLERANCE
    model = changed.compile()
    moving = [i for i in range(model.njnt) if model.jnt_type[i] in SCALAR]
    free = int(np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_FREE))[0])
    qpos, qvel = int(model.jnt_qposadr[free]), int(model.jnt_dofadr[free])
    stage = Stage(
        model=model,
        qpos=model.jnt_qposadr[moving].astype(np.intp),
        dof=model.jnt_dofadr[moving].astype(np.intp),
        object_qpos=slice(qpos, qpos + 7),
        object_dof=slice(qvel, qvel + 6),
    )
    _touch_the_object_only(stage, robot_touches)
    return stage


def _take_drives_away(spec: mujoco.MjSpec) -> None:
    """Leaves of the robot its shape; it is heavy, and gravity does not pull at it."""
    for kind in (spec.keys, spec.sensors):
        for one in list(kind):
            spec.delete(one)
    robot = [joint for joint in spec.joints if joint.type in SCALAR]
    names = {joint.name for joint in robot}
    for drive in [a for a in spec.actuators if a.target in names]:
        spec.delete(drive)
    for tendon in list(spec.tendons):
        spec.delete(tendon)
    for joint in robot:
        joint.armature, joint.frictionloss = IMMOVABLE, 0.0
        joint.stiffness, joint.damping = np.zeros(3), np.zeros(3)
        joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        for body in (joint.parent, *joint.parent.find_all(mujoco.mjtObj.mjOBJ_BODY)):
            body.gravcomp = 1.0


def _touch_the_object_only(stage: Stage, robot_touches: bool) -> None:
    """Lets the robot through everything but the object: what it did there has been measured."""
    model = stage.model
    own, touching = geoms(stage)
    model.geom_contype[_robot_geoms(stage)] = 0
    model.geom_conaffinity[_robot_geoms(stage)] = 0
    if robot_touches:
        model.geom_contype[own] |= ROBOT_BIT
        model.geom_conaffinity[touching] = ROBOT_BIT


def run(stage: Stage, settings: Sequence[Setting]) -> Array:
    """Returns the object's pose at the start and after every time step, shape (S, K + 1, 7).

    In shorter segments than the longest it stays where it was after their last step, or later.
    """
    steps = np.array([len(setting.robot) - 2 for setting in settings])
    poses = np.empty((len(settings), steps.max() + 1, 7))
    for alike in np.array_split(np.argsort(steps), min(LENGTHS, len(settings))):
        own = _run_alike(stage, [settings[i] for i in alike], int(steps[alike].max()))
        poses[alike, : own.shape[1]] = own
        poses[alike, own.shape[1] :] = own[:, -1:]
    return poses


def _run_alike(stage: Stage, settings: Sequence[Setting], steps: int) -> Array:
    """Returns the poses in segments of nearly one length, all of them simulated so far."""
    forces = np.stack([carrying_forces(stage, setting, steps) for setting in settings])
    data = [mujoco.MjData(stage.model) for _ in range(min(processors(), len(settings)))]
    states, _ = rollout.rollout(
        stage.model,
        data,
        np.stack([_initial(stage, setting) for setting in settings]),
        forces,
        control_spec=mujoco.mjtState.mjSTATE_QFRC_APPLIED.value,
        persistent_pool=True,
    )
    here = slice(1 + stage.object_qpos.start, 1 + stage.object_qpos.stop)
    first = np.stack([setting.pose for setting in settings])[:, None]
    return np.concatenate([first, states[:, :, here]], axis=1)


def carrying_forces(stage: Stage, setting: Setting, steps: int) -> Array:
    """Returns generalized forces that carry the robot along, shape (K, nv).

    MuJoCo takes v+ = v + h a and q+ = q + h v+: accelerations are second differences.
    """
    path = setting.robot
    forces = np.zeros((steps, stage.model.nv))
    acceleration = np.diff(path, n=2, axis=0) / stage.timestep_s**2
    forces[: len(acceleration), stage.dof] = IMMOVABLE * acceleration
    return forces


def _initial(stage: Stage, setting: Setting) -> Array:
    data = mujoco.MjData(stage.model)
    place(stage, data, setting)
    state = np.empty(mujoco.mj_stateSize(stage.model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(stage.model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def place(stage: Stage, data: mujoco.MjData, setting: Setting) -> None:
    """Writes how a segment begins."""
    data.qpos[stage.qpos] = setting.robot[1]
    data.qvel[stage.dof] = (setting.robot[1] - setting.robot[0]) / stage.timestep_s
    data.qpos[stage.object_qpos] = setting.pose
    data.qvel[stage.object_dof] = setting.velocity


def clearance(stage: Stage, robot: Array, pose: Array, within: float) -> float:
    """Returns the distance between robot and object, m; `within` where it is more.

    Args:
        stage: Where they are.
        robot: Its joints, rad, shape (R,).
        pose: The object's, shape (7,).
        within: Distances beyond do not matter, m.
    """
    model, data = stage.model, mujoco.MjData(stage.model)
    data.qpos[stage.qpos], data.qpos[stage.object_qpos] = robot, pose
    mujoco.mj_kinematics(model, data)
    own, others = geoms(stage)
    distances = [
        mujoco.mj_geomDistance(model, data, a, b, within, None) for a in own for b in others
    ]
    return min(distances, default=within)


def geoms(stage: Stage) -> tuple[list[int], list[int]]:
    """Returns the geoms of the object and those of the robot that can touch it."""
    model = stage.model
    tree = model.dof_treeid[stage.object_dof.start]
    of = model.body_treeid[model.geom_bodyid]
    own: list[int] = np.flatnonzero(of == tree).tolist()
    robot = _robot_geoms(stage)
    return own, [g for g in robot if any(_collide(model, g, o) for o in own)]


def _robot_geoms(stage: Stage) -> list[int]:
    model = stage.model
    trees = model.dof_treeid[stage.dof]
    found: list[int] = np.flatnonzero(np.isin(model.body_treeid[model.geom_bodyid], trees)).tolist()
    return found


def _collide(model: mujoco.MjModel, one: int, other: int) -> bool:
    return bool(
        model.geom_contype[one] & model.geom_conaffinity[other]
        or model.geom_contype[other] & model.geom_conaffinity[one]
    )
