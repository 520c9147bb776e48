"""Writes recordings: MCAP, profile `ros2`, cdr + ros2msg, readable after the writer was killed."""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Self, final

import mcap_ros2.writer
import numpy as np
from mcap.records import Schema
from numpy.typing import NDArray
from typing_extensions import override

from gfm.core import Command, Trajectory
from gfm.core.checks import Array
from gfm.recording import schemas
from gfm.recording.new_file import give_name
from gfm.recording.topics import TopicWriter

_log = logging.getLogger(__name__)

#: A chunk reaches the disk when it is full: 8 KiB are some 0.1 s of an arm at 100 Hz, and 2 s of
#: one joint at 20 Hz. What a killed writer loses is the chunk it had not filled.
_CHUNK_BYTES = 8 * 1024


@final
class RecordingWriter(TopicWriter):
    """Writes one recording to `PATH.part` and gives it its name when it is complete.

    A context that ends with an error leaves the `.part`: whatever was recorded is in it. A part
    that is there already, which a crash left, is kept aside as `NAME_crashed_1.mcap.part`.

    Args:
        path: The file to make, by habit `NAME.mcap`; its folder is made too.
        about: What the recording says about itself (run, software, versions ...).
        servo_gain: Factors on the model's servo gains by joint, see `gfm.core.Trajectory`.
    """

    def __init__(
        self,
        path: Path,
        *,
        about: Mapping[str, str] | None = None,
        servo_gain: Mapping[str, float] | None = None,
    ) -> None:
        self.path = path
        self._part = path.with_name(path.name + ".part")
        path.parent.mkdir(parents=True, exist_ok=True)
        _keep_aside(path, self._part)
        self._file = self._part.open("wb")
        self._writer = mcap_ros2.writer.Writer(self._file, chunk_size=_CHUNK_BYTES)
        self._schemas: dict[str, Schema] = {}
        self._writer.add_metadata(schemas.ABOUT_RECORD, dict(about or {}))
        if servo_gain:
            gains = {joint: repr(float(gain)) for joint, gain in servo_gain.items()}
            self._writer.add_metadata(schemas.SERVO_GAIN_RECORD, gains)
        self._file.flush()

    def add_metadata(self, record: str, entries: Mapping[str, str]) -> None:
        """Writes one more metadata record."""
        self._writer.add_metadata(record, dict(entries))

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Puts a file into the recording."""
        self._writer.add_attachment(0, 0, name, media_type, data)

    @override
    def write_message(
        self, topic: str, kind: schemas.MessageType, message: Mapping[str, object], stamp_ns: int
    ) -> None:
        schema = self._schemas.get(kind.name)
        if schema is None:
            schema = self._schemas[kind.name] = self._writer.register_msgdef(*kind)
        self._writer.write_message(topic, schema, message, log_time=stamp_ns)
        self._file.flush()

    def close(self, *, replace: bool = False) -> None:
        """Completes the file and gives it its name.

        Raises:
            FileExistsError: the name is taken, and not to be replaced; the part stays.
        """
        self._finish()
        if replace:
            self._part.replace(self.path)
        else:
            give_name(self._part, self.path)

    def discard(self) -> None:
        """Removes what was written."""
        self._finish()
        self._part.unlink()

    def abandon(self) -> None:
        """Leaves the `.part` as it is: nothing more can be written."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self._finish()

    def _finish(self) -> None:
        """Completes the file. Its name is to hold a whole one even if the machine stops next."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()


def _keep_aside(path: Path, part: Path) -> None:
    if not part.exists():
        return
    number = 1
    while (aside := path.with_name(f"{path.stem}_crashed_{number}{path.suffix}.part")).exists():
        number += 1
    part.rename(aside)
    _log.warning("a recording was cut off: kept as %s; `gfm recording salvage` saves it", aside)


def write_recording(path: Path, trajectory: Trajectory) -> None:
    """Writes a whole trajectory in the place of what has that name, or leaves nothing behind."""
    about, gain = trajectory.metadata, trajectory.servo_gain
    writer = RecordingWriter(path, about=about, servo_gain=gain)
    try:
        for stream, index in _in_time_order(trajectory):
            _write_sample(writer, trajectory, stream, index)
    except BaseException:
        writer.discard()
        raise
    writer.close(replace=True)


def _in_time_order(trajectory: Trajectory) -> Iterator[tuple[int, int]]:
    """Yields (stream, index) by stamp; at equal stamps the command comes first."""
    track = trajectory.object_track
    stamps: list[NDArray[np.int64]] = [trajectory.command_stamp_ns, trajectory.stamp_ns]
    stamps += [] if track is None else [track.stamp_ns]
    stream = np.concatenate([np.full(len(s), i) for i, s in enumerate(stamps)])
    index = np.concatenate([np.arange(len(s)) for s in stamps])
    order = np.argsort(np.concatenate(stamps), kind="stable")
    yield from zip(stream[order].tolist(), index[order].tolist(), strict=True)


def _write_sample(writer: RecordingWriter, trajectory: Trajectory, stream: int, i: int) -> None:
    if stream == 0:
        writer.write_command(_command(trajectory, trajectory.command, i))
        if trajectory.requested is not None:
            writer.write_requested(_command(trajectory, trajectory.requested, i))
    elif stream == 1:
        velocity = None if trajectory.velocity is None else trajectory.velocity[i]
        effort = None if trajectory.effort is None else trajectory.effort[i]
        stamp_ns, names = int(trajectory.stamp_ns[i]), trajectory.joint_names
        writer.write_state(stamp_ns, names, trajectory.position[i], velocity, effort)
    elif trajectory.object_track is not None:
        track = trajectory.object_track
        writer.write_object_pose(int(track.stamp_ns[i]), track.position[i], track.quaternion[i])


def _command(trajectory: Trajectory, values: Array, i: int) -> Command:
    return Command(
        kind=trajectory.command_kind,
        joint_names=trajectory.joint_names,
        values=values[i],
        stamp_ns=int(trajectory.command_stamp_ns[i]),
        number=i,
    )
