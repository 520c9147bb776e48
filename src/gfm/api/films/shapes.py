"""Models made ready to be drawn: a light sky, and sticks where a robot has no shapes."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from gfm.api.films.view import FOVY

#: Thickness of sticks, in shares of the longest one, and the least length of one, m.
_THICK, _SHORTEST_M = 0.06, 1e-3


def drawable(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Returns a model under a light sky: pages are white, and many models have none.

    A robot without shapes (a URDF whose meshes are not there; a model of inertias) gets a stick
    from each joint to the next, and to the centre of mass of what is last.
    """
    copy = spec.copy()
    if all(one.type != mujoco.mjtTexture.mjTEXTURE_SKYBOX for one in copy.textures):
        copy.add_texture(
            name="gfm_sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
            rgb1=(0.96, 0.97, 0.98),
            width=8,
            height=8,
        )
    copy.visual.headlight.ambient = (0.4, 0.4, 0.4)
    copy.visual.global_.fovy = FOVY
    model = copy.compile()
    if model.body_weldid[model.geom_bodyid].any():
        return model
    _add_sticks(copy, model)
    return copy.compile()


def _add_sticks(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Adds a stick to every body for each of its children, in its frame, m."""
    bodies = [spec.body(model.body(i).name) if i else spec.worldbody for i in range(model.nbody)]
    ends: list[tuple[int, Sequence[float]]] = [
        (int(model.body_parentid[i]), model.body_pos[i]) for i in range(1, model.nbody)
    ]
    parents = {body for body, _ in ends}
    ends += [(i, model.body_ipos[i]) for i in range(1, model.nbody) if i not in parents]
    longest = max((float(np.linalg.norm(end)) for _, end in ends), default=0.0)
    for body, end in ends:
        if np.linalg.norm(end) > _SHORTEST_M:
            bodies[body].add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=(0.0, 0.0, 0.0, *end),
                size=(_THICK * longest, 0.0, 0.0),
                mass=0.0,
            )
