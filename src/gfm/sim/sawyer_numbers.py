"""What is known of the Sawyer arm and its basket cell. SI units; every frame is its parent's.

Sources (none of the dynamics numbers is an identified value):
    A: RethinkRobotics/sawyer_robot at d1ef3d0 (URDF, Apache-2.0): kinematics, inertias, limits.
    B: google-deepmind/mujoco_menagerie at 28ffb48 (Apache-2.0): capsules, damping, servo gains.
    C: google-deepmind/dm_robotics at b7c333e (Apache-2.0): velocity servo, basket.
Restated numbers, no copied code. Where sources disagree, A is taken.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Link:
    """One rigid link.

    Attributes:
        name: Of the body.
        mass: kg.
        com: Centre of mass in the link frame, m.
        inertia: xx, yy, zz, xy, xz, yz about the centre of mass, axes of the link frame, kg m^2.
        capsules: Collision shapes: from, to, radius in the link frame, m.
    """

    name: str
    mass: float
    com: Vector
    inertia: tuple[float, float, float, float, float, float]
    capsules: tuple[tuple[Vector, Vector, float], ...] = ()


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One hinge about the z axis of its child link, and the servo that the models give it.

    Attributes:
        name: Of the joint and of its actuator.
        xyz: Of the child frame in the parent link's frame, m.
        rpy: Of the child frame: roll, pitch, yaw about the parent's fixed axes, rad.
        lower: Position limit, rad.
        upper: Position limit, rad.
        velocity: Limit, rad/s.
        effort: Limit, N m.
        kp: Position servo's stiffness, N m/rad (B).
        kd: Position servo's damping, N m s/rad (B).
    """

    name: str
    xyz: Vector
    rpy: Vector
    lower: float
    upper: float
    velocity: float
    effort: float
    kp: float
    kd: float


ARMATURE = 1.0  # kg m^2, B and C
DAMPING = 0.1  # N m s/rad, B and C; their friction loss is left out: friction is to be found
VELOCITY_GAIN = 50.0  # N m s/rad, C's velocity servo

_HALF = math.pi / 2

JOINTS = (
    Joint(
        name="right_j0",
        xyz=(0.0, 0.0, 0.08),
        rpy=(0.0, 0.0, 0.0),
        lower=-3.0503,
        upper=3.0503,
        velocity=1.74,
        effort=80.0,
        kp=800.0,
        kd=80.0,
    ),
    Joint(
        name="right_j1",
        xyz=(0.081, 0.05, 0.237),
        rpy=(-_HALF, _HALF, 0.0),
        lower=-3.8095,
        upper=2.2736,
        velocity=1.328,
        effort=80.0,
        kp=800.0,
        kd=80.0,
    ),
    Joint(
        name="right_j2",
        xyz=(0.0, -0.14, 0.1425),
        rpy=(_HALF, 0.0, 0.0),
        lower=-3.0426,
        upper=3.0426,
        velocity=1.957,
        effort=40.0,
        kp=800.0,
        kd=80.0,
    ),
    Joint(
        name="right_j3",
        xyz=(0.0, -0.042, 0.26),
        rpy=(-_HALF, 0.0, 0.0),
        lower=-3.0439,
        upper=3.0439,
        velocity=1.957,
        effort=40.0,
        kp=800.0,
        kd=80.0,
    ),
    Joint(
        name="right_j4",
        xyz=(0.0, -0.125, -0.1265),
        rpy=(_HALF, 0.0, 0.0),
        lower=-2.9761,
        upper=2.9761,
        velocity=3.485,
        effort=9.0,
        kp=500.0,
        kd=50.0,
    ),
    Joint(
        name="right_j5",
        xyz=(0.0, 0.031, 0.275),
        rpy=(-_HALF, 0.0, 0.0),
        lower=-2.9761,
        upper=2.9761,
        velocity=3.485,
        effort=9.0,
        kp=500.0,
        kd=50.0,
    ),
    Joint(
        name="right_j6",
        xyz=(0.0, -0.11, 0.1053),
        rpy=(-_HALF, -0.17453, 3.1416),
        lower=-4.7124,
        upper=4.7124,
        velocity=4.545,
        effort=9.0,
        kp=500.0,
        kd=50.0,
    ),
)

BASE = Link(
    name="right_arm_base_link",
    mass=2.0687,
    com=(-0.0006241, -2.8025e-05, 0.065404),
    inertia=(0.0067599, 0.0067877, 0.0074031, -4.2024e-05, -6.1904e-07, 1.5888e-05),
)

