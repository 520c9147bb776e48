"""Intera's topics, parameters and modes, by name; both ends of the line know them from here."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Topic:
    """A ROS topic.

    Attributes:
        name: Absolute.
        type: Of its messages.
    """

    name: str
    type: str


_ARM = "/robot/limb/right"

JOINT_STATES = Topic("/robot/joint_states", "sensor_msgs/JointState")
STATE = Topic("/robot/state", "intera_core_msgs/RobotAssemblyState")
JOINT_LIMITS = Topic("/robot/joint_limits", "intera_core_msgs/JointLimits")
SUBSCRIBED = (JOINT_STATES, STATE, JOINT_LIMITS)
"""What the robot says."""

JOINT_COMMAND = Topic(f"{_ARM}/joint_command", "intera_core_msgs/JointCommand")
COMMAND_TIMEOUT = Topic(f"{_ARM}/joint_command_timeout", "std_msgs/Float64")
SPEED_RATIO = Topic(f"{_ARM}/set_speed_ratio", "std_msgs/Float64")
ENABLE = Topic("/robot/set_super_enable", "std_msgs/Bool")
STOP = Topic("/robot/set_super_stop", "std_msgs/Empty")
RESET = Topic("/robot/set_super_reset", "std_msgs/Empty")
URDF = Topic("/robot/urdf", "intera_core_msgs/URDFConfiguration")
ADVERTISED = (JOINT_COMMAND, COMMAND_TIMEOUT, SPEED_RATIO, ENABLE, STOP, RESET, URDF)
"""What it is told."""

GET_PARAM = "/rosapi/get_param"
"""The service that reads parameters."""

VERSION_PARAM = "/manifest/robot_software/version/HLR_VERSION_STRING"
"""The parameter that holds the version of the robot's software."""

POSITION_MODE, VELOCITY_MODE, TORQUE_MODE = 1, 2, 3
