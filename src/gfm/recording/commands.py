"""The command `gfm import`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gfm.core import BadInputError, ConfigError, Trajectory
from gfm.recording.importing import imported
from gfm.recording.mapping import load_mapping
from gfm.recording.reader import read_recording
from gfm.recording.writer import write_recording

if TYPE_CHECKING:
    Subparsers = argparse._SubParsersAction[argparse.ArgumentParser]

_DESCRIPTION = """\
Turns what other tools wrote into recordings that `gfm diagnose` reads: tables (CSV, JSON, Parquet,
NumPy's .npz, MATLAB's .mat; also .gz), ROS bags (rosbag2, rosbag1) and LeRobot datasets (v2, v3).
The mapping, a TOML file, says which column is which signal: docs/recordings.md describes it,
models/mappings/ has three to start from. Without a mapping, FILE is an MCAP recording that was cut
off (NAME.mcap.part), and what is readable of it is saved.
"""


def add_parser(subparsers: Subparsers) -> None:
    """Adds `gfm import`."""
    parser = subparsers.add_parser(
        "import", help="turn files of other tools into recordings", description=_DESCRIPTION
    )
    parser.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="table, bag or dataset to import"
    )
    parser.add_argument("--mapping", type=Path, metavar="TOML", help="which column is which signal")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="where to write")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Reads everything first, so that bad input leaves nothing behind; then writes."""
    trajectories = _read(arguments.files, arguments.mapping)
    if arguments.out.exists() and not arguments.out.is_dir():
        raise BadInputError(f"{arguments.out}: is a file; expected a folder to write to")
    for trajectory in trajectories:
        path = arguments.out / f"{trajectory.name}.mcap"
        write_recording(path, trajectory)
        sys.stdout.write(f"{path}: {_summary(trajectory)}\n")
    return 0


def _read(files: Sequence[Path], mapping: Path | None) -> list[Trajectory]:
    if mapping is not None:
        return list(imported(files, load_mapping(mapping)))
    for path in files:
        if not path.name.endswith((".mcap", ".mcap.part")):
            raise ConfigError(f"{path}: no --mapping given; expected one for anything but MCAP")
    return [read_recording(path, salvage=True) for path in files]


def _summary(trajectory: Trajectory) -> str:
    joints = ", ".join(trajectory.joint_names)
    return (
        f"{trajectory.duration_s:.1f} s, {len(trajectory.stamp_ns)} measurements, "
        f"{len(trajectory.command_stamp_ns)} {trajectory.command_kind} commands, joints {joints}"
    )
