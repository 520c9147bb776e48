"""What the robot runs into."""

from __future__ import annotations

from collections.abc import Sequence
from typing import final

import mujoco
from typing_extensions import override

from gfm.effects.effect import (
    Effect,
    Parameter,
    ProbeGroup,
    Scales,
    Scope,
    Values,
    find_joint,
    free_name,
)
from gfm.effects.elements import HOLDING_SOLREF

#: Radius of the ball around the point that touches, m: the plane is so much lower.
POINT_M = 1e-3
#: Impedance of a surface that does not give way.
FIRM_SOLIMP = (0.99, 0.999, 0.001)
#: Sliding friction with which a surface is looked for at first.
USUAL_FRICTION = 0.3
#: Share of a probe's response from which on it looks like the surface.
ALIKE = 0.2


@final
class SurfaceContact(Effect):
    """A point of the last link runs onto a level surface, a table for instance.

    Native: a plane and a small ball that collide with each other and with nothing else, as hard as
    the time step allows. Of the height and the point, motions tell only what they change: while the
    link keeps its attitude, a point further out touches a surface further down.
    """

    name = "surface_contact"
    abrupt = True
    scope = Scope.LAST
    intermittent = True
    parameters = (
        Parameter(name="height", unit="m", lower=-10.0, upper=10.0),
        Parameter(name="x", unit="m", lower=-2.0, upper=2.0),
        Parameter(name="y", unit="m", lower=-2.0, upper=2.0),
        Parameter(name="z", unit="m", lower=-2.0, upper=2.0),
        Parameter(name="friction", unit="1", lower=0.0, upper=3.0),
    )
    valleys = ("x", "y", "z")
    shown_by = "slow motion down to the surface, in several attitudes of the last link"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        spec.option.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        plane = spec.worldbody.add_geom(
            name=free_name(spec.geoms, "surface"),
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0.0, 0.0, 0.1],
            pos=[0.0, 0.0, values["height"] - POINT_M],
        )
        point = find_joint(spec, joints[0]).parent.add_geom(
            name=free_name(spec.geoms, "surface_point"),
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[POINT_M, 0.0, 0.0],
            pos=[values["x"], values["y"], values["z"]],
            mass=0.0,
        )
        for geom in (plane, point):
            geom.contype = geom.conaffinity = 0
        pair = spec.add_pair(
            name=free_name(spec.pairs, "surface"), geomname1=plane.name, geomname2=point.name
        )
        pair.condim = 3
        pair.friction[0:2] = values["friction"]
        pair.solref, pair.solimp[0:3] = HOLDING_SOLREF, FIRM_SOLIMP

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        names = ("x", "y", "z", "height")
        return [
            [{**dict(zip(names, place, strict=True)), "friction": USUAL_FRICTION}]
            for place in scales.lowest_m
        ]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        # There is no half a surface: a probe either looks like it or does not.
        return dict(group[0]) if amplitudes[0] > ALIKE else None
