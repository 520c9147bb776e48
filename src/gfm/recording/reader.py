"""Reads a recording, and refuses whatever a diagnosis could not trust."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gfm.core import CommandKind, ObjectTrack, RecordingError, Trajectory
from gfm.core.checks import Array
from gfm.core.trajectory import UNCOMMANDED
from gfm.recording import schemas
from gfm.recording.mcap_file import McapContent, read_mcap
from gfm.recording.streams import JointStream, check_one_clock, joint_stream, stamps_of

#: Fewer measurements than this say nothing about dynamics.
MIN_STATES = 10
QUATERNION_TOLERANCE = 1e-3


def read_recording(
    path: Path | str,
    *,
    joint_states: str = schemas.JOINT_STATES,
    command: str = schemas.COMMAND,
) -> Trajectory:
    """Returns what one MCAP file recorded, checked.

    Joints are ordered as the joint states name them first. A measured joint that is never
    commanded gets the command 0 and is listed under "uncommanded_joints" in the metadata.

    Args:
        path: The file.
        joint_states: Topic of the measurements.
        command: Topic of the applied commands.

    Raises:
        RecordingError: with the file, the topic, the field and what was expected.
    """
    path = Path(path)
    requested = f"{command}_requested"
    joint_topics = (joint_states, command, requested)
    types = dict.fromkeys(joint_topics, schemas.JOINT_STATE.name)
    content = read_mcap(path, types | {schemas.OBJECT_POSE: schemas.POSE.name})
    if not content.complete:
        raise _cut_off(path, content, joint_states)
    states = joint_stream(path, joint_states, _messages(path, content, joint_states))
    if len(states.stamp_ns) < MIN_STATES:
        where, got = f"{path}: topic {joint_states}", f"only {len(states.stamp_ns)} messages"
        raise RecordingError(where, got, f"at least {MIN_STATES}")
    commands = joint_stream(path, command, _messages(path, content, command))
    check_one_clock(states.stamps, commands.stamps)
    return _trajectory(path, content, states, commands, _requested(path, content, commands))


def _messages(path: Path, content: McapContent, topic: str) -> list[Any]:
    messages = content.messages.get(topic)
    if messages:
        return messages
    there = ", ".join(f"{t} ({kind})" for t, kind in sorted(content.topics.items())) or "none"
    problem = "has no messages" if topic in content.topics else "is missing"
    expected = f"{schemas.JOINT_STATE.name} under that name; topics in the file: {there}"
    raise RecordingError(f"{path}: topic {topic}", problem, expected)


def _cut_off(path: Path, content: McapContent, topic: str) -> RecordingError:
    count = len(content.messages.get(topic, ()))
    problem = f"cut off or damaged after {count} messages on {topic}"
    expected = (
        "MCAP's closing record (is it still being written? "
        "`gfm recording salvage FILE` saves what is readable)"
    )
    return RecordingError(str(path), problem, expected)


def _requested(path: Path, content: McapContent, applied: JointStream) -> JointStream | None:
    """Returns the requested commands, where there are any."""
    topic = f"{applied.topic}_requested"
    messages = content.messages.get(topic)
    if not messages:
        return None
    requested = joint_stream(path, topic, messages, wished=True)
    if not np.array_equal(requested.stamp_ns, applied.stamp_ns):
        expected = f"one message for each on {applied.topic}, with the same stamp"
        problem = f"{len(requested.stamp_ns)} messages"
        raise RecordingError(f"{path}: topic {topic}", problem, expected)
    return requested


def _asked(
    requested: JointStream | None, kind: CommandKind, joint_names: Sequence[str]
) -> Array | None:
    """Returns what was asked for in the kind of what was applied, shape (T, J); None for nothing.

    An arm that bears a load nobody told of is held by positions while a policy asks for speeds.
    """
    if requested is None or kind not in requested.fields:
        return None
    return requested.ordered(kind, joint_names)


def _trajectory(
    path: Path,
    content: McapContent,
    states: JointStream,
    commands: JointStream,
    requested: JointStream | None,
) -> Trajectory:
    unknown = [name for name in commands.joint_names if name not in states.joint_names]
    if unknown:
        where = f"{path}: topic {commands.topic}: field name"
        raise RecordingError(
            where,
            f"commands joint {', '.join(unknown)}",
            f"joints measured on {states.topic}: {', '.join(states.joint_names)}",
        )
    passive = [name for name in states.joint_names if name not in commands.joint_names]
    metadata = _metadata(content)
    if passive:
        metadata[UNCOMMANDED] = ", ".join(passive)
    kind = commands.setpoint_kind()
    position = states.fields.get("position")
    if position is None:
        raise RecordingError(f"{path}: topic {states.topic}: position", "is empty", "rad per joint")
    return Trajectory(
        name=path.name.removesuffix(".mcap"),
        joint_names=states.joint_names,
        stamp_ns=states.stamp_ns,
        position=position,
        velocity=states.fields.get("velocity"),
        effort=states.fields.get("effort"),
        command_kind=kind,
        command_stamp_ns=commands.stamp_ns,
        command=commands.ordered(kind, states.joint_names),
        requested=_asked(requested, kind, states.joint_names),
        servo_gain=_servo_gain(path, content.metadata.get(schemas.SERVO_GAIN_RECORD, {})),
        object_track=_object_track(path, content.messages.get(schemas.OBJECT_POSE, [])),
        metadata=metadata,
    )


def _metadata(content: McapContent) -> dict[str, str]:
    """Returns all metadata records as one; those that are not ours keep their name as prefix."""
    flat: dict[str, str] = {}
    for record, entries in content.metadata.items():
        prefix = "" if record == schemas.ABOUT_RECORD else f"{record}."
        if record != schemas.SERVO_GAIN_RECORD:
            flat |= {f"{prefix}{key}": value for key, value in entries.items()}
    return flat


def _servo_gain(path: Path, entries: Mapping[str, str]) -> dict[str, float]:
    gains: dict[str, float] = {}
    for joint, text in entries.items():
        try:
            gains[joint] = float(text)
        except ValueError:
            gains[joint] = np.nan
        if not 0.0 <= gains[joint] < np.inf:
            where = f"{path}: metadata {schemas.SERVO_GAIN_RECORD}: {joint}"
            raise RecordingError(where, f"is {text!r}", "a number of at least 0")
    return gains


def _object_track(path: Path, messages: list[Any]) -> ObjectTrack | None:
    if not messages:
        return None
    where = f"{path}: topic {schemas.OBJECT_POSE}"
    poses = [message.pose for message in messages]
    position = np.array([[p.position.x, p.position.y, p.position.z] for p in poses])
    turns = [pose.orientation for pose in poses]
    quaternion = np.array([[turn.w, turn.x, turn.y, turn.z] for turn in turns])
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    strange = ~np.isfinite(position).all(axis=1)
    if strange.any():
        i = int(strange.argmax())
        problem = f"message {i} has position {', '.join(f'{x:g}' for x in position[i])}"
        raise RecordingError(f"{where}: field pose.position", problem, "finite numbers")
    strange = ~(np.abs(norm[:, 0] - 1.0) < QUATERNION_TOLERANCE)
    if strange.any():
        i = int(strange.argmax())
        problem = f"message {i} has a quaternion of length {float(norm[i, 0]):.4g}"
        raise RecordingError(f"{where}: field pose.orientation", problem, "length 1")
    stamp_ns = stamps_of(where, messages)
    return ObjectTrack(stamp_ns=stamp_ns, position=position, quaternion=quaternion / norm)
