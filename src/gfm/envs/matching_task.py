"""The two pushing tasks as values: where to, how near, and what that is worth.

Shape letters: n goals, N states. A goal is x, y (m, base frame) and yaw (rad); tasks without a yaw
ignore it.

Success is the paper's test (Jeong et al. 2019, section IV-C). The reward is ours: what a step gains
on the way to it, and a half for every step spent there,

    phi(after) - phi(before) + 0.5 [reached],    phi = -(d + 2 e) / 2 cm,

and -5 for what ends an episode early. e is how far the object is from its goal: the success test's
tolerance in metres times the distance D in units of that tolerance (for a pose the norm of both
parts). d is how far the tool is from where it should be: against the object's far side, seen from
the goal, off its centre where it has to turn, and above the object as long as it has to get there.
Within the tolerance it counts as none. Who only ever goes where d points pushes the object to the
goal: a test does.

A reward for where tool and object are can hardly be learned from: in one step the tool moves 3 mm,
so that what tells one action from another is a small part of what the state is worth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gfm.core import ConfigError, ShapeError
from gfm.core.checks import Array
from gfm.envs.tool_place import Pusher, Straight, Turning, tool_place
from gfm.sim import sawyer_numbers as numbers
from gfm.sim.cell import (
    BALL_RADIUS_M,
    TEE_BOXES,
    EndEffector,
    FreeObject,
    object_rest_position,
)
from gfm.sim.kinematics import wrapped, yaw_of

RADIAL_GOALS = 10
#: How far training goals go, in units of the radial goals' distance and yaw.
_BEYOND = 1.2

_CENTRE = np.array(numbers.BASKET_XYZ)
_OBJECT_WEIGHT, _UNIT_M, _REACHED_REWARD = 2.0, 0.02, 0.5
#: Of what ends an episode before its time.
FAILURE_REWARD = -5.0
#: In size: tool and object would have to cross their workspace several times in one step.
REWARD_LIMIT = 1e3
#: From the basket's axis to where a wall leaves the floor, m.
_FLOOR_M = numbers.BASKET_WALL_OFFSET - numbers.BASKET_WALL_HEIGHT / math.tan(numbers.BASKET_SLOPE)
#: Lower and upper corner of where the tool's tip may be, and of where the object may be, relative
#: to the centre of the basket's floor, m.
_TIP_BOX = np.array([[-0.2, -0.2, -0.01], [0.2, 0.2, 0.25]])
_OBJECT_BOX = np.array([[-0.25, -0.25, -0.02], [0.25, 0.25, 0.25]])


@dataclass(frozen=True, kw_only=True)
class MatchingTask:
    """One of the tasks.

    Attributes:
        name: Of the environment.
        steps: Of an episode, at 20 Hz.
        end_effector: What pushes.
        free_object: What is pushed.
        tolerance_m: Success: how near to the goal.
        tolerance_rad: Success: how near to its yaw; None where that does not matter.
        pusher: How the tool pushes the object.
        goal_radius_m: Of the radial goals, around the basket's centre.
        goal_yaw_rad: Largest yaw of a goal.
    """

    name: str
    steps: int
    end_effector: EndEffector
    free_object: FreeObject
    tolerance_m: float
    tolerance_rad: float | None
    pusher: Pusher
    goal_radius_m: float
    goal_yaw_rad: float = 0.0

    @property
    def rest_position(self) -> Array:
        """Where the object rests at the basket's centre, m, shape (3,)."""
        return np.array(object_rest_position(self.free_object))

    def random_goals(self, count: int, rng: np.random.Generator) -> Array:
        """Returns goals a little beyond the radial goals in place and yaw, shape (n, 3)."""
        radius = _BEYOND * self.goal_radius_m * np.sqrt(rng.uniform(size=count))
        angle = rng.uniform(-np.pi, np.pi, size=count)
        yaw = rng.uniform(-_BEYOND, _BEYOND, size=count) * self.goal_yaw_rad
        return _goals(radius, angle, yaw)

    def radial_goals(self) -> Array:
        """Returns the ten goals of the evaluation, around the basket's centre, shape (10, 3)."""
        number = np.arange(RADIAL_GOALS)
        angle = 2.0 * np.pi * number / RADIAL_GOALS
        yaw = np.where(number % 2, -1.0, 1.0) * self.goal_yaw_rad
        return _goals(np.full(RADIAL_GOALS, self.goal_radius_m), angle, yaw)

    def distance(self, position: Array, axes: Array, goal: Array) -> Array:
        """Returns D, shape (N,): the distance in units of the tolerance.

        Args:
            position: Of the object, m, shape (N, 3).
            axes: Of the object, as `gfm.sim.kinematics.body_axes` gives them, shape (N, 6).
            goal: shape (N, 3).
        """
        place, turn = self.errors(position, axes, goal)
        yaw = 0.0 if self.tolerance_rad is None else turn / self.tolerance_rad
        return np.hypot(place / self.tolerance_m, yaw)

    def reached(self, position: Array, axes: Array, goal: Array) -> NDArray[np.bool_]:
        """Returns where the object is near enough, shape (N,); arguments as of `distance`."""
        place, turn = self.errors(position, axes, goal)
        near: NDArray[np.bool_] = place <= self.tolerance_m
        return near if self.tolerance_rad is None else near & (turn <= self.tolerance_rad)

    def errors(self, position: Array, axes: Array, goal: Array) -> tuple[Array, Array]:
        """Returns horizontal distance, m, and difference in yaw, rad, both (N,) and positive."""
        place = np.linalg.norm(position[:, :2] - goal[:, :2], axis=1)
        return place, np.abs(wrapped(yaw_of(axes) - goal[:, 2]))

    def potential(self, tip: Array, position: Array, axes: Array, goal: Array) -> Array:
        """Returns phi, what is left to go, negative, shape (N,).

        Args:
            tip: Of the tool, m, shape (N, 3).
            position: As of `distance`.
            axes: As of `distance`.
            goal: As of `distance`.
        """
        away = np.linalg.norm(tip - self.tool_place(tip, position, axes, goal), axis=1)
        away = np.where(self.reached(position, axes, goal), 0.0, away)
        left = self.tolerance_m * self.distance(position, axes, goal)
        return np.asarray(-(away + _OBJECT_WEIGHT * left) / _UNIT_M)

    def tool_place(self, tip: Array, position: Array, axes: Array, goal: Array) -> Array:
        """Returns where the tool should be, m, shape (N, 3); arguments as of `potential`."""
        return tool_place(self.pusher, tip, position, axes, goal)


