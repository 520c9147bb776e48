"""What recordings hold beside reports and commands: all of it is for people and their viewers."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gfm.core.checks import Array
from gfm.recording.scene import Scene, sawyer_scene
from gfm.sim.sawyer import JOINT_NAMES
from gfm_robot_bridge.config import BridgeConfig
from gfm_robot_bridge.limits import Limits
from gfm_robot_bridge.robot import Robot
from gfm_wire import RobotClock


@dataclass(frozen=True, kw_only=True)
class Content:
    """What to add.

    Attributes:
        scene: The arm's frames and its description; None for an arm without a model.
        covariance: Of an object's pose: x, y, z and the turns about them, m and rad, shape (6, 6);
            None where it is not known.
        timed: Whether the bridge's own times mean anything.
        limits: Of each joint, as JSON.
    """

    scene: Scene | None = None
    covariance: Array | None = None
    timed: bool = False
    limits: Mapping[str, str] = field(default_factory=dict)


def content_of(config: BridgeConfig, robot: Robot) -> Content:
    """Returns what the recordings of a robot hold."""
    spread = np.repeat([config.object_spread_m, config.object_spread_rad], 3)
    return Content(
        scene=_scene(robot) if robot.joint_names == JOINT_NAMES else None,
        covariance=np.diag(spread**2),
        timed=config.clock == RobotClock.WALL,
        limits=_words(robot.joint_names, robot.limits),
    )


def _scene(robot: Robot) -> Scene:
    limits = robot.limits
    return sawyer_scene(robot.joint_names, limits.velocity, limits.effort)


def _words(joint_names: tuple[str, ...], limits: Limits) -> dict[str, str]:
    """Returns what the robot itself allows, by joint: rad, rad/s, rad/s^2, N m."""
    fields = {
        "lower_rad": limits.lower,
        "upper_rad": limits.upper,
        "velocity_rad_s": limits.velocity,
        "acceleration_rad_s2": limits.acceleration,
        "effort_nm": limits.effort,
    }
    return {
        name: json.dumps({key: float(values[j]) for key, values in fields.items()})
        for j, name in enumerate(joint_names)
    }
