"""Three robots in numbers: a servo pendulum, a planar arm of two joints, a spatial arm of seven.

Shape letters: J joints.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

UPRIGHT = np.array([0.0, 0.0, -9.81])


@dataclass(frozen=True, kw_only=True, eq=False)
class Robot:
    """A chain of links on hinges, with drives: what its nominal model says.

    The frame of a link sits at its joint. Where the chain is at q = 0, frame j has the rotation
    `turn[j]` and the place `offset[j]` in frame j - 1; the joint turns it about `axis[j]`.

    Attributes:
        name: Of the robot.
        joints: Their names.
        offset: m, shape (J, 3).
        turn: Rotation vectors, rad, shape (J, 3).
        axis: Unit vectors in the link's frame, shape (J, 3).
        mass: kg, shape (J,).
        com: Centres of mass in the links' frames, m, shape (J, 3).
        inertia: Principal moments about them, along the frame's axes, kg m^2, shape (J, 3).
        armature: kg m^2, shape (J,).
        damping: N m s/rad, shape (J,).
        friction: Dry friction that the model declares, N m, shape (J,).
        stiffness: Of the position servo, N m/rad, shape (J,).
        servo_damping: Of the position servo, N m s/rad, shape (J,).
        velocity_gain: Of the velocity servo, N m s/rad, shape (J,).
        compensated: Whether the controller cancels gravity.
        rest: Middle of all motions, rad, shape (J,).
        reach: Half the range of motions, rad, shape (J,).
        speed: Typical largest speed of motions, rad/s, shape (J,).
        torque: Typical torque of the drives, N m, shape (J,).
        encoder_step: rad.
        encoder_noise: Standard deviation, rad.
    """

    name: str
    joints: tuple[str, ...]
    offset: Array
    turn: Array
    axis: Array
    mass: Array
    com: Array
    inertia: Array
    armature: Array
    damping: Array
    friction: Array
    stiffness: Array
    servo_damping: Array
    velocity_gain: Array
    compensated: bool = False
    rest: Array
    reach: Array
    speed: Array
    torque: Array
    encoder_step: float
    encoder_noise: float

    @property
    def planar(self) -> bool:
        """Whether all joints are parallel and horizontal."""
        return bool((self.axis == [0.0, 1.0, 0.0]).all() and not self.turn.any())

    @property
    def upright(self) -> bool:
        """Whether the first joint turns about the vertical: nothing tells where its zero is."""
        return bool(np.isclose(abs(Rotation.from_rotvec(self.turn[0]).apply(self.axis[0])[2]), 1.0))


def _array(*values: float) -> Array:
    return np.array(values)


PENDULUM = Robot(
    name="pendulum",
    joints=("hinge",),
    offset=np.array([[0.0, 0.0, 0.5]]),
    turn=np.zeros((1, 3)),
    axis=np.array([[0.0, 1.0, 0.0]]),
    mass=_array(0.4),
    com=np.array([[0.0, 0.0, -0.15]]),
    inertia=np.array([[2.1e-3, 2.0e-3, 3e-4]]),
    armature=_array(0.004),
    damping=_array(0.01),
    friction=_array(0.0),
    stiffness=_array(6.0),
    servo_damping=_array(0.25),
    velocity_gain=_array(0.4),
    rest=_array(0.0),
    reach=_array(1.4),
    speed=_array(4.0),
    torque=_array(0.6),
    encoder_step=2 * np.pi / 16384,
    encoder_noise=1.5e-4,
)

PLANAR = Robot(
    name="planar",
    joints=("shoulder", "elbow"),
    offset=np.array([[0.0, 0.0, 0.9], [0.0, 0.0, -0.3]]),
    turn=np.zeros((2, 3)),
    axis=np.array([[0.0, 1.0, 0.0], [0.0, 1.0, 0.0]]),
    mass=_array(1.2, 0.8),
    com=np.array([[0.01, 0.0, -0.12], [0.0, 0.0, -0.14]]),
    inertia=np.array([[0.011, 0.010, 0.002], [0.0085, 0.008, 0.001]]),
    armature=_array(0.012, 0.008),
    damping=_array(0.05, 0.03),
    friction=np.zeros(2),
    stiffness=_array(60.0, 20.0),
    servo_damping=_array(4.0, 1.0),
    velocity_gain=_array(6.0, 1.5),
    rest=_array(0.2, 0.4),
    reach=_array(1.2, 1.2),
    speed=_array(2.5, 3.5),
    torque=_array(5.0, 1.2),
    encoder_step=2 * np.pi / 65536,
    encoder_noise=1e-4,
)

_X, _Y, _Z = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]

SPATIAL = Robot(
    name="spatial",
    joints=tuple(f"axis_{i}" for i in range(1, 8)),
    offset=np.array(
        [
            [0.0, 0.0, 0.28],
            [0.06, 0.0, 0.10],
            [0.0, 0.0, 0.20],
            [0.05, 0.0, 0.18],
            [0.0, 0.0, 0.17],
            [0.0, 0.03, 0.16],
            [0.08, 0.0, 0.0],
        ]
    ),
    turn=np.array(
        [
            [0.0, 0.0, 0.3],
            [0.0, 0.2, 0.0],
            [0.0, 0.0, 0.0],
            [0.0, 0.0, -0.5],
            [0.1, 0.0, 0.0],
            [0.0, 0.0, 0.7],
            [0.0, 0.4, 0.0],
        ]
    ),
    axis=np.array([_Z, _Y, _Z, _Y, _Z, _Y, _X]),
    mass=_array(4.2, 3.4, 2.8, 2.2, 1.7, 1.2, 0.5),
    com=np.array(
        [
            [0.01, 0.0, 0.05],
            [0.0, 0.03, 0.09],
            [0.02, 0.0, 0.10],
            [0.0, -0.02, 0.08],
            [0.01, 0.01, 0.09],
            [0.04, 0.0, 0.01],
            [0.05, 0.01, 0.0],
        ]
    ),
    inertia=np.array(
        [
            [0.020, 0.020, 0.012],
            [0.016, 0.016, 0.008],
            [0.014, 0.014, 0.006],
            [0.010, 0.010, 0.005],
            [0.008, 0.008, 0.003],
            [0.003, 0.004, 0.004],
            [6e-4, 8e-4, 8e-4],
        ]
    ),
    armature=_array(0.12, 0.12, 0.08, 0.08, 0.04, 0.04, 0.03),
    damping=_array(0.8, 0.8, 0.5, 0.5, 0.2, 0.2, 0.1),
    friction=np.zeros(7),
    stiffness=_array(700.0, 700.0, 500.0, 400.0, 180.0, 140.0, 80.0),
    servo_damping=_array(50.0, 50.0, 30.0, 25.0, 8.0, 6.0, 3.0),
    velocity_gain=_array(70.0, 70.0, 45.0, 35.0, 12.0, 9.0, 5.0),
    rest=_array(0.0, 0.5, 0.0, 0.9, 0.0, 0.6, 0.0),
    reach=_array(0.8, 0.5, 0.8, 0.7, 0.9, 0.8, 1.0),
    speed=_array(1.2, 1.0, 1.2, 1.2, 1.6, 1.6, 2.0),
    torque=_array(12.0, 25.0, 8.0, 10.0, 2.0, 2.0, 0.7),
    encoder_step=2 * np.pi / 131072,
    encoder_noise=8e-5,
)


def varied(robot: Robot, rng: np.random.Generator) -> Robot:
    """Returns the robot as another maker would build it: other lengths, masses and gains."""

    def scaled(values: Array, low: float, high: float) -> Array:
        shape = (len(values), *(1 for _ in values.shape[1:]))
        return values * rng.uniform(low, high, shape)

    return replace(
        robot,
        offset=scaled(robot.offset, 0.85, 1.2),
        mass=scaled(robot.mass, 0.75, 1.3),
        com=scaled(robot.com, 0.85, 1.15),
        inertia=scaled(robot.inertia, 0.8, 1.25),
        armature=scaled(robot.armature, 0.7, 1.4),
        damping=scaled(robot.damping, 0.5, 1.5),
        stiffness=scaled(robot.stiffness, 0.8, 1.2),
        servo_damping=scaled(robot.servo_damping, 0.85, 1.15),
        velocity_gain=scaled(robot.velocity_gain, 0.8, 1.2),
    )
