"""Recordings that a command refuses: one line that says what was found, where, and what to do."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import mujoco
import numpy as np

from gfm.api.objections import Objection, dead_positions, objection_to, same_measurements
from gfm.api.recordings import Files
from gfm.core import CommandKind, RecordingError
from gfm.sim.passive import with_idle_drives
from gfm.sim.plant import make_plant


def check_usable(
    specs: Mapping[CommandKind, mujoco.MjSpec], training: Files, held_out: Files
) -> None:
    """Refuses recordings that cannot be what they claim, or that are no test of one another.

    Args:
        specs: The models, one for each kind of command in the recordings.
        training: What is fitted.
        held_out: What errors are measured on; empty where it will be split off.

    Raises:
        RecordingError: for the first that is refused.
    """
    recordings = [*training, *held_out]
    check_one_robot(recordings)
    check_held_out(training, held_out)
    check_some_motion(recordings)
    dead = dead_positions([recording for _, recording in recordings])
    if dead is not None:
        raise _refusal(recordings[dead[0]][0], dead[1])
    joints = recordings[0][1].joint_names
    driven, runs = with_idle_drives(specs, [recording for _, recording in recordings])
    plants = {kind: make_plant(spec, joints) for kind, spec in driven.items()}
    for (path, _), recording in zip(recordings, runs, strict=True):
        objection = objection_to(recording, plants[recording.command_kind])
        if objection is not None:
            raise _refusal(path, objection)


def _refusal(path: Path, objection: Objection) -> RecordingError:
    return RecordingError(f"{path}: {objection.where}", objection.problem, objection.expected)


def check_one_robot(recordings: Files) -> None:
    """Refuses recordings that name different robots in their metadata."""
    named = [(path, r.metadata["robot"]) for path, r in recordings if "robot" in r.metadata]
    for path, robot in named[1:]:
        first, expected = named[0]
        if robot != expected:
            raise RecordingError(
                str(path), f"is of robot {robot!r}", f"that of {first}: {expected!r}"
            )


def check_held_out(training: Files, held_out: Files) -> None:
    """Refuses held-out recordings whose measurements a fit would see."""
    for path, recording in held_out:
        for seen, other in training:
            how = same_measurements(recording, other)
            if how:
                problem = f"is the same as {seen}: {how}"
                raise RecordingError(
                    str(path), problem, "another motion: errors on what was fitted prove nothing"
                )


def check_some_motion(recordings: Files) -> None:
    """Refuses recordings in none of which any position ever changes."""
    if not any(np.ptp(recording.position, axis=0).any() for _, recording in recordings):
        path, recording = recordings[0]
        joints = ", ".join(recording.joint_names)
        raise RecordingError(
            f"{path}: position",
            f"never changes, on no joint ({joints}) and in no recording",
            "measurements of a robot that moves (is the right topic read?)",
        )
