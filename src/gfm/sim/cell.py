"""What stands around the arm: end effectors, the basket, and the free object in it.

Sizes, masses and friction of tools and objects are ours: the paper shows pictures, no numbers. The
basket is that of the public DeepMind cell.
"""

from __future__ import annotations

import math
from typing import Literal

import mujoco

from gfm.core import ConfigError
from gfm.sim import sawyer_numbers as numbers

EndEffector = Literal["none", "plate", "ball"]
FreeObject = Literal["brick", "tee"]

HAND_BODY = "right_hand"
OBJECT_BODY = "object"
END_EFFECTOR_SITE = "end_effector"

_BOX = mujoco.mjtGeom.mjGEOM_BOX
_TOOL_RGBA = (0.7, 0.85, 0.95, 0.8)
_BASKET_RGBA = (0.35, 0.35, 0.4, 1.0)
_OBJECT_RGBA = (0.9, 0.6, 0.1, 1.0)
_OBJECT_FRICTION = (0.4, 0.005, 0.0001)  # sliding (plastic on plastic), torsional m, rolling m

#: Half sizes and position of a box that an object is made of, m.
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
BALL_RADIUS_M = 0.025
TEE_BOXES: tuple[Box, ...] = (
    ((0.05, 0.02, 0.025), (0.0, 0.02, 0.0)),
    ((0.02, 0.04, 0.025), (0.0, -0.04, 0.0)),
)
_BRICK_BOXES: tuple[Box, ...] = (((0.05, 0.03, 0.03), (0.0, 0.0, 0.0)),)
_OBJECT_MASS = 0.15  # kg
_REST_HEIGHT = {"brick": 0.03, "tee": 0.025}


def add_end_effector(hand: mujoco.MjsBody, kind: EndEffector) -> None:
    """Mounts a tool along the z axis of `right_hand` and marks its tip with a site.

    Plate: acrylic, 12 cm wide, 16 cm long, 1 cm thick, on an 8 cm rod. Ball: radius 2.5 cm, on a
    12 cm rod. The arm's gravity compensation knows the tool.
    """
    if kind == "none":
        hand.add_site(name=END_EFFECTOR_SITE)
        return
    tool = hand.add_body(name=kind, gravcomp=1.0)
    rod = 0.08 if kind == "plate" else 0.12
    tool.add_geom(
        name=f"{kind}_rod",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=(0.0, 0.0, 0.0, 0.0, 0.0, rod),
        size=(0.01, 0.0, 0.0),
        mass=0.1,
        rgba=_TOOL_RGBA,
    )
    if kind == "plate":
        tip, shape, size = rod + 0.16, _BOX, (0.06, 0.005, 0.08)
    else:
        ball = (BALL_RADIUS_M, 0.0, 0.0)
        tip, shape, size = rod + 2.0 * BALL_RADIUS_M, mujoco.mjtGeom.mjGEOM_SPHERE, ball
    centre = (0.0, 0.0, (rod + tip) / 2)
    tool.add_geom(name=kind, type=shape, size=size, pos=centre, mass=0.15, rgba=_TOOL_RGBA)
    tool.add_site(name=END_EFFECTOR_SITE, pos=(0.0, 0.0, tip))


def add_basket(spec: mujoco.MjSpec) -> None:
    """Adds the basket in front of the base: a flat floor and four walls that slope outwards."""
    basket = spec.worldbody.add_body(name="basket", pos=numbers.BASKET_XYZ)
    basket.add_geom(
        name="basket_floor",
        type=_BOX,
        size=numbers.BASKET_FLOOR,
        pos=(0.0, 0.0, -numbers.BASKET_FLOOR[2]),
        mass=0.0,
        rgba=_BASKET_RGBA,
    )
    for number in range(4):
        # The wall's frame: turned about the vertical, then its outer edge lifted.
        turn, lift = number * math.pi / 4, -numbers.BASKET_SLOPE / 2
        cos_turn, sin_turn, cos_lift, sin_lift = (
            math.cos(turn),
            math.sin(turn),
            math.cos(lift),
            math.sin(lift),
        )
        basket.add_geom(
            name=f"basket_wall_{number}",
            type=_BOX,
            size=numbers.BASKET_WALL,
            pos=(
                numbers.BASKET_WALL_OFFSET * math.cos(2 * turn),
                numbers.BASKET_WALL_OFFSET * math.sin(2 * turn),
                numbers.BASKET_WALL_HEIGHT,
            ),
            quat=(
                cos_turn * cos_lift,
                -sin_turn * sin_lift,
                cos_turn * sin_lift,
                sin_turn * cos_lift,
            ),
            mass=0.0,
            rgba=_BASKET_RGBA,
        )


def furnish(spec: mujoco.MjSpec, end_effector: EndEffector, free_object: FreeObject) -> None:
    """Adds what a bare arm lacks of the cell: tool, basket, object; in place.

    What already has an object is left as it is. Keyframes go: they know nothing of the object.

    Raises:
        ConfigError: there is no body `right_hand` to mount the tool on.
    """
    if spec.body(OBJECT_BODY) is not None:
        return
    hand = spec.body(HAND_BODY)
    if hand is None:
        raise ConfigError(
            f"model {spec.modelname!r} has neither a body {OBJECT_BODY!r} nor a body "
            f"{HAND_BODY!r} to mount a {end_effector} on"
        )
    for key in list(spec.keys):
        spec.delete(key)
    if (site := spec.site(END_EFFECTOR_SITE)) is not None:
        spec.delete(site)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # see sawyer_spec
    add_end_effector(hand, end_effector)
    add_basket(spec)
    add_object(spec, free_object)


def object_rest_position(kind: FreeObject) -> tuple[float, float, float]:
    """Returns where the object's frame is when it rests at the basket's centre, base frame, m."""
    x, y, z = numbers.BASKET_XYZ
    return (x, y, z + _REST_HEIGHT[kind])


def object_boxes(kind: FreeObject) -> tuple[Box, ...]:
    """Returns the boxes that an object is made of."""
    return _BRICK_BOXES if kind == "brick" else TEE_BOXES


def add_object(spec: mujoco.MjSpec, kind: FreeObject) -> None:
    """Adds the free body `object` at the basket's centre: a brick, or a tee that shows its yaw."""
    body = spec.worldbody.add_body(name=OBJECT_BODY, pos=object_rest_position(kind))
    body.add_freejoint(name=OBJECT_BODY)
    boxes = object_boxes(kind)
    for number, (half, position) in enumerate(boxes):
        body.add_geom(
            name=f"{kind}_{number}",
            type=_BOX,
            size=half,
            pos=position,
            mass=_OBJECT_MASS / len(boxes),
            friction=_OBJECT_FRICTION,
            priority=1,  # else the larger friction of the two counts, and theirs is MuJoCo's 1
            rgba=_OBJECT_RGBA,
        )