# The head's pan joint is welded at zero, as in B and C.
HEAD = Link(
    name="head",
    mass=1.5795,
    com=(0.0053207, -2.6549e-05, 0.1021),
    inertia=(0.011833, 0.0082709, 0.0049661, -4.4669e-06, 4.9425e-05, 4.2124e-07),
    capsules=(((-0.005, 0.0, 0.02), (-0.005, 0.0, 0.205), 0.04),),
)
HEAD_XYZ: Vector = (0.0, 0.0, 0.2965)  # in right_l0
HEAD_BOX: tuple[Vector, Vector] = ((0.025, 0.0, 0.1), (0.01, 0.13, 0.08))  # the display: pos, half

LINKS = (  # LINKS[i] moves with JOINTS[i]
    Link(
        name="right_l0",
        mass=5.3213,
        com=(0.024366, 0.010969, 0.14363),
        inertia=(0.053314, 0.057902, 0.023659, 0.0047093, 0.011734, 0.0080179),
        capsules=(((0.0, 0.0, -0.005), (0.0, 0.0, 0.25), 0.07),),
    ),
    Link(
        name="right_l1",
        mass=4.505,
        com=(-0.0030849, -0.026811, 0.092521),
        inertia=(0.022398, 0.014613, 0.017295, -0.00023986, -0.00029362, -0.0060875),
        capsules=(((0.0, 0.0, -0.06), (0.0, 0.0, 0.13), 0.068),),
    ),
    Link(
        name="right_l2",
        mass=1.745,
        com=(-0.00016044, -0.014967, 0.13582),
        inertia=(0.025506, 0.0253, 0.0034179, 4.4101e-06, 1.4955e-05, -0.0033204),
        capsules=(((0.0, 0.0, -0.15), (0.0, 0.0, 0.26), 0.055),),
    ),
    Link(
        name="right_l3",
        mass=2.5097,
        com=(-0.0048135, -0.0281, -0.084154),
        inertia=(0.01016, 0.0065685, 0.0069078, -9.7452e-06, 0.00026624, 0.0030316),
        capsules=(((0.0, 0.0, -0.115), (0.0, 0.0, 0.03), 0.055),),
    ),
    Link(
        name="right_l4",
        mass=1.1136,
        com=(-0.0018844, 0.0069001, 0.1341),
        inertia=(0.013557, 0.013555, 0.0013658, 1.8109e-05, 0.00013523, 0.0010561),
        capsules=(((0.0, 0.0, -0.13), (0.0, 0.0, 0.27), 0.045),),
    ),
    Link(
        name="right_l5",
        mass=1.5625,
        com=(0.0061133, -0.023697, 0.076416),
        inertia=(0.0047328, 0.0029676, 0.0031762, 0.00011526, 4.6269e-05, -0.0011557),
        capsules=(
            ((0.0, 0.0, -0.02), (0.0, 0.0, 0.1), 0.045),
            ((0.0, 0.0, 0.105), (0.0, -0.082, 0.105), 0.045),
        ),
    ),
    Link(
        name="right_l6",
        mass=0.3292,
        com=(-8.0726e-06, 0.0085838, -0.0049566),
        inertia=(0.00031105, 0.00021549, 0.00035976, 1.4771e-06, -3.7074e-07, -8.4533e-06),
    ),
)
FLANGE = (0.045, 0.02)  # radius and half length of right_l6's cylinder, m (B)

# The end-effector frame: the SDK's default tip where no gripper is mounted.
HAND_XYZ: Vector = (0.0, 0.0, 0.0245)  # in right_l6
HAND_RPY: Vector = (0.0, 0.0, 1.570796)

NEUTRAL = (0.0, -1.18, 0.0, 2.18, 0.0, 0.57, 3.3161)  # rad, A's named pose
# The hand above the basket's centre at z = 0.36 m, pointing down: tools clear the object (ours).
READY = (-0.286, -1.2002, 0.0227, 1.7066, -0.0094, 1.0645, 3.0558)
PEDESTAL_HEIGHT = 0.913  # m, the base above the floor (C)

# The basket of C's standard cell, in the robot's base frame.
BASKET_XYZ: Vector = (0.6, 0.0, 0.0498)
BASKET_FLOOR: Vector = (0.25, 0.25, 0.02)  # half sizes, its top at the basket's origin
BASKET_WALL: Vector = (0.2, 0.4, 0.005)  # half sizes: along the slope, across it, thickness
BASKET_WALL_OFFSET = 0.28  # m, of a wall's centre from the basket's axis
BASKET_WALL_HEIGHT = 0.07  # m, of a wall's centre
BASKET_SLOPE = math.radians(25.5)
