"""Drives go by the name of the joint that they drive; files of others may call them otherwise.

What a drive was called is kept with it, so that a model is written as it was read.
"""

from __future__ import annotations

from collections import Counter

import mujoco

from gfm.effects.effect import MOTOR_SIDE
from gfm.effects.elements import NO_INPUT

#: MjsActuator.info of a drive that has another name here than in its file begins so.
_CALLED = "gfm: called "


def name_after_joints(spec: mujoco.MjSpec) -> dict[str, str]:
    """Calls every drive as its joint; returns what those were called that had another name.

    A drive takes commands and acts on one joint, or on its motor side. Where a joint has several,
    or something else has its name, they stay as they are.

    Returns:
        Names in the file, by joint.
    """
    actuators = list(spec.actuators)
    driven = [_driven(spec, one) for one in actuators]
    drives, taken = Counter(driven), {one.name for one in actuators}
    called = {}
    for one, joint in zip(actuators, driven, strict=True):
        if joint is not None and drives[joint] == 1 and joint not in taken:
            called[joint] = one.name
            one.info = f"{_CALLED}{one.name}"
            _rename(spec, one, joint)
    return called


def name_as_found(spec: mujoco.MjSpec) -> None:
    """Gives drives the names back that they had before `name_after_joints`."""
    for one in spec.actuators:
        if one.info.startswith(_CALLED):
            _rename(spec, one, one.info.removeprefix(_CALLED))
            one.info = ""


def driven_joints(model: mujoco.MjModel) -> tuple[str, ...]:
    """Returns the joints that have a drive, in the order of the drives."""
    joints = {model.joint(i).name for i in range(model.njnt)}
    commanded = [i for i in range(model.nactuator) if model.actuator_ctrlnum[i]]
    return tuple(name for i in commanded if (name := model.actuator(i).name) in joints)


def _driven(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> str | None:
    """Returns the joint that an actuator drives; None where it is no drive."""
    on_joint = actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT
    if not on_joint or actuator.ctrlspec == NO_INPUT:
        return None
    target = str(actuator.target)
    link = target.removesuffix(MOTOR_SIDE)
    return link if link in {joint.name for joint in spec.joints} else target


def _rename(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator, name: str) -> None:
    for sensor in spec.sensors:
        if sensor.objtype == mujoco.mjtObj.mjOBJ_ACTUATOR and sensor.objname == actuator.name:
            sensor.objname = name
    actuator.name = name
