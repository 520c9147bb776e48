"""Turns tables into recordings, as a mapping says."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gfm.core import BadInputError, ConfigError, ObjectTrack, RecordingError, Trajectory
from gfm.core.checks import Array, Stamps
from gfm.core.rounding import in_steps_of
from gfm.importing.mapping import Column, JointColumns, Mapping, as_column
from gfm.importing.reading_times import at_stamps
from gfm.importing.sources import Source, sources
from gfm.importing.tables import Table
from gfm.recording.reader import MIN_STATES, QUATERNION_TOLERANCE
from gfm.recording.streams import check_one_clock

#: Joint states come tens to thousands of times a second; what lies outside is another unit.
LEAST_PERIOD_S, MOST_PERIOD_S = 1e-4, 1.0

#: Columns of a pose, and how far from 1 the length of a quaternion may be.
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Rows [start, stop) of a table in which the servo was on, or off."""

    start: int
    stop: int
    released: bool


def imported(paths: Sequence[Path], mapping: Mapping) -> Iterator[Trajectory]:
    """Yields the recordings that some files hold, each with a name of its own.

    Raises:
        RecordingError: a file that does not fit the mapping: file, column, row, expected.
    """
    seen: dict[str, Path] = {}
    for source in sources(paths, mapping):
        for trajectory in recordings_of(source, mapping):
            if trajectory.name in seen:
                problem = f"becomes {trajectory.name!r}, as {seen[trajectory.name]} does"
                where = str(source.states.path)
                raise RecordingError(where, problem, "a name that tells them apart")
            seen[trajectory.name] = source.states.path
            yield trajectory


def recordings_of(source: Source, mapping: Mapping) -> Iterator[Trajectory]:
    """Yields the recordings of one source: one, or one for each time the servo went on or off."""
    whole = _trajectory(source, mapping)
    if mapping.released is None:
        yield whole
        return
    off = np.array(source.states.texts(mapping.released.column)) == mapping.released.value.lower()
    counts = {True: 0, False: 0}
    for segment in _segments(off):
        counts[segment.released] += 1
        if segment.stop - segment.start >= MIN_STATES:
            yield _part(whole, segment, counts[segment.released])


def _segments(off: np.ndarray) -> list[Segment]:
    """Returns the runs of equal values, in order."""
    borders = [0, *(np.flatnonzero(off[1:] != off[:-1]) + 1).tolist(), len(off)]
    pairs = itertools.pairwise(borders)
    return [Segment(start=a, stop=b, released=bool(off[a])) for a, b in pairs]


def _part(whole: Trajectory, segment: Segment, count: int) -> Trajectory:
    """Returns some rows of a recording; released ones carry a servo gain of 0."""
    rows = slice(segment.start, segment.stop)
    suffix = ("_released" if segment.released else "") + (f"_{count}" if count > 1 else "")
    gain = dict.fromkeys(whole.joint_names, 0.0) if segment.released else whole.servo_gain
    optional = {"velocity": whole.velocity, "effort": whole.effort}
    parts = {k: None if v is None else v[rows] for k, v in optional.items()}
    return Trajectory(
        name=whole.name + suffix,
        joint_names=whole.joint_names,
        stamp_ns=whole.stamp_ns[rows],
        position=whole.position[rows],
        velocity=parts["velocity"],
        effort=parts["effort"],
        command_kind=whole.command_kind,
        command_stamp_ns=whole.command_stamp_ns[rows],
        command=whole.command[rows],
        servo_gain=gain,
        object_track=_rows_of(whole.object_track, rows),
        metadata=whole.metadata,
    )


def _rows_of(track: ObjectTrack | None, rows: slice) -> ObjectTrack | None:
    if track is None:
        return None
    return ObjectTrack(
        stamp_ns=track.stamp_ns[rows],
        position=track.position[rows],
        quaternion=track.quaternion[rows],
    )


def _trajectory(source: Source, mapping: Mapping) -> Trajectory:
    states, commands = source.states, source.commands
    names = tuple(joint.name for joint in mapping.joints)
    stamp_ns = _stamps(states, as_column(mapping.time))
    if len(stamp_ns) < MIN_STATES:
        raise RecordingError(states.where, f"has {len(stamp_ns)} rows", f"{MIN_STATES} or more")
    _check_rate(states, stamp_ns, mapping)
    position = _measured(states, stamp_ns, mapping.joints, "position")
    command_stamp_ns = _stamps(commands, as_column(mapping.command_time or mapping.time))
    check_one_clock((states.where, stamp_ns), (commands.where, command_stamp_ns))
    command = _signal(commands, len(command_stamp_ns), mapping.joints, "command")
    if position is None or command is None:
        raise AssertionError("the mapping requires both")
    return Trajectory(
        name=_name(source, states, mapping),
        joint_names=names,
        stamp_ns=stamp_ns,
        position=position,
        velocity=_measured(states, stamp_ns, mapping.joints, "velocity"),
        effort=_measured(states, stamp_ns, mapping.joints, "effort"),
        command_kind=mapping.command_kind,
        command_stamp_ns=command_stamp_ns,
        command=command,
        servo_gain=_servo_gain(states, names, mapping),
        object_track=_object_track(states, stamp_ns, mapping),
        metadata=_metadata(source),
    )


