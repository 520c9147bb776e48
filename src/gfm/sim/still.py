"""What a model drives beside the recorded joints (a gripper, another arm): it stands still."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import mujoco

from gfm.effects.effect import MOTOR_SIDE
from gfm.sim.layout import SCALAR

_OF_BODIES = (mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtEq.mjEQ_WELD)


def unrecorded(spec: mujoco.MjSpec, joints: Sequence[str]) -> dict[str, float]:
    """Returns where joints are by default that are driven, or coupled to such, and not recorded.

    None where one of them is coupled to a recorded joint, which then moves it.

    Args:
        spec: With all joints.
        joints: The recorded ones.

    Returns:
        rad or m, by joint.
    """
    couplings = [*_in_tendons(spec), *_in_equalities(spec)]
    found = {name for name in _driven(spec) if name not in _with_motors(joints)}
    before = -1
    while len(found) > before:
        before = len(found)
        found.update(*(one for one in couplings if found & one))
    if not found or found & _with_motors(joints):
        return {}
    model = spec.copy().compile()
    at = {model.joint(i).name: float(model.qpos0[model.jnt_qposadr[i]]) for i in range(model.njnt)}
    return {name: position for name, position in at.items() if name in found}


def with_still_joints(spec: mujoco.MjSpec, names: Iterable[str]) -> mujoco.MjSpec:
    """Returns a copy in which joints are fixed where they are by default, without their drives.

    Keyframes and sensors, which may refer to them, are left out.
    """
    names, still = set(names), spec.copy()
    if not names:
        return still
    tendons = zip(still.tendons, _in_tendons(still), strict=True)
    equalities = zip(still.equalities, _in_equalities(still), strict=True)
    gone = [
        *still.keys,
        *still.sensors,
        *(one for one in still.actuators if _joints_of(still, one) & names),
        *(one for one, coupled in equalities if coupled & names),
        *(one for one, wrapped in tendons if wrapped & names),
        *(one for one in still.joints if one.name in names),
    ]
    for one in gone:
        still.delete(one)
    return still


def moved_by_actuators(spec: mujoco.MjSpec) -> set[str]:
    """Returns the joints that an actuator moves: directly, by a tendon, or as another one moves.

    A joint that an equality makes follow another one (of URDF: a mimic joint) counts, whatever
    moves the other: an actuator of its own would work against that.
    """
    equalities = zip(spec.equalities, _in_equalities(spec), strict=True)
    joint = mujoco.mjtEq.mjEQ_JOINT
    followers = {str(one.name1) for one, two in equalities if one.type == joint and len(two) == 2}
    return _driven(spec) | followers


def _with_motors(joints: Sequence[str]) -> set[str]:
    return {side for name in joints for side in (name, name + MOTOR_SIDE)}


def _driven(spec: mujoco.MjSpec) -> set[str]:
    """Returns the hinges and slides that an actuator acts on."""
    return {name for one in spec.actuators for name in _joints_of(spec, one)}


def _joints_of(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> set[str]:
    scalar = {joint.name for joint in spec.joints if joint.type in SCALAR}
    if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
        wrapped = zip(spec.tendons, _in_tendons(spec), strict=True)
        return next((w & scalar for one, w in wrapped if one.name == actuator.target), set())
    return {str(actuator.target)} & scalar


def _in_tendons(spec: mujoco.MjSpec) -> list[set[str]]:
    """Returns the joints that each tendon wraps."""
    joint = mujoco.mjtWrap.mjWRAP_JOINT
    return [
        {str(wrap.target.name) for wrap in one.path if wrap.type == joint} for one in spec.tendons
    ]


def _in_equalities(spec: mujoco.MjSpec) -> list[set[str]]:
    """Returns the joints that each equality constraint couples."""
    return [_coupled(spec, one) for one in spec.equalities]


def _coupled(spec: mujoco.MjSpec, equality: mujoco.MjsEquality) -> set[str]:
    named = [str(name) for name in (equality.name1, equality.name2) if name]
    if equality.type == mujoco.mjtEq.mjEQ_JOINT:
        return set(named)
    if equality.type in _OF_BODIES and equality.objtype == mujoco.mjtObj.mjOBJ_BODY:
        return {str(j.name) for name in named for j in spec.body(name).joints}
    return set()
