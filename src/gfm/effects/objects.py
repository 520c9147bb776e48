"""The free body that a robot pushes: how it slides, and what it weighs.

There is one such body in a model, and these effects name no joint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import final

import mujoco
import numpy as np
from typing_extensions import override

from gfm.core import ConfigError
from gfm.effects.effect import Effect, Parameter, ProbeGroup, Scales, Scope, Values, free_name
from gfm.effects.elements import add_passive_motor

#: What is left of a friction or a mass from which more was taken off than there is.
LEAST_FRICTION, LEAST_MASS_KG = 1e-4, 1e-4
#: Axes of a free joint: three along the world's, three about the body's.
AXES = tuple(np.eye(6))
AXIS_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")


def free_body(spec: mujoco.MjSpec) -> mujoco.MjsBody | None:
    """Returns the body on a free joint; None where there is none.

    Raises:
        ConfigError: there is more than one: whose pose is recorded is not known.
    """
    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if len(free) > 1:
        names = ", ".join(joint.parent.name or "(no name)" for joint in free)
        raise ConfigError(f"the model has {len(free)} free bodies ({names}), expected at most one")
    return free[0].parent if free else None


def _object(spec: mujoco.MjSpec, effect: Effect) -> mujoco.MjsBody:
    body = free_body(spec)
    if body is None:
        raise ConfigError(f"{effect.name}: the model has no free body (a body with a free joint)")
    return body


@final
class ObjectFriction(Effect):
    """The coefficient of sliding friction between the object and what it slides on."""

    name = "object_friction"
    abrupt = True
    scope = Scope.OBJECT
    parameters = (Parameter(name="coefficient", unit="1", lower=-5.0, upper=5.0),)
    confused_with = ("object_damping",)
    shown_by = "letting go of the object while it moves: sliding to rest, from several speeds"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        others = [g for g in _geoms_beside(spec.worldbody) if g.contype or g.conaffinity]
        for geom in _geoms(_object(spec, self)):
            _decide_alone(geom, others)
            geom.friction[0] = max(geom.friction[0] + values["coefficient"], LEAST_FRICTION)

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"coefficient": 0.05}]]


def _geoms(body: mujoco.MjsBody) -> Iterator[mujoco.MjsGeom]:
    yield from body.geoms
    for child in body.bodies:
        yield from _geoms(child)


def _geoms_beside(body: mujoco.MjsBody) -> Iterator[mujoco.MjsGeom]:
    """Yields the geoms of a body and what hangs on it, but for those of the object."""
    yield from body.geoms
    for child in body.bodies:
        if not any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in child.joints):
            yield from _geoms_beside(child)


def _decide_alone(geom: mujoco.MjsGeom, others: Sequence[mujoco.MjsGeom]) -> None:
    """Lets a geom alone decide the friction of its contacts, at what it is against fixed ones.

    In MuJoCo the geom of higher priority decides, of two equals the larger friction counts.
    """
    above = max((other.priority for other in others), default=geom.priority - 1)
    if geom.priority > above:
        return
    fixed = [o for o in others if _is_fixed(o.parent) and o.priority >= geom.priority]
    first = max((o.priority for o in fixed), default=geom.priority)
    decide = [o for o in fixed if o.priority == first]
    decide += [geom] if first == geom.priority else []
    if decide:
        geom.friction = np.max([one.friction for one in decide], axis=0)
        geom.condim = max(one.condim for one in decide)
    geom.priority = above + 1


def _is_fixed(body: mujoco.MjsBody) -> bool:
    while body is not None:
        if body.joints:
            return False
        body = body.parent
    return True


@final
class ObjectMass(Effect):
    """The object's mass; its inertia grows with it, its shape and centre stay."""

    name = "object_mass"
    abrupt = True
    scope = Scope.OBJECT
    parameters = (Parameter(name="mass", unit="kg", lower=-50.0, upper=50.0),)
    shown_by = "lifting the object, or pushing it, with measured joint torques"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        body = _object(spec, self)
        _say_inertia(spec, body, self)
        total = max(body.mass + values["mass"], LEAST_MASS_KG)
        body.inertia = np.asarray(body.inertia) * (total / body.mass)
        body.mass = total

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"mass": 0.02}]]


@final
class ObjectCom(Effect):
    """Where the object's centre of mass is, in its own frame."""

    name = "object_com"
    abrupt = True
    scope = Scope.OBJECT
    parameters = (
        Parameter(name="x", unit="m", lower=-1.0, upper=1.0),
        Parameter(name="y", unit="m", lower=-1.0, upper=1.0),
        Parameter(name="z", unit="m", lower=-1.0, upper=1.0),
    )
    shown_by = "letting go of the object while it turns, and pushes beside its middle"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        body = _object(spec, self)
        _say_inertia(spec, body, self)
        body.ipos = np.asarray(body.ipos) + np.array([values[axis] for axis in ("x", "y", "z")])

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        step = 0.002
        places = [(step, 0.0, 0.0), (0.0, step, 0.0), (0.0, 0.0, step)]
        return [[dict(zip(("x", "y", "z"), place, strict=True)) for place in places]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        names = ("x", "y", "z")
        total = {n: sum(a * p[n] for a, p in zip(amplitudes, group, strict=True)) for n in names}
        return total if self.admissible(total) else None


def _say_inertia(spec: mujoco.MjSpec, body: mujoco.MjsBody, effect: Effect) -> None:
    """Writes down the mass and inertia that MuJoCo would take from the body's geoms."""
    if body.explicitinertial:
        return
    copy = spec.copy()
    twin = _object(copy, effect)  # whose id is only right once it is compiled
    model = copy.compile()
    index = twin.id
    body.mass, body.inertia = float(model.body_mass[index]), model.body_inertia[index]
    body.ipos, body.iquat = model.body_ipos[index], model.body_iquat[index]
    body.explicitinertial = True


@final
class ObjectDamping(Effect):
    """A force against the object's velocity and a torque against its turning: grease, water.

    MuJoCo has one damping for all six axes of a free joint; here each has a motor without current,
    whose back EMF brakes.
    """

    name = "object_damping"
    abrupt = True
    scope = Scope.OBJECT
    parameters = (
        Parameter(name="linear", unit="N s/m", lower=0.0, upper=1e3),
        Parameter(name="angular", unit="N m s/rad", lower=0.0, upper=1e2),
    )
    confused_with = ("object_friction",)
    shown_by = "letting go of the object while it moves, at several speeds"

    @override
    def apply(self, spec: mujoco.MjSpec, joints: Sequence[str], values: Values) -> None:
        body = _object(spec, self)
        (joint,) = body.joints
        if not joint.name:
            joint.name = free_name(spec.joints, body.name or "object")
        for axis, name in zip(AXES, AXIS_NAMES, strict=True):
            amount = values["linear" if name in "xyz" else "angular"]
            motor = add_passive_motor(spec, joint.name, f"{joint.name}_damping_{name}")
            motor.gear = axis
            motor.gainprm[0:2] = [1.0, math.sqrt(amount)]  # resistance, motor constant

    @override
    def probes(self, scales: Scales) -> Sequence[ProbeGroup]:
        return [[{"linear": 0.05, "angular": 0.0}, {"linear": 0.0, "angular": 1e-4}]]

    @override
    def combine(self, group: ProbeGroup, amplitudes: Sequence[float]) -> dict[str, float] | None:
        names = ("linear", "angular")
        total = {n: sum(a * p[n] for a, p in zip(amplitudes, group, strict=True)) for n in names}
        return total if self.admissible(total) else None
