"""What the simulated robot has in its hand and in front of it: tool, basket, free object.

Sizes and masses are those of the published cell. How things touch is not: contacts are stiffer,
their friction is a cone, and the object's own friction, mass and centre may be others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum

import mujoco
import numpy as np

from gfm.core import CommandKind
from gfm.sim.cell import OBJECT_BODY, EndEffector, FreeObject
from gfm.sim.sawyer import JOINT_NAMES, hang_payload, sawyer_spec
from gfm_robot_bridge.simulated.hidden import HiddenEffect
from gfm_wire import SetPayload

#: How contacts give way: time constant, s, and damping ratio; impedance, from first touch to a
#: depth in m; and how much harder friction holds than the surfaces are pressed together.
_SOLREF, _SOLIMP, _IMPRATIO = (0.006, 1.0), (0.95, 0.99, 0.0005, 0.5, 2.0), 20.0
#: Against which the contacts' time constant is checked; the robot's own steps are no longer.
_STEP_S = 5e-4
#: What is left of a mass or a friction from which more was taken off than there is.
_LEAST = 1e-3
_GRAVITY = 9.81


class Cell(StrEnum):
    """For which task the cell is furnished."""

    NONE = "none"
    POSITION = "position"
    POSE = "pose"

    @property
    def tool(self) -> EndEffector:
        """What is mounted."""
        return _TOOLS[self]


_TOOLS: dict[Cell, EndEffector] = {Cell.NONE: "none", Cell.POSITION: "plate", Cell.POSE: "ball"}
TOOL_BODIES = ("plate", "ball")
_OBJECTS: dict[Cell, FreeObject] = {Cell.POSITION: "brick", Cell.POSE: "tee"}


def cell_spec(cell: Cell, *, bare: bool = False) -> mujoco.MjSpec:
    """Returns arm and cell without drives, gravity compensation or keyframes.

    Args:
        cell: For which task it is furnished.
        bare: Whether there is the tool alone, and nothing to push with it.
    """
    thing = None if bare else _OBJECTS.get(cell)
    spec = sawyer_spec(command=CommandKind.EFFORT, end_effector=cell.tool, free_object=thing)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for key in list(spec.keys):
        spec.delete(key)
    for body in spec.bodies:
        body.gravcomp = 0.0
    if thing is None:
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        return spec
    spec.body(OBJECT_BODY).simple = 0  # its centre of mass may be moved later
    spec.option.timestep = _STEP_S
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = _IMPRATIO
    for geom in spec.geoms:
        geom.solref, geom.solimp = _SOLREF, _SOLIMP
    return spec


def known_model(cell: Cell, payload: SetPayload | None = None) -> mujoco.MjModel:
    """Returns the compiled arm as its controller knows it: upright, with its tool and a payload.

    Args:
        cell: Which tool is mounted.
        payload: What the controller was told of; None for nothing.
    """
    spec = cell_spec(cell, bare=True)
    if payload is not None:
        hang_payload(spec, payload.mass_kg, payload.com_m)
    return spec.compile()


def cell_model(cell: Cell, effects: Sequence[HiddenEffect] = ()) -> mujoco.MjModel:
    """Returns the compiled cell, without drives; with the effects that are inertia or gravity.

    Args:
        cell: For which task it is furnished.
        effects: What is hidden.
    """
    spec = cell_spec(cell)
    for effect in effects:
        values = effect.parameters
        match effect.effect:
            case "payload":
                where = np.array([values["com_x"], values["com_y"], values["com_z"]])
                hang_payload(spec, values["mass"], where)
            case "gravity_direction":
                spec.option.gravity = _gravity(values["tilt_x"], values["tilt_y"])
            case "armature":
                spec.joint(JOINT_NAMES[effect.joints[0]]).armature += values["inertia"]
    model = spec.compile()
    _add_hidden(model, effects)
    return model


def _gravity(tilt_x: float, tilt_y: float) -> list[float]:
    return [
        -_GRAVITY * math.cos(tilt_x) * math.sin(tilt_y),
        _GRAVITY * math.sin(tilt_x),
        -_GRAVITY * math.cos(tilt_x) * math.cos(tilt_y),
    ]


def _add_hidden(model: mujoco.MjModel, effects: Sequence[HiddenEffect]) -> None:
    """Changes a compiled cell by what the object and the tool's mounting hide; in place."""
    for effect in effects:
        values = effect.parameters
        match effect.effect:
            case "object_friction":
                own = _object_geoms(model)
                changed = model.geom_friction[own, 0] + values["coefficient"]
                model.geom_friction[own, 0] = np.maximum(changed, _LEAST)
            case "object_mass":
                body = model.body(OBJECT_BODY).id
                heavier = max(model.body_mass[body] + values["mass"], _LEAST)
                model.body_inertia[body] *= heavier / model.body_mass[body]
                model.body_mass[body] = heavier
            case "object_com":
                place = [values["x"], values["y"], values["z"]]
                model.body_ipos[model.body(OBJECT_BODY).id] += place
            case "tool_offset":
                bodies = [model.body(i) for i in range(model.nbody)]
                tool = next(body.id for body in bodies if body.name in TOOL_BODIES)
                model.body_pos[tool] += [values["x"], values["y"], 0.0]
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _object_geoms(model: mujoco.MjModel) -> np.ndarray:
    return np.flatnonzero(model.geom_bodyid == model.body(OBJECT_BODY).id)
