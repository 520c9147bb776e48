"""Small ROS bags, written by rosbags: what tests import."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

JOINT_STATE = "sensor_msgs/msg/JointState"
MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
CONTROLLER_STATE_TEXT = """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
trajectory_msgs/JointTrajectoryPoint error
"""

COUNT = 30
BEGAN_NS = 1_700_000_000_000_000_123
STAMP_NS = BEGAN_NS + 10_000_000 * np.arange(COUNT)
LATE_NS = 3_000_000
JOINTS = ["elbow", "shoulder"]  # not the order of the mapping
POSITION = np.random.default_rng(0).normal(size=(COUNT, 2))
COMMAND = np.random.default_rng(1).normal(size=(COUNT, 2))

Message = tuple[str, str, int, Any]


class Maker:
    """Makes messages of one ROS version."""

    def __init__(self, ros: int, state_text: str = CONTROLLER_STATE_TEXT) -> None:
        self.ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        self.store.register(get_types_from_msg(state_text, CONTROLLER_STATE))

    def make(self, kind: str, **fields: Any) -> Any:
        return self.store.types[kind](**fields)

    def header(self, stamp_ns: int) -> Any:
        sec, nanosec = divmod(int(stamp_ns), 10**9)
        stamp = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        more = {"seq": 0} if self.ros == 1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id="", **more)

    def joint_state(self, stamp_ns: int, names: Sequence[str], **fields: Any) -> Any:
        empty = np.zeros(0)
        filled = {k: np.array(fields.get(k, empty)) for k in ("position", "velocity", "effort")}
        return self.make(JOINT_STATE, header=self.header(stamp_ns), name=list(names), **filled)

    def multi_array(self, values: Any) -> Any:
        layout = self.make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        return self.make(MULTI_ARRAY, layout=layout, data=np.array(values))

    def point(self, positions: Any) -> Any:
        empty = np.zeros(0)
        return self.make(
            "trajectory_msgs/msg/JointTrajectoryPoint",
            positions=np.array(positions, dtype=float),
            velocities=empty,
            accelerations=empty,
            effort=empty,
            time_from_start=self.make("builtin_interfaces/msg/Duration", sec=0, nanosec=10**7),
        )

    def trajectory(self, stamp_ns: int, names: Sequence[str], points: Sequence[Any]) -> Any:
        made = [self.point(point) for point in points]
        header = self.header(stamp_ns)
        return self.make(TRAJECTORY, header=header, joint_names=list(names), points=made)

    def controller_state(
        self, stamp_ns: int, names: Sequence[str], desired: Any, actual: Any
    ) -> Any:
        return self.make(
            CONTROLLER_STATE,
            header=self.header(stamp_ns),
            joint_names=list(names),
            desired=self.point(desired),
            actual=self.point(actual),
            error=self.point(np.asarray(desired) - np.asarray(actual)),
        )


@contextmanager
def writer(folder: Path, kind: str) -> Iterator[tuple[Any, Path]]:
    """Yields a writer, and what the user would name."""
    if kind == "bag":
        with Writer1(folder / "run.bag") as open_writer:
            yield open_writer, folder / "run.bag"
        return
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer2(folder / "run", version=9, storage_plugin=plugin) as open_writer:
        yield open_writer, folder / "run"


def write(
    folder: Path,
    kind: str,
    messages: Callable[[Maker], list[Message]],
    state_text: str = CONTROLLER_STATE_TEXT,
) -> Path:
    maker = Maker(1 if kind == "bag" else 2, state_text)
    serialize = maker.store.serialize_ros1 if kind == "bag" else maker.store.serialize_cdr
    with writer(folder, kind) as (to, path):
        connections: dict[str, Any] = {}
        for topic, msgtype, log_ns, message in sorted(messages(maker), key=lambda m: m[2]):
            if topic not in connections:
                connections[topic] = to.add_connection(topic, msgtype, typestore=maker.store)
            to.write(connections[topic], int(log_ns), serialize(message, msgtype))
    return path


def states(maker: Maker) -> list[Message]:
    return [
        ("/arm/joint_states", JOINT_STATE, t + LATE_NS, maker.joint_state(t, JOINTS, position=q))
        for t, q in zip(STAMP_NS, POSITION, strict=True)
    ]


def arrays(maker: Maker) -> list[Message]:
    told = zip(STAMP_NS, COMMAND, strict=True)
    return [("/arm/commands", MULTI_ARRAY, t + 500, maker.multi_array(u)) for t, u in told]


def trajectories(maker: Maker) -> list[Message]:
    told = zip(STAMP_NS, COMMAND, strict=True)
    return [
        ("/arm/commands", TRAJECTORY, t + 500, maker.trajectory(t, JOINTS, [u])) for t, u in told
    ]


def joint_states(maker: Maker) -> list[Message]:
    told = zip(STAMP_NS, COMMAND, strict=True)
    return [
        ("/arm/commands", JOINT_STATE, t + 500, maker.joint_state(t, JOINTS, effort=u))
        for t, u in told
    ]


def controller_states(maker: Maker) -> list[Message]:
    return [
        ("/arm/commands", CONTROLLER_STATE, t + 500, maker.controller_state(t, JOINTS, u, q))
        for t, u, q in zip(STAMP_NS, COMMAND, POSITION, strict=True)
    ]
