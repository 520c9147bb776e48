"""Topics and ROS 2 message definitions of a recording.

The definitions are the texts of ROS 2's common_interfaces and geometry2 with their dependencies
appended, as the MCAP registry asks for schema encoding `ros2msg`.
"""

from __future__ import annotations

from typing import NamedTuple

JOINT_STATES = "/joint_states"
COMMAND = "/joint_command"
REQUESTED = "/joint_command_requested"
REASON = "/joint_command_reason"
OBJECT_POSE = "/object_pose"
OBJECT_POSE_SPREAD = "/object_pose_with_covariance"
#: Before those two: what one camera says alone.
CAMERA = "/camera/{}"
FRAMES = "/tf"
FIXED_FRAMES = "/tf_static"
DESCRIPTION = "/robot_description"

#: MCAP metadata records that carry what a topic cannot.
ABOUT_RECORD = "gfm"
SERVO_GAIN_RECORD = "gfm.servo_gain"
LIMITS_RECORD = "gfm.limits"


class MessageType(NamedTuple):
    """A type of message: its name, and its definition in ros2msg."""

    name: str
    definition: str


_SEPARATOR = "=" * 80

HEADER = f"""{_SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

_QUATERNION = f"""{_SEPARATOR}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""

_POSE = f"""{_SEPARATOR}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_SEPARATOR}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_QUATERNION}"""

JOINT_STATE = MessageType(
    "sensor_msgs/msg/JointState",
    f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{HEADER}""",
)

REASON_MASK = MessageType("std_msgs/msg/UInt32", "uint32 data\n")

TEXT = MessageType("std_msgs/msg/String", "string data\n")

POSE = MessageType(
    "geometry_msgs/msg/PoseStamped",
    f"""std_msgs/Header header
geometry_msgs/Pose pose
{_POSE}{HEADER}""",
)

POSE_SPREAD = MessageType(
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    f"""std_msgs/Header header
geometry_msgs/PoseWithCovariance pose
{_SEPARATOR}
MSG: geometry_msgs/PoseWithCovariance
geometry_msgs/Pose pose
float64[36] covariance
{_POSE}{HEADER}""",
)

TRANSFORMS = MessageType(
    "tf2_msgs/msg/TFMessage",
    f"""geometry_msgs/TransformStamped[] transforms
{_SEPARATOR}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{_SEPARATOR}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{_SEPARATOR}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_QUATERNION}{HEADER}""",
)