def _stamps(table: Table, column: Column) -> Stamps:
    stamp_ns = table.stamps_ns(column)
    where = f"{table.where}: column {column.column}"
    if (stamp_ns < 0).any():
        row = int((stamp_ns < 0).argmax())
        problem = f"row {row + 1} is {stamp_ns[row] * 1e-9:.6f} s"
        raise RecordingError(where, problem, "times of at least 0 s (an offset shifts them)")
    step_ns = np.diff(stamp_ns)
    if (step_ns <= 0).any():
        row = int((step_ns <= 0).argmax()) + 1
        problem = f"row {row + 1} is {-step_ns[row - 1] * 1e-9:.6f} s before the row above"
        raise RecordingError(where, problem, "strictly increasing times")
    return stamp_ns


def _check_rate(table: Table, stamp_ns: Stamps, mapping: Mapping) -> None:
    """Refuses times that are in another unit than the mapping says."""
    period_s = float(np.median(np.diff(stamp_ns))) * 1e-9
    if not LEAST_PERIOD_S <= period_s <= MOST_PERIOD_S:
        where = f"{table.where}: column {as_column(mapping.time).column}"
        expected = "measurements some milliseconds apart (does time.scale turn it into seconds?)"
        raise RecordingError(where, f"rows are {period_s:.3g} s apart", expected)


def _measured(
    table: Table, stamp_ns: Stamps, joints: Sequence[JointColumns], signal: str
) -> Array | None:
    """Returns a measured signal at the stamps, although joints may have been read beside them."""
    values = _signal(table, len(stamp_ns), joints, signal)
    if values is None:
        return None
    moved = values.copy()
    for j, joint in enumerate(joints):
        if joint.read_offset_s != 0.0:
            put_back = at_stamps(stamp_ns, values[:, j], joint.read_offset_s)
            moved[:, j] = in_steps_of(put_back, values[:, j])
    return moved


def _signal(table: Table, rows: int, joints: Sequence[JointColumns], signal: str) -> Array | None:
    given = [getattr(joint, signal) for joint in joints]
    if given[0] is None:
        return None
    return _stacked(table, rows, [as_column(column) for column in given])


def _stacked(table: Table, rows: int, columns: Sequence[Column]) -> Array:
    """Returns columns side by side, shape (rows, columns), as long as the times are."""
    values = [table.numbers(column) for column in columns]
    for column, one in zip(columns, values, strict=True):
        if len(one) != rows:
            where = f"{table.where}: column {column.column}"
            raise RecordingError(where, f"has {len(one)} rows", f"{rows}, as the times have")
    return np.stack(values, axis=1)


def _object_track(table: Table, stamp_ns: Stamps, mapping: Mapping) -> ObjectTrack | None:
    """Returns a free object's poses, one in every row."""
    if mapping.object is None:
        return None
    columns = [as_column(getattr(mapping.object, name)) for name in POSE]
    pose = _stacked(table, len(stamp_ns), columns)
    norm = np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    wrong = np.abs(norm[:, 0] - 1.0) > QUATERNION_TOLERANCE
    if wrong.any():
        row, where = (
            int(wrong.argmax()),
            f"{table.where}: columns {', '.join(POSE[3:])} of the object",
        )
        problem = f"row {row + 1} has length {float(norm[row, 0]):.4g}"
        raise RecordingError(where, problem, "a quaternion of length 1")
    return ObjectTrack(stamp_ns=stamp_ns, position=pose[:, :3], quaternion=pose[:, 3:] / norm)


def _name(source: Source, table: Table, mapping: Mapping) -> str:
    try:
        name = mapping.name.format_map({**table.header, "stem": source.stem})
    except (KeyError, ValueError, IndexError) as exc:
        there = ", ".join(["stem", *table.header])
        raise ConfigError(f"name {mapping.name!r} needs {exc}; available: {there}") from exc
    if Path(name).name != name:
        raise BadInputError(f"{source.states.path}: becomes {name!r}; expected a plain file name")
    return name


def _servo_gain(table: Table, names: Sequence[str], mapping: Mapping) -> dict[str, float]:
    if mapping.servo_gain is None:
        return {}
    gain = table.header.get(mapping.servo_gain.header)
    if isinstance(gain, bool) or not isinstance(gain, int | float) or gain <= 0:
        where = f"{table.where}: header field {mapping.servo_gain.header}"
        raise RecordingError(where, f"is {gain!r}", "a positive number")
    return dict.fromkeys(names, gain / mapping.servo_gain.reference)


def _metadata(source: Source) -> dict[str, str]:
    states, commands = source.states, source.commands
    tables = {states.path.name: states.digest, commands.path.name: commands.digest}
    about = {k: str(v) for k, v in states.header.items() if isinstance(v, str | int | float)}
    return about | {
        "imported_from": ", ".join(tables),
        "imported_sha256": ", ".join(tables.values()),
        "imported_stem": source.stem,
    }
