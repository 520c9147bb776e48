"""The guard of the Sawyer arm, by its published model and that of its cell."""

from __future__ import annotations

import numpy as np

from gfm.core import CommandKind
from gfm.sim.cell import EndEffector
from gfm.sim.sawyer import JOINT_NAMES, sawyer_spec
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.foresight import Foresight
from gfm_robot_bridge.guard import Guard
from gfm_robot_bridge.robot import Robot
from gfm_robot_bridge.surroundings import Surroundings, guarded_model

#: What is mounted for a task; where there is a tool, the basket stands there.
TOOLS: dict[str, EndEffector] = {"none": "none", "position": "plate", "pose": "ball"}
#: From the moment of a report until a command that was decided by it acts, s.
_LATE_S = 0.015


def sawyer_guard(config: BridgeConfig, robot: Robot) -> Guard:
    """Returns what keeps a Sawyer away from its cell and from itself.

    The pushed object is none of it: to touch that is the task.

    Args:
        config: Says which task the cell is furnished for, the distances, and what the joints
            report at zero.
        robot: A Sawyer.
    """
    tool = TOOLS[config.task]
    specs = {
        kind: sawyer_spec(command=kind, end_effector=tool, basket=tool != "none")
        for kind in CommandKind
    }
    zeros = config.joint_zero_rad or np.zeros(len(JOINT_NAMES))
    for spec in specs.values():
        for joint, zero in zip(JOINT_NAMES, zeros, strict=True):
            spec.joint(joint).ref = zero
    bounds = config.bounds(robot.limits, robot.patience_s)
    foresight = Foresight(
        {kind: spec.compile() for kind, spec in specs.items()},
        bounds.braking,
        bounds.acceleration,
        next_s=config.period_ns * 1e-9 + _LATE_S,
        patience_s=bounds.patience_s + _LATE_S,
    )
    model = guarded_model(specs[CommandKind.EFFORT], config.workspace_m)
    return Guard(Surroundings(model), foresight, config.clearance_m)
