"""Recordings as tables that any tool reads: CSV, Parquet, NumPy's .npz, with units in the names."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfm.core import CommandKind, Trajectory
from gfm.core.checks import Array, Stamps
from gfm.core.extras import needed
from gfm.recording.new_file import check_free, new_file

#: How the unit of a command is written in a column's name, and in the name of an array.
_UNITS = {
    CommandKind.POSITION: ("rad", "rad"),
    CommandKind.VELOCITY: ("rad/s", "rad_s"),
    CommandKind.EFFORT: ("N m", "nm"),
}


@dataclass(frozen=True, kw_only=True)
class Stream:
    """What has stamps in common.

    Attributes:
        name: Ends the name of its file.
        stamp_ns: shape (T,).
        time_s: Since the recording's first measurement, shape (T,).
        columns: By name, with the unit in brackets, each of shape (T,).
    """

    name: str
    stamp_ns: Stamps
    time_s: Array
    columns: Mapping[str, Array]


def streams(recording: Trajectory) -> list[Stream]:
    """Returns measurements, commands, and poses of an object where there are any."""
    told, _ = _UNITS[recording.command_kind]
    kind = recording.command_kind
    measured = [
        ("position", "rad", recording.position),
        ("velocity", "rad/s", recording.velocity),
        ("effort", "N m", recording.effort),
    ]
    commanded = [
        (f"command.{kind}", told, recording.command),
        (f"requested.{kind}", told, recording.requested),
    ]
    found = [
        _stream(recording, "measured", recording.stamp_ns, _by_joint(recording, measured)),
        _stream(recording, "command", recording.command_stamp_ns, _by_joint(recording, commanded)),
    ]
    if (track := recording.object_track) is not None:
        place = {f"{axis} [m]": track.position[:, i] for i, axis in enumerate("xyz")}
        turn = {f"q{axis} [1]": track.quaternion[:, i] for i, axis in enumerate("wxyz")}
        found.append(_stream(recording, "object", track.stamp_ns, place | turn))
    return found


def arrays(recording: Trajectory) -> dict[str, NDArray[Any]]:
    """Returns a recording's arrays by name, with the unit at the end of each name."""
    _, unit = _UNITS[recording.command_kind]
    track = recording.object_track
    found: dict[str, NDArray[Any] | None] = {
        "joint_names": np.array(recording.joint_names),
        "stamp_ns": recording.stamp_ns,
        "position_rad": recording.position,
        "velocity_rad_s": recording.velocity,
        "effort_nm": recording.effort,
        "command_stamp_ns": recording.command_stamp_ns,
        f"command_{unit}": recording.command,
        f"requested_{unit}": recording.requested,
        "object_stamp_ns": None if track is None else track.stamp_ns,
        "object_position_m": None if track is None else track.position,
        "object_quaternion_wxyz": None if track is None else track.quaternion,
        "metadata_json": np.array(json.dumps(dict(recording.metadata))),
    }
    return {name: array for name, array in found.items() if array is not None}


def export(recording: Trajectory, folder: Path, file_format: str) -> list[Path]:
    """Writes a recording's tables into a folder; returns their paths.

    Args:
        recording: What to write.
        folder: Made where it is missing.
        file_format: One of `FORMATS`; npz makes one file, the others one for each stream.

    Raises:
        BadInputError: a file exists, or cannot be written.
        ConfigError: the format needs a package that is not installed.
    """
    writers = FORMATS[file_format](recording)
    files = {folder / f"{recording.name}{end}": write for end, write in writers.items()}
    for path in files:
        check_free(path)
    with ExitStack() as together:
        for path, write in files.items():
            write(together.enter_context(new_file(path)))
    return list(files)


Writers = dict[str, Callable[[Path], None]]


def _as_csv(recording: Trajectory) -> Writers:
    def write(stream: Stream, path: Path) -> None:
        cells = [column.tolist() for column in _table(stream).values()]
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(_table(stream))
            writer.writerows(zip(*cells, strict=True))

    return _each(recording, ".csv", write)


def _as_parquet(recording: Trajectory) -> Writers:
    arrow = needed("pyarrow", "Parquet files need", "formats")
    parquet = needed("pyarrow.parquet", "Parquet files need", "formats")

    def write(stream: Stream, path: Path) -> None:
        table = arrow.table(_table(stream))
        parquet.write_table(table.replace_schema_metadata(dict(recording.metadata)), path)

    return _each(recording, ".parquet", write)


def _as_npz(recording: Trajectory) -> Writers:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **arrays(recording))

    return {".npz": write}


FORMATS = {"csv": _as_csv, "parquet": _as_parquet, "npz": _as_npz}


def _each(recording: Trajectory, suffix: str, write: Callable[[Stream, Path], None]) -> Writers:
    def of(stream: Stream) -> Callable[[Path], None]:
        return lambda path: write(stream, path)

    return {f"_{stream.name}{suffix}": of(stream) for stream in streams(recording)}


def _table(stream: Stream) -> dict[str, NDArray[Any]]:
    return {"time [s]": stream.time_s, "stamp [ns]": stream.stamp_ns, **stream.columns}


def _stream(
    recording: Trajectory, name: str, stamp_ns: Stamps, columns: Mapping[str, Array]
) -> Stream:
    time_s = np.asarray((stamp_ns - recording.stamp_ns[0]) * 1e-9)
    return Stream(name=name, stamp_ns=stamp_ns, time_s=time_s, columns=columns)


def _by_joint(
    recording: Trajectory, signals: Sequence[tuple[str, str, Array | None]]
) -> dict[str, Array]:
    return {
        f"{signal}.{joint} [{unit}]": values[:, j]
        for signal, unit, values in signals
        if values is not None
        for j, joint in enumerate(recording.joint_names)
    }
