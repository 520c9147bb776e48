"""Recordings that are given: of one robot, beside the models that they are for; and splits."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np

from gfm.core import CommandKind, RecordingError, Trajectory
from gfm.recording import read_recording
from gfm.recording.schemas import COMMAND, JOINT_STATES
from gfm.sim.still import unrecorded

#: Recordings, and where each came from.
Files: TypeAlias = Sequence[tuple[Path, Trajectory]]

#: Share of a single recording that effects are looked for in; the rest is held out.
TRAINING_SHARE = 0.7
#: Commands so long before the cut are kept with the second part: a robot may act on them late, s.
_COMMAND_MEMORY_S = 1.0


def read_recordings(
    paths: Sequence[Path], *, joint_states: str = JOINT_STATES, command: str = COMMAND
) -> list[Trajectory]:
    """Returns recordings with their joints in the order of the first one's.

    Args:
        paths: MCAP files.
        joint_states: Topic of the measurements.
        command: Topic of the commands.

    Raises:
        RecordingError: a file cannot be trusted, or has other joints than the first.
    """
    read = [
        (path, read_recording(path, joint_states=joint_states, command=command)) for path in paths
    ]
    return [recording for _, recording in in_one_order(read)]


def in_one_order(recordings: Files) -> list[tuple[Path, Trajectory]]:
    """Returns recordings with their joints in the order of the first one's.

    Raises:
        RecordingError: one of them has other joints than the first.
    """
    for path, recording in recordings:
        _check_joints(recording, recordings[0][1], path)
    return [(path, one.with_joints(recordings[0][1].joint_names)) for path, one in recordings]


def _check_joints(trajectory: Trajectory, first: Trajectory, path: Path) -> None:
    """Refuses a recording that has not the joints of the first one."""
    missing = [name for name in first.joint_names if name not in trajectory.joint_names]
    surplus = [name for name in trajectory.joint_names if name not in first.joint_names]
    if missing and surplus:
        found = f"joints {', '.join(trajectory.joint_names)}"
        expected = f"those of {first.name}: {', '.join(first.joint_names)} (one robot at a time)"
        raise RecordingError(str(path), found, expected)
    if missing or surplus:
        has, lacks = ("lacks", "has") if missing else ("has", "lacks")
        found = f"{has} joint {', '.join(missing or surplus)}, which {first.name} {lacks}"
        expected = "the same joints in all recordings: record it always, or leave it out everywhere"
        raise RecordingError(str(path), found, expected)


def check_together(specs: Mapping[CommandKind, mujoco.MjSpec], recordings: Files) -> None:
    """Raises RecordingError for the first recording that no model is made for."""
    for path, recording in recordings:
        kind = recording.command_kind
        if kind not in specs:
            kinds = " or ".join(sorted(specs))
            expected = f"{kinds} commands: those the models' actuators take (or one more --model)"
            raise RecordingError(str(path), f"{kind} commands", expected)
        joints = {joint.name for joint in specs[kind].joints}
        _check_names(path, recording, "joint", joints)
        driven = {actuator.name for actuator in specs[kind].actuators}
        _check_names(path, recording, "actuator", {*driven, *recording.uncommanded})


def without_strangers(
    specs: Mapping[CommandKind, mujoco.MjSpec], recordings: Sequence[Trajectory]
) -> tuple[list[Trajectory], list[str]]:
    """Returns recordings without joints that no command and no model tells of, and a note on them.

    A gripper, say, that is measured with the arm and left out of its model, or driven there by a
    tendon.
    """
    there = recordings[0].joint_names
    silent = [name for name in there if all(name in r.uncommanded for r in recordings)]
    commanded = [name for name in there if name not in silent]
    told = {
        name
        for spec in specs.values()
        for name in {joint.name for joint in spec.joints} - _moved_otherwise(spec, commanded)
    }
    strange = [name for name in silent if name not in told]
    if not strange:
        return list(recordings), []
    names = tuple(name for name in there if name not in strange)
    note = (
        "Measured, but not commanded, and not in the model or driven there by something else: "
        f"{', '.join(strange)}. Left out."
    )
    return [recording.with_joints(names) for recording in recordings], [note]


def _moved_otherwise(spec: mujoco.MjSpec, commanded: Sequence[str]) -> set[str]:
    """Returns the joints that a model drives, but by no drive of their own."""
    return set(unrecorded(spec, commanded)) - {actuator.name for actuator in spec.actuators}


def _check_names(path: Path, recording: Trajectory, what: str, there: Iterable[str]) -> None:
    missing = [name for name in recording.joint_names if name not in there]
    if missing:
        raise RecordingError(
            str(path),
            f"no {what} of the model is called {', '.join(missing)}, as a recorded joint is",
            f"names from the model's {what}s: {', '.join(sorted(there)) or 'none'}",
        )


def split(
    recordings: Sequence[Trajectory],
) -> tuple[list[Trajectory], list[Trajectory], str]:
    """Returns what to train on, what to hold out, and a note that says so.

    The last of several recordings is held out, and the last part of a single one.
    """
    if len(recordings) > 1:
        note = f"No --holdout was given: errors are measured on the last one, {recordings[-1].name}"
        return list(recordings[:-1]), [recordings[-1]], f"{note}."
    first, second = cut_in_two(recordings[0], TRAINING_SHARE)
    note = (
        f"No --holdout was given: errors are measured on the last {100 * (1 - TRAINING_SHARE):.0f} "
        "% of the only recording. Another motion would say more."
    )
    return [first], [second], note


def cut_in_two(recording: Trajectory, share: float) -> tuple[Trajectory, Trajectory]:
    """Returns the first `share` of a recording's time, and the rest."""
    cut_ns = recording.stamp_ns[0] + round(recording.duration_s * share * 1e9)
    first = recording.stamp_ns < cut_ns
    early = recording.command_stamp_ns < cut_ns
    late = recording.command_stamp_ns >= cut_ns - round(_COMMAND_MEMORY_S * 1e9)
    # Whatever held at the beginning of the second part has to be there, however old it is.
    late[max(int(early.sum()) - 1, 0)] = True
    early[0] = True
    return _part(recording, "first", first, early), _part(recording, "last", ~first, late)


def _part(
    recording: Trajectory, label: str, states: np.ndarray, commands: np.ndarray
) -> Trajectory:
    return replace(
        recording.measured_at(states),
        name=f"{recording.name} ({label} part)",
        command_stamp_ns=recording.command_stamp_ns[commands],
        command=recording.command[commands],
        requested=None if recording.requested is None else recording.requested[commands],
    )
