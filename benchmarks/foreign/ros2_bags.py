"""An arm of seven joints behind ros2_control: one rosbag2 for each motion.

The recordings are simulated: `seven-rotor`, by another simulator than the project's. The bags are
as a recorder leaves them: `/joint_states` also carries the fingers of a gripper that the model does
not have, in another order than the model's, and the velocity controller's commands are bare arrays
without a stamp.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

import made_bags
from foreign.cutting import Sources
from gfm.core import Trajectory
from gfm.recording import read_recording

STATES = "/joint_states"
COMMANDS = "/joint_group_velocity_controller/commands"
FINGERS = ("finger_joint1", "finger_joint2")
#: How long after a measurement the recorder has it.
_LATE_NS = 2_000_000
_OPEN_M = 0.04


def make(folder: Path, sources: Sources) -> None:
    """Writes arm.xml and the bags motion1, motion2 ... into a folder."""
    case = sources.data / "simulated" / "seven-rotor"
    shutil.copy(case / "model.xml", folder / "arm.xml")
    found = [*sorted(case.glob("rec_*.mcap")), *sorted(case.glob("heldout/*.mcap"))]
    for number, path in enumerate(sources.some(found), start=1):
        recording = read_recording(path)
        made = made_bags.write(folder, "mcap", lambda m, r=recording: messages(m, r, sources))
        made.rename(folder / f"motion{number}")


def messages(
    maker: made_bags.Maker, recording: Trajectory, sources: Sources
) -> list[made_bags.Message]:
    """Returns what was published while a recording was made."""
    names = [*FINGERS, *reversed(recording.joint_names)]
    filled = [recording.position, recording.velocity, recording.effort]
    kept = sources.rows_of(recording)
    made: list[made_bags.Message] = []
    for row in range(kept):
        stamp_ns = int(recording.stamp_ns[row])
        position, velocity, effort = (values[row, ::-1] for values in filled)
        state = maker.joint_state(
            stamp_ns,
            names,
            position=np.concatenate([[_OPEN_M, _OPEN_M], position]),
            velocity=np.concatenate([[0.0, 0.0], velocity]),
            effort=np.concatenate([[0.0, 0.0], effort]),
        )
        made.append((STATES, made_bags.JOINT_STATE, stamp_ns + _LATE_NS, state))
    for stamp_ns, command in zip(recording.command_stamp_ns, recording.command, strict=True):
        if stamp_ns <= recording.stamp_ns[kept - 1]:
            array = maker.multi_array(command)
            made.append((COMMANDS, made_bags.MULTI_ARRAY, int(stamp_ns), array))
    return made
