"""Where a tool should be to push an object to a goal: what the matching tasks' reward draws it to.

A tool pushes along a way, past the object's centre at a lateral offset that turns it: first from
above to behind the object, then down, then against it.

Shape letters: N states. Ways are horizontal, of length 1 or, near the goal, less; shape (N, 2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gfm.core.checks import Array
from gfm.sim.cell import Box
from gfm.sim.kinematics import wrapped, yaw_of

#: The tool's place: so far clear of the object as long as the tool is above it, and so far beyond
#: first contact once it is beside it, so that to go there is to push. While it has to get there, it
#: is so high above the object's centre; it comes down over the last centimetres.
_CLEAR_M, _PRESS_M, _LIFT_M, _DESCENT_M = 0.02, 0.02, 0.06, 0.01
#: Heights of the tip above the object's centre at which the tool is beside the object, and above.
_BESIDE_M, _ABOVE_M = 0.01, 0.04
#: How far beside its place a tool may come down.
_ASIDE_M = 0.02
#: Largest offset of a push from the centre, and the difference in yaw from which on it is made.
_LEVER_M, _TURN_RAD = 0.045, 0.35
#: What the way to the goal is weighed against: the nearer it is, the more is pushed from where the
#: tool is.
_NEAR_M = 0.05
#: From where rays are sent to find the first contact: outside of any object.
_FAR_M = 0.3


@dataclass(frozen=True, kw_only=True)
class Push:
    """How an object is to be pushed.

    Attributes:
        way: Direction, shape (N, 2).
        lateral: By how much the push passes the centre, to its left, m, shape (N,).
        contact: Between the centres of tool and object along `way` at first contact, m, (N,).
    """

    way: Array
    lateral: Array
    contact: Array


class Pusher(Protocol):
    """A tool and what it pushes."""

    def push(self, tip: Array, position: Array, axes: Array, goal: Array) -> Push:
        """Returns how to push; arguments as of `tool_place`."""


@dataclass(frozen=True, kw_only=True)
class Straight:
    """Pushes through the centre, towards the goal; within a centimetre of it hardly any more.

    Attributes:
        contact_m: Between the centres where they touch along x, and along y.
    """

    contact_m: tuple[float, float]

    def push(self, tip: Array, position: Array, axes: Array, goal: Array) -> Push:  # noqa: ARG002
        """Returns how to push; arguments as of `tool_place`."""
        way = goal[:, :2] - position[:, :2]
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 0.01)
        contact = 1.0 / np.maximum(np.linalg.norm(way / self.contact_m, axis=1), 1.0)
        return Push(way=way, lateral=np.zeros(len(way)), contact=contact)


@dataclass(frozen=True, kw_only=True)
class Turning:
    """Pushes a body of boxes with a ball, off its centre where it has to turn.

    Attributes:
        boxes: Of the body, in its frame.
        radius_m: Of the ball.
    """

    boxes: Sequence[Box]
    radius_m: float

    def push(self, tip: Array, position: Array, axes: Array, goal: Array) -> Push:
        """Returns how to push; arguments as of `tool_place`."""
        outward = tip[:, :2] - position[:, :2]
        outward = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-3)
        way = goal[:, :2] - position[:, :2] - _NEAR_M * outward
        way = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-6)
        yaw = yaw_of(axes)
        lateral = -_LEVER_M * np.clip(wrapped(goal[:, 2] - yaw) / _TURN_RAD, -1.0, 1.0)
        return Push(way=way, lateral=lateral, contact=self._contact(way, lateral, yaw))

    def _contact(self, way: Array, lateral: Array, yaw: Array) -> Array:
        """Returns where the ball first touches: rays against boxes that are larger by its radius.

        Seen from the body; the corners of the larger boxes are sharp, the true ones round.
        """
        start = _in_body(lateral[:, None] * _left_of(way) - _FAR_M * way, yaw)
        along = _in_body(way, yaw)
        along = np.where(np.abs(along) < 1e-9, 1e-9, along)
        first = np.full(len(way), np.inf)
        for half, centre in self.boxes:
            reach = np.array(half[:2]) + self.radius_m
            sides = [(np.array(centre[:2]) + side * reach - start) / along for side in (-1.0, 1.0)]
            enters, leaves = np.minimum(*sides).max(axis=1), np.maximum(*sides).min(axis=1)
            first = np.where(leaves >= enters, np.minimum(first, enters), first)
        return np.where(np.isfinite(first), _FAR_M - first, 0.0)


def tool_place(pusher: Pusher, tip: Array, position: Array, axes: Array, goal: Array) -> Array:
    """Returns where the tool should be, m, shape (N, 3).

    Args:
        pusher: Tool and object.
        tip: Of the tool, m, shape (N, 3).
        position: Of the object, m, shape (N, 3).
        axes: Of the object, as `gfm.sim.kinematics.body_axes` gives them, shape (N, 6).
        goal: x, y (m) and yaw (rad), shape (N, 3).
    """
    push = pusher.push(tip, position, axes, goal)
    offset, left = tip - position, _left_of(push.way)
    above = np.clip((offset[:, 2] - _BESIDE_M) / (_ABOVE_M - _BESIDE_M), 0.0, 1.0)
    back = -(offset[:, :2] * push.way).sum(axis=1)
    short = push.contact + _DESCENT_M * above - _PRESS_M * (1.0 - above) - back
    aside = np.abs((offset[:, :2] * left).sum(axis=1) - push.lateral)
    turning = (push.lateral != 0.0) & (above > 0.0)
    short = np.where(turning, np.maximum(short, aside - _ASIDE_M), short)
    place = position.copy()
    behind = push.contact + _CLEAR_M * above - _PRESS_M * (1.0 - above)
    place[:, :2] += push.lateral[:, None] * left - behind[:, None] * push.way
    place[:, 2] += _LIFT_M * np.clip(short / _DESCENT_M, 0.0, 1.0)
    return place


def _left_of(way: Array) -> Array:
    return np.stack([-way[:, 1], way[:, 0]], axis=1)


def _in_body(vector: Array, yaw: Array) -> Array:
    """Returns horizontal vectors (N, 2) as seen from a body that is turned by `yaw`, shape (N,)."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    x, y = vector.T
    return np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)
