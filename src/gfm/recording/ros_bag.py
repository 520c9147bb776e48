"""ROS bags as tables, one for each topic: rosbag2 (MCAP, sqlite3) and rosbag1.

Every table has the columns `log_time`, when the recorder received a message, and `stamp`, what its
header says, where it has one; both in whole nanoseconds.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfm.core import RecordingError
from gfm.recording.formats.needed import needed
from gfm.recording.mapping import Topics
from gfm.recording.ros_messages import ROW_OF, Row
from gfm.recording.tables import Table

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

STAMP, LOG_TIME = "stamp", "log_time"
_SECOND_NS = 1_000_000_000
_ERRORS = (
    ("rosbags.highlevel", "AnyReaderError"),
    ("rosbags.rosbag1", "ReaderError"),
    ("rosbags.rosbag2", "ReaderError"),
    ("rosbags.serde", "SerdeError"),
    ("rosbags.typesys", "TypesysError"),
    ("apsw", "Error"),
)
_OF_BYTES = (ValueError, TypeError, RuntimeError, MemoryError, struct.error)


@dataclass(frozen=True, kw_only=True)
class Bag:
    """What was read of one bag.

    Attributes:
        path: File or folder.
        digest: SHA-256 of its bytes.
        types: Of all topics, by name.
        rows: Of the topics that were asked for, one for each message.
    """

    path: Path
    digest: str
    types: Mapping[str, str]
    rows: Mapping[str, Sequence[Row]]

    def table(self, topic: str, columns: Collection[str]) -> Table:
        """Returns the messages of a topic that have most of these columns.

        Several nodes may publish on one topic, each its own joints.
        """
        kinds: dict[frozenset[str], list[Row]] = {}
        for row in self.rows[topic]:
            kinds.setdefault(frozenset(row), []).append(row)
        best = max(kinds.values(), key=lambda rows: (len(set(columns) & set(rows[0])), len(rows)))
        cells = {name: [row[name] for row in best] for name in best[0]}
        return Table(path=self.path, place=f"topic {topic}", digest=self.digest, columns=cells)


def bag_tables(path: Path, topics: Topics, columns: Collection[str]) -> tuple[Table, Table]:
    """Returns the tables of measurements and of commands, the same one where the topics are.

    Args:
        path: Folder of a rosbag2, or its .mcap or .db3 file; or a rosbag1's .bag file.
        topics: Which ones.
        columns: Those that are needed.

    Raises:
        RecordingError: the bag cannot be read, or lacks a topic.
    """
    bag = read_bag(path, {topics.states, topics.commands})
    states = bag.table(topics.states, columns)
    same = topics.commands == topics.states
    return states, states if same else bag.table(topics.commands, columns)


def read_bag(path: Path, topics: Iterable[str] | None = None) -> Bag:
    """Returns a bag's messages.

    Args:
        path: As `bag_tables` takes it.
        topics: Those to read; all that are understood where None.

    Raises:
        RecordingError: no bag, or damaged; a topic is missing, empty or of a type that is not
            understood.
        ConfigError: the package `rosbags` is not installed.
    """
    highlevel = needed("rosbags.highlevel", "ROS bags")
    try:
        with highlevel.AnyReader([path], default_typestore=_definitions()) as reader:
            types = {c.topic: str(c.msgtype) for c in reader.connections}
            chosen = [t for t in types if types[t] in ROW_OF] if topics is None else sorted(topics)
            for topic in chosen:
                _check_topic(path, topic, types)
            rows = _rows(path, reader, chosen)
    except _damage() as exc:
        expected = "a whole ROS bag: a folder with metadata.yaml, .mcap, .db3 or .bag"
        raise RecordingError(str(path), f"cannot be read ({_first_line(exc)})", expected) from exc
    empty = [topic for topic in chosen if not rows[topic]]
    if topics is not None and empty:
        raise RecordingError(f"{path}: topic {empty[0]}", "has no messages", "joints")
    return Bag(path=path, digest=_digest(path), types=types, rows=rows)


def _definitions() -> Any:  # noqa: ANN401
    """Returns ROS 2's own message types, for bags that do not define theirs."""
    typesys = needed("rosbags.typesys", "ROS bags")
    return typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)


def _damage() -> tuple[type[Exception], ...]:
    """Returns what reading a damaged bag raises, by the modules of `rosbags` and beside them."""
    own = tuple(getattr(needed(module, "ROS bags"), name) for module, name in _ERRORS)
    return (*own, OSError, EOFError, ArithmeticError, AssertionError, LookupError, *_OF_BYTES)


def _first_line(exc: Exception) -> str:
    return str(exc).partition("\n")[0] or type(exc).__name__


def _check_topic(path: Path, topic: str, types: Mapping[str, str]) -> None:
    where = f"{path}: topic {topic}"
    if topic not in types:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())) or "none"
        raise RecordingError(where, "is missing", f"one of the topics in the bag: {there}")
    if types[topic] not in ROW_OF:
        raise RecordingError(where, f"is {types[topic]}", " or ".join(ROW_OF))


def _rows(path: Path, reader: AnyReader, topics: Sequence[str]) -> dict[str, list[Row]]:
    rows: dict[str, list[Row]] = {topic: [] for topic in topics}
    connections = [c for c in reader.connections if c.topic in rows]
    for connection, log_ns, data in reader.messages(connections) if connections else ():
        message: Any = reader.deserialize(data, connection.msgtype)
        times = {LOG_TIME: log_ns}
        if hasattr(message, "header"):
            stamp = message.header.stamp
            times[STAMP] = stamp.sec * _SECOND_NS + stamp.nanosec
        try:
            rows[connection.topic].append(times | ROW_OF[connection.msgtype](message))
        except ValueError as exc:
            where = f"{path}: topic {connection.topic}: message {len(rows[connection.topic])}"
            raise RecordingError(where, str(exc), "a value for each joint") from exc
    return rows


def _digest(path: Path) -> str:
    """Returns the hash of a file, or of all files in a folder, by name."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    whole = hashlib.sha256()
    for file in files:
        whole.update(file.read_bytes())
    return whole.hexdigest()
