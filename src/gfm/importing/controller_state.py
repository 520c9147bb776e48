"""The state of ROS 2's joint trajectory controller, in bags that do not say how it is laid out.

Bags in sqlite3 of ROS 2 Humble and older hold no definitions, and `rosbags` knows only what ROS
itself defines. control_msgs has had three layouts; the size of a message tells which it has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from gfm.core.extras import needed
from gfm.importing.ros_messages import CONTROLLER_STATE

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

_POINT = "trajectory_msgs/JointTrajectoryPoint"
_SEVERAL_AXES = "trajectory_msgs/MultiDOFJointTrajectoryPoint"
_OLD, _NEW = ("desired", "actual"), ("reference", "feedback", "error", "output")


def _layout(points: Sequence[str], *, several_axes: bool) -> str:
    """Returns a definition: named joints, and their points; the same of joints with many axes."""
    lines = ["std_msgs/Header header", "string[] joint_names"]
    lines += [f"{_POINT} {name}" for name in points]
    if several_axes:
        lines += ["string[] multi_dof_joint_names"]
        lines += [f"{_SEVERAL_AXES} multi_dof_{name}" for name in points]
    return "\n".join(lines)


#: Of ROS 2 up to Galactic, of Humble, and since Jazzy.
LAYOUTS = (
    _layout((*_OLD, "error"), several_axes=False),
    _layout((*_NEW, *_OLD), several_axes=True),
    _layout(_NEW, several_axes=True),
)


def define_controller_state(reader: AnyReader, definitions: Callable[[], Typestore]) -> None:
    """Gives an open bag the layout that its controller's states have, if it does not define one.

    Args:
        reader: Of the bag.
        definitions: Makes a store of ROS's own types, to try a layout in.
    """
    connections = [c for c in reader.connections if c.msgtype == CONTROLLER_STATE]
    if not connections or CONTROLLER_STATE in reader.typestore.fielddefs:
        return
    typesys = needed("rosbags.typesys", "ROS bags need", "formats")
    serde = needed("rosbags.serde", "ROS bags need", "formats")
    first = next((data for _, _, data in reader.messages(connections)), b"")
    for layout in LAYOUTS:
        types = typesys.get_types_from_msg(layout, CONTROLLER_STATE)
        trial = definitions()
        trial.register(types)
        try:
            trial.deserialize_cdr(first, CONTROLLER_STATE)
        except serde.SerdeError:
            continue
        reader.typestore.register(types)
        return
