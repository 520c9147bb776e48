"""A model's arm as URDF, for viewers: links, hinges, inertias and simple shapes; no drives.

Limits of speed and effort are no part of an MjModel: they are given, or 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from xml.etree import ElementTree as Xml

import mujoco
import numpy as np

from gfm.core import ConfigError
from gfm.core.checks import Array

_SHAPES = mujoco.mjtGeom
_HINGE = int(mujoco.mjtJoint.mjJNT_HINGE)


def urdf(
    model: mujoco.MjModel,
    *,
    root: str,
    speeds: Mapping[str, float] | None = None,
    efforts: Mapping[str, float] | None = None,
) -> str:
    """Returns URDF of a model whose joints are hinges.

    Planes, meshes and other shapes that URDF has no word for are left out; a capsule becomes a
    cylinder and two spheres.

    Args:
        model: At most one hinge in a body, through the body's origin.
        root: Name of the link that stands for the world.
        speeds: Limits by joint, rad/s.
        efforts: The same, N m.

    Raises:
        ConfigError: a joint is none that URDF can say.
    """
    robot = Xml.Element("robot", name=root)
    Xml.SubElement(robot, "link", name=root)
    for body in range(1, model.nbody):
        robot.append(_link(model, body))
        robot.append(_joint(model, body, root, speeds or {}, efforts or {}))
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode") + "\n"


def _link(model: mujoco.MjModel, body: int) -> Xml.Element:
    link = Xml.Element("link", name=model.body(body).name)
    if model.body_mass[body] > 0.0:
        inertial = Xml.SubElement(link, "inertial")
        inertial.append(_origin(model.body_ipos[body], model.body_iquat[body]))
        Xml.SubElement(inertial, "mass", value=_words(model.body_mass[body]))
        ixx, iyy, izz = (_words(value) for value in model.body_inertia[body])
        moments = {"ixx": ixx, "iyy": iyy, "izz": izz, "ixy": "0", "ixz": "0", "iyz": "0"}
        Xml.SubElement(inertial, "inertia", moments)
    for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
        for position, shape in _shapes(model, geom):
            visual = Xml.SubElement(link, "visual")
            visual.append(_origin(position, model.geom_quat[geom]))
            Xml.SubElement(visual, "geometry").append(shape)
            material = Xml.SubElement(visual, "material", name=f"colour_{geom}")
            Xml.SubElement(material, "color", rgba=_words(*model.geom_rgba[geom]))
    return link


def _joint(
    model: mujoco.MjModel,
    body: int,
    root: str,
    speeds: Mapping[str, float],
    efforts: Mapping[str, float],
) -> Xml.Element:
    """Returns the joint that carries a body."""
    child, first = model.body(body).name, int(model.body_jntadr[body])
    moves = first >= 0
    if moves:
        _check(model, body, first)
    name = model.joint(first).name if moves else f"{child}_fixed"
    limited = moves and bool(model.jnt_limited[first])
    kind = ("revolute" if limited else "continuous") if moves else "fixed"
    joint = Xml.Element("joint", name=name, type=kind)
    joint.append(_origin(model.body_pos[body], model.body_quat[body]))
    parent = int(model.body_parentid[body])
    Xml.SubElement(joint, "parent", link=model.body(parent).name if parent else root)
    Xml.SubElement(joint, "child", link=child)
    if moves:
        Xml.SubElement(joint, "axis", xyz=_words(*model.jnt_axis[first]))
        limits = {"velocity": _words(speeds.get(name, 0.0)), "effort": _words(efforts.get(name, 0))}
        if limited:
            lower, upper = model.jnt_range[first]
            limits |= {"lower": _words(lower), "upper": _words(upper)}
        Xml.SubElement(joint, "limit", limits)
    return joint


def _check(model: mujoco.MjModel, body: int, joint: int) -> None:
    hinge = model.body_jntnum[body] == 1 and model.jnt_type[joint] == _HINGE
    if not hinge or np.any(model.jnt_pos[joint]):
        name = model.body(body).name
        raise ConfigError(f"body {name}: expected at most one hinge, through the body's origin")


def _shapes(model: mujoco.MjModel, geom: int) -> Iterator[tuple[Array, Xml.Element]]:
    """Yields the shapes of one geom and where their middles are, in the body."""
    middle, (radius, half, _) = model.geom_pos[geom], model.geom_size[geom]
    match int(model.geom_type[geom]):
        case _SHAPES.mjGEOM_BOX:
            yield middle, Xml.Element("box", size=_words(*2.0 * model.geom_size[geom]))
        case _SHAPES.mjGEOM_SPHERE:
            yield middle, Xml.Element("sphere", radius=_words(radius))
        case _SHAPES.mjGEOM_CYLINDER | _SHAPES.mjGEOM_CAPSULE as kind:
            yield middle, Xml.Element("cylinder", radius=_words(radius), length=_words(2.0 * half))
            if kind == _SHAPES.mjGEOM_CAPSULE:
                along = _matrix(model.geom_quat[geom])[:, 2] * half
                for end in (middle - along, middle + along):
                    yield end, Xml.Element("sphere", radius=_words(radius))


def _origin(position: Array, quaternion: Array) -> Xml.Element:
    return Xml.Element("origin", xyz=_words(*position), rpy=_words(*_rpy(quaternion)))


def _rpy(quaternion: Array) -> tuple[float, float, float]:
    """Returns roll, pitch, yaw about fixed axes; where pitch is a right angle, roll is 0."""
    turn = _matrix(quaternion)
    level = math.hypot(turn[0, 0], turn[1, 0])
    pitch = math.atan2(-turn[2, 0], level)
    if level < 1e-9:
        return 0.0, pitch, math.atan2(-turn[0, 1], turn[1, 1])
    return math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])


def _matrix(quaternion: Array) -> Array:
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    return turn.reshape(3, 3)


def _words(*values: float) -> str:
    # Without what rounding leaves of zeros, and their signs.
    return " ".join(f"{round(float(value), 12) + 0.0:.12g}" for value in values)
