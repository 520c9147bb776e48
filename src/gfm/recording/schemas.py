"""Topics and ROS 2 message definitions of a recording.

The definitions are the texts of ROS 2's common_interfaces with their dependencies appended, as
the MCAP registry asks for schema encoding `ros2msg`.
"""

from __future__ import annotations

JOINT_STATES = "/joint_states"
COMMAND = "/joint_command"
REQUESTED = "/joint_command_requested"
REASON = "/joint_command_reason"
OBJECT_POSE = "/object_pose"

#: MCAP metadata records that carry what a topic cannot.
ABOUT_RECORD = "gfm"
SERVO_GAIN_RECORD = "gfm.servo_gain"

JOINT_STATE_TYPE = "sensor_msgs/msg/JointState"
POSE_TYPE = "geometry_msgs/msg/PoseStamped"
REASON_TYPE = "std_msgs/msg/UInt32"

_SEPARATOR = "=" * 80

_HEADER = f"""{_SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""

JOINT_STATE = f"""std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
{_HEADER}"""

REASON_MASK = "uint32 data\n"

POSE = f"""std_msgs/Header header
geometry_msgs/Pose pose
{_SEPARATOR}
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
{_SEPARATOR}
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
{_SEPARATOR}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{_HEADER}"""
