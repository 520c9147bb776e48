"""What a case hides, as it is written for whoever judges."""

from __future__ import annotations

from collections.abc import Mapping

from known_truth.amounts import Hidden
from known_truth.draft import Draft
from known_truth.robots import Robot


def truth(one: Draft) -> dict[str, object]:
    """Returns what a case hides, as it is written for whoever judges."""
    names = one.robot.joints
    return {
        "name": one.plan.name,
        "setup": one.plan.setup.name,
        "category": one.plan.category,
        "excitation": one.plan.excitation,
        "seed": one.plan.seed,
        "noise": one.sensors.position_std,
        "effects": [
            {
                "effect": hidden.effect,
                "joints": [names[j] for j in hidden.joints],
                "parameters": dict(hidden.parameters),
                "signal": signal,
                "equals": [
                    {"effect": effect, "joints": [names[j] for j in joints]}
                    for effect, joints in equals(one.robot, hidden)
                ],
                "unseen": unseen(one.robot, hidden),
            }
            for hidden, signal in zip(one.found, one.signals, strict=True)
        ],
    }


def equals(robot: Robot, hidden: Hidden) -> list[tuple[str, tuple[int, ...]]]:
    """Returns what physics cannot tell from a hidden effect."""
    same: Mapping[str, str] = {
        "asymmetric_friction": "torque_offset",
        "torque_offset": "asymmetric_friction",
    }
    if hidden.effect in same:
        return [(same[hidden.effect], hidden.joints)]
    if robot.planar and hidden.effect == "gravity_direction":
        return [("encoder_offset", (0,))]
    if robot.planar and hidden.effect == "encoder_offset" and hidden.joints == (0,):
        return [("gravity_direction", ())]
    return []


def unseen(robot: Robot, hidden: Hidden) -> list[str]:
    """Returns parameters that no motion of the robot shows."""
    if robot.planar and hidden.effect == "gravity_direction":
        return ["tilt_x"]
    return ["com_y"] if robot.planar and hidden.effect == "payload" else []