def reward(gained: Array, reached: NDArray[np.bool_], failed: NDArray[np.bool_]) -> Array:
    """Returns what a step is worth, shape (N,).

    Args:
        gained: Potential after the step minus the one before, shape (N,).
        reached: Where the goal is reached after it, shape (N,).
        failed: Where it ended the episode, shape (N,).
    """
    return np.where(failed, FAILURE_REWARD, gained + _REACHED_REWARD * reached)


def tip_outside(tip: Array) -> NDArray[np.bool_]:
    """Returns where the tool has left its workspace, shape (N,), for tips (N, 3)."""
    return _outside(tip, _TIP_BOX)


def object_outside(position: Array) -> NDArray[np.bool_]:
    """Returns where the object has left the basket, shape (N,), for positions (N, 3)."""
    return _outside(position, _OBJECT_BOX)


def check_goals(goals: Array, count: int) -> None:
    """Raises where goals are not of shape (count, 3), or one is not on the basket's floor.

    The floor is what the walls, sloping outwards, leave free.
    """
    if goals.shape != (count, 3):
        raise ShapeError("goals", goals.shape, f"({count}, 3)")
    away = np.abs(goals[:, :2] - _CENTRE[:2]).max(axis=1)
    outside = np.flatnonzero(~(away <= _FLOOR_M))
    if len(outside):
        x, y = goals[outside[0], :2]
        raise ConfigError(
            f"goal {outside[0]} is at x {x:.3f} m, y {y:.3f} m, expected a place on the basket's "
            f"floor: within {_FLOOR_M:.3f} m of x {_CENTRE[0]:.3f} m, y {_CENTRE[1]:.3f} m"
        )


def _outside(position: Array, box: Array) -> NDArray[np.bool_]:
    relative = position - _CENTRE
    outside: NDArray[np.bool_] = ((relative < box[0]) | (relative > box[1])).any(axis=1)
    return outside


def _goals(radius: Array, angle: Array, yaw: Array) -> Array:
    x, y = _CENTRE[0] + radius * np.cos(angle), _CENTRE[1] + radius * np.sin(angle)
    return np.stack([x, y, yaw], axis=1)


POSITION_MATCHING = MatchingTask(
    name="position_matching",
    steps=400,
    end_effector="plate",
    free_object="brick",
    tolerance_m=0.025,
    tolerance_rad=None,
    pusher=Straight(contact_m=(0.055, 0.09)),  # the plate face on, or edge on
    goal_radius_m=0.08,
)
POSE_MATCHING = MatchingTask(
    name="pose_matching",
    steps=600,
    end_effector="ball",
    free_object="tee",
    tolerance_m=0.05,
    tolerance_rad=math.radians(20.0),
    pusher=Turning(boxes=TEE_BOXES, radius_m=BALL_RADIUS_M),
    goal_radius_m=0.06,
    goal_yaw_rad=math.radians(60.0),
)
TASKS = {task.name: task for task in (POSITION_MATCHING, POSE_MATCHING)}
