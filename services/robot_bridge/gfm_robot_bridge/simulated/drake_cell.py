"""The cell in Drake: a plant with the numbers of a compiled one, and contacts of its own.

Bodies, joints, inertias and shapes are read off the compiled cell, one by one; nothing that moves
is computed by MuJoCo. Drake advances the plant in discrete steps and solves for contact in each of
them, friction included (its lagged approximation). Object and tool are compliant, basket and ground
rigid: they press on each other over areas (hydroelastic contact). Links touch in points.

Shape letters: J joints.
"""

from __future__ import annotations

from typing import final

import mujoco
import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.geometry import (
    AddCompliantHydroelasticProperties,
    AddContactMaterial,
    AddRigidHydroelasticProperties,
    Box,
    Capsule,
    CollisionFilterDeclaration,
    Cylinder,
    ProximityProperties,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    FixedOffsetFrame,
    RevoluteJoint,
    RigidBody,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from gfm.core import ConfigError
from gfm.core.checks import Array
from gfm.sim.cell import OBJECT_BODY
from gfm_robot_bridge.simulated.cell import TOOL_BODIES

#: Of Drake's steps. Objects sink by less than a micrometre into what they lie on with this modulus
#: (Pa), and what strikes bounces little with this dissipation (s/m).
STEP_S = 5e-4
_MODULUS, _DISSIPATION = 1e7, 1.0
#: Size of the elements that a round shape is made of, m; boxes need no such number.
_ELEMENT_M = 5e-3
#: How thick the ground is, which is a half space in MuJoCo, m.
_GROUND_M = 1.0


@final
class DrakeCell:
    """A cell that stands still, the arm at zero, until it is told otherwise.

    Args:
        model: The compiled cell: its first J joints are hinges, a free body may follow. Where its
            contacts are disabled nothing touches anything.

    Raises:
        ConfigError: Drake has no friction like the object's.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        builder = DiagramBuilder()
        self._plant, scene = AddMultibodyPlantSceneGraph(builder, STEP_S)
        self._arm = self._plant.AddModelInstance("arm")
        self._thing = self._plant.AddModelInstance(OBJECT_BODY)
        self._fill(scene, model)
        self._simulator = Simulator(builder.Build())
        self._context = self._plant.GetMyMutableContextFromRoot(
            self._simulator.get_mutable_context()
        )
        self._forces = self._plant.get_applied_generalized_force_input_port()
        self._steps = 0
        self.has_object = self._plant.num_positions(self._thing) > 0

    def _fill(self, scene: SceneGraph, model: mujoco.MjModel) -> None:
        plant = self._plant
        plant.set_contact_model(ContactModel.kHydroelasticWithFallback)
        plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
        plant.mutable_gravity_field().set_gravity_vector(model.opt.gravity)
        bodies = [plant.world_body()]
        for number in range(1, model.nbody):
            name = model.body(number).name
            instance = self._thing if name == OBJECT_BODY else self._arm
            bodies.append(plant.AddRigidBody(name, instance, _inertia(model, number)))
            _join(plant, model, bodies, number)
        if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONTACT:
            for number in range(model.ngeom):
                _add_shape(plant, model, bodies, number)
            _let_neighbours_overlap(plant, scene, model, bodies)
        plant.Finalize()

    @property
    def position(self) -> Array:
        """Of the joints, rad, shape (J,)."""
        return np.asarray(self._plant.GetPositions(self._context, self._arm))

    @position.setter
    def position(self, position: Array) -> None:
        self._plant.SetPositions(self._context, self._arm, position)

    @property
    def velocity(self) -> Array:
        """Of the joints, rad/s, shape (J,)."""
        return np.asarray(self._plant.GetVelocities(self._context, self._arm))

    @property
    def object_pose(self) -> Array:
        """Of the object, m and quaternion w x y z, shape (7,)."""
        quaternion_first = self._plant.GetPositions(self._context, self._thing)
        quaternion, place = quaternion_first[:4], quaternion_first[4:]
        return np.concatenate((place, quaternion / np.linalg.norm(quaternion)))

    def put_object(self, pose: Array) -> None:
        """Puts the object somewhere, at rest: m and quaternion w x y z, shape (7,)."""
        self._plant.SetPositions(self._context, self._thing, np.roll(pose, 4))
        self._plant.SetVelocities(self._context, self._thing, np.zeros(6))

    def weight(self) -> Array:
        """Returns what gravity does to the joints, N m, shape (J,)."""
        forces = self._plant.CalcGravityGeneralizedForces(self._context)
        return np.asarray(self._plant.GetVelocitiesFromArray(self._arm, forces))

    def step(self, torque: Array) -> None:
        """Advances by STEP_S under a torque on the joints, N m, shape (J,)."""
        forces = np.zeros(self._plant.num_velocities())
        self._plant.SetVelocitiesInArray(self._arm, torque, forces)
        self._forces.FixValue(self._context, forces)
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * STEP_S)


def _inertia(model: mujoco.MjModel, body: int) -> SpatialInertia:
    """Returns mass and inertia about the body's own frame; of a mere frame, none."""
    if model.body_mass[body] == 0.0:
        return SpatialInertia.Zero()
    axes = _pose(np.zeros(3), model.body_iquat[body]).rotation()
    central = RotationalInertia(*model.body_inertia[body]).ReExpress(axes)
    return SpatialInertia.MakeFromCentralInertia(
        model.body_mass[body], model.body_ipos[body], central
    )


def _join(plant: MultibodyPlant, model: mujoco.MjModel, bodies: list[RigidBody], body: int) -> None:
    """Joins a body to its parent: by a hinge, firmly, or not at all where it is free."""
    parent, child = bodies[model.body_parentid[body]], bodies[body]
    pose, joint = _pose(model.body_pos[body], model.body_quat[body]), int(model.body_jntadr[body])
    if joint < 0:
        plant.WeldFrames(parent.body_frame(), child.body_frame(), pose)
    elif model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE:
        name, dof = model.joint(joint).name, model.jnt_dofadr[joint]
        mount = plant.AddFrame(FixedOffsetFrame(f"{name}_mount", parent.body_frame(), pose))
        hinge = plant.AddJoint(
            RevoluteJoint(
                name,
                mount,
                child.body_frame(),
                model.jnt_axis[joint],
                *model.jnt_range[joint],
                damping=model.dof_damping[dof],
            )
        )
        # For its inertia alone: what drives a joint is applied with whatever else acts on it.
        rotor = plant.AddJointActuator(name, hinge)
        rotor.set_default_gear_ratio(1.0)
        rotor.set_default_rotor_inertia(model.dof_armature[dof])
    else:
        plant.SetDefaultFloatingBaseBodyPose(child, pose)


def _add_shape(
    plant: MultibodyPlant, model: mujoco.MjModel, bodies: list[RigidBody], geom: int
) -> None:
    body, properties = int(model.geom_bodyid[geom]), ProximityProperties()
    friction = _friction(model, geom)
    AddContactMaterial(
        dissipation=_DISSIPATION,
        point_stiffness=None,
        friction=CoulombFriction(friction, friction),
        properties=properties,
    )
    if model.body(body).name in (OBJECT_BODY, *TOOL_BODIES):
        AddCompliantHydroelasticProperties(_ELEMENT_M, _MODULUS, properties)
    elif model.body_weldid[body] == 0:
        AddRigidHydroelasticProperties(_ELEMENT_M, properties)
    pose = _pose(model.geom_pos[geom], model.geom_quat[geom])
    shape, inside = _shape(int(model.geom_type[geom]), model.geom_size[geom])
    name = model.geom(geom).name
    plant.RegisterCollisionGeometry(bodies[body], pose @ inside, shape, name, properties)


def _let_neighbours_overlap(
    plant: MultibodyPlant, scene: SceneGraph, model: mujoco.MjModel, bodies: list[RigidBody]
) -> None:
    """Lets links that a joint joins overlap, with all that is mounted on them, as in MuJoCo.

    Drake does so by itself for the joint's two bodies alone: the last link but one, which the
    tool's rod sticks in, would press on it with a thousand newtons.
    """
    groups = {
        int(link): [bodies[i] for i in range(model.nbody) if model.body_weldid[i] == link]
        for link in model.body_weldid
    }
    geometries = {link: plant.CollectRegisteredGeometries(of) for link, of in groups.items()}
    for link in groups:
        parent = int(model.body_weldid[model.body_parentid[link]])
        if parent > 0:
            pair = CollisionFilterDeclaration().ExcludeBetween(geometries[link], geometries[parent])
            scene.collision_filter_manager().Apply(pair)


def _friction(model: mujoco.MjModel, geom: int) -> float:
    """Returns the coefficient that makes what two surfaces have together right.

    Drake takes 2 m n / (m + n) of coefficients m and n. The object's own friction mu counts in all
    its contacts (MuJoCo's `priority`): against what all others have, n, m is mu n / (2 n - mu).
    """
    mu = float(model.geom_friction[geom, 0])
    if model.geom_priority[geom] == 0:
        return mu
    other = float(model.geom_friction[model.geom_priority == 0, 0].max())
    if mu >= 2.0 * other:
        raise ConfigError(
            f"the object's friction is {mu:g}, expected less than {2.0 * other:g} in Drake"
        )
    return mu * other / (2.0 * other - mu)


def _shape(kind: int, size: Array) -> tuple[Shape, RigidTransform]:
    """Returns a shape, and where it lies in the frame that MuJoCo gives it."""
    here = RigidTransform()
    match mujoco.mjtGeom(kind):
        case mujoco.mjtGeom.mjGEOM_PLANE:
            ground = Box(2.0 * size[0], 2.0 * size[1], _GROUND_M)
            return ground, RigidTransform([0.0, 0.0, -_GROUND_M / 2.0])
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return Sphere(size[0]), here
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return Capsule(size[0], 2.0 * size[1]), here
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return Cylinder(size[0], 2.0 * size[1]), here
        case mujoco.mjtGeom.mjGEOM_BOX:
            return Box(2.0 * size), here
    raise AssertionError(f"the cell has no shape of kind {kind}")


def _pose(place: Array, quaternion: Array) -> RigidTransform:
    return RigidTransform(Quaternion(quaternion / np.linalg.norm(quaternion)), place)
