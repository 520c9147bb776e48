"""Recordings of two joints that swing, and what a crash leaves of one: for `gfm recording`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gfm.cli import main
from gfm.core import Command, CommandKind, ObjectTrack, Trajectory
from gfm.recording import RecordingWriter

JOINTS = ("shoulder", "elbow")
STEPS = 400
BEGIN_NS = 1_700_000_000_000_000_000


def swing(name: str = "swing") -> Trajectory:
    """Two joints at 100 Hz, commanded at 20 Hz, measured with noise, with an object's poses."""
    rng = np.random.default_rng(3)
    stamp_ns = BEGIN_NS + 10_000_000 * np.arange(STEPS, dtype=np.int64)
    time_s = 0.01 * np.arange(STEPS)
    phase = np.stack([time_s, 1.0 + 1.3 * time_s], axis=1)
    command = np.sin(phase)[::5]
    return Trajectory(
        name=name,
        joint_names=JOINTS,
        stamp_ns=stamp_ns,
        position=np.sin(phase - 0.05) + 1e-4 * rng.normal(size=(STEPS, 2)),
        velocity=np.cos(phase - 0.05) * [1.0, 1.3] + 1e-3 * rng.normal(size=(STEPS, 2)),
        effort=rng.normal(size=(STEPS, 2)),
        command_kind=CommandKind.POSITION,
        command_stamp_ns=stamp_ns[::5],
        command=command,
        requested=command + 0.1,
        object_track=ObjectTrack(
            stamp_ns=stamp_ns[::10],
            position=rng.normal(size=(STEPS // 10, 3)),
            quaternion=np.tile([1.0, 0.0, 0.0, 0.0], (STEPS // 10, 1)),
        ),
        metadata={"run": "r1", "software": "test"},
    )


def run(*words: str | Path) -> int:
    """Returns the exit status of `gfm recording`."""
    return main(["recording", *(str(word) for word in words)])


def names(folder: Path) -> list[str]:
    """Returns what is in a folder."""
    return sorted(path.name for path in folder.iterdir())


def left_by_a_crash(path: Path, steps: int = STEPS) -> Path:
    """Leaves what a killed writer leaves: no close, no footer."""
    writer = RecordingWriter(path, about={"run": "r1"})
    for step in range(steps):
        stamp_ns = BEGIN_NS + step * 10_000_000
        told = Command(
            kind=CommandKind.VELOCITY,
            joint_names=JOINTS,
            values=np.array([0.0, np.sin(step)]),
            stamp_ns=stamp_ns,
        )
        writer.write_state(stamp_ns, JOINTS, np.full(2, 0.1 * step), np.zeros(2), np.zeros(2))
        writer.write_command(told)
        writer.write_requested(replace(told, values=np.array([0.0, np.nan])))
    writer.abandon()
    return path.with_name(path.name + ".part")
