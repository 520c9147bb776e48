"""ROS bags as tables, one for each topic: rosbag2 (MCAP, sqlite3) and rosbag1.

Every table has the columns `log_time`, when the recorder received a message, and `stamp`, what its
header says, where it has one; both in whole nanoseconds.
"""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gfm.core import RecordingError
from gfm.core.extras import needed
from gfm.importing.controller_state import define_controller_state
from gfm.importing.mapping import Topics
from gfm.importing.ros_messages import ROW_OF, Row
from gfm.importing.tables import Table

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

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
        problems: Why topics that were not asked for cannot be used.
    """

    path: Path
    digest: str
    types: Mapping[str, str]
    rows: Mapping[str, Sequence[Row]]
    problems: Mapping[str, RecordingError]

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


def read_bag(path: Path, topics: Collection[str] | None = None) -> Bag:
    """Returns a bag's messages.

    Args:
        path: As `bag_tables` takes it.
        topics: Those to read; where None, all that can be.

    Raises:
        RecordingError: no bag, or damaged; a topic is missing, empty, or of no use.
        ConfigError: the package `rosbags` is not installed.
    """
    highlevel = needed("rosbags.highlevel", "ROS bags need", "formats")
    try:
        with highlevel.AnyReader([path], default_typestore=_definitions()) as reader:
            define_controller_state(reader, _definitions)
            types = {c.topic: str(c.msgtype) for c in reader.connections}
            rows = {topic: list[Row]() for topic in (types if topics is None else sorted(topics))}
            problems = {t: p for t in rows if (p := _problem(path, t, types, reader)) is not None}
            _read_rows(path, reader, rows, problems)
    except _damage() as exc:
        expected = "a whole ROS bag: a folder with metadata.yaml, .mcap, .db3 or .bag"
        raise RecordingError(str(path), f"cannot be read ({_first_line(exc)})", expected) from exc
    for topic in rows.keys() - problems.keys():
        if not rows[topic]:
            problems[topic] = RecordingError(f"{path}: topic {topic}", "has no messages", "joints")
    if problems and topics is not None:
        raise problems[min(problems)]
    usable = {topic: read for topic, read in rows.items() if topic not in problems}
    return Bag(path=path, digest=_digest(path), types=types, rows=usable, problems=problems)


def _definitions() -> Typestore:
    """Returns ROS 2's own message types, for bags that do not define theirs."""
    typesys = needed("rosbags.typesys", "ROS bags need", "formats")
    store: Typestore = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    return store


def _damage() -> tuple[type[Exception], ...]:
    """Returns what reading a damaged bag raises, by the modules of `rosbags` and beside them."""
    modules = ((needed(module, "ROS bags need", "formats"), name) for module, name in _ERRORS)
    own = tuple(getattr(module, name) for module, name in modules)
    return (*own, OSError, EOFError, ArithmeticError, AssertionError, LookupError, *_OF_BYTES)


def _first_line(exc: Exception) -> str:
    return str(exc).partition("\n")[0] or type(exc).__name__


def _problem(
    path: Path, topic: str, types: Mapping[str, str], reader: AnyReader
) -> RecordingError | None:
    """Returns why a topic cannot be read, if so."""
    where = f"{path}: topic {topic}"
    if topic not in types:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())) or "none"
        return RecordingError(where, "is missing", f"one of the topics in the bag: {there}")
    if types[topic] not in ROW_OF:
        return RecordingError(where, f"is {types[topic]}", " or ".join(ROW_OF))
    if types[topic] not in reader.typestore.fielddefs:
        problem = f"is {types[topic]}, which the bag does not define"
        return RecordingError(where, problem, "its definition, as MCAP has it (ros2 bag convert)")
    return None


def _read_rows(
    path: Path,
    reader: AnyReader,
    rows: Mapping[str, list[Row]],
    problems: dict[str, RecordingError],
) -> None:
    """Adds the messages of topics without problems to their rows; or their first problem."""
    connections = [c for c in reader.connections if c.topic in rows.keys() - problems.keys()]
    for connection, log_ns, data in reader.messages(connections) if connections else ():
        topic = connection.topic
        message: Any = reader.deserialize(data, connection.msgtype)
        times = {LOG_TIME: log_ns}
        if hasattr(message, "header"):
            stamp = message.header.stamp
            times[STAMP] = stamp.sec * _SECOND_NS + stamp.nanosec
        try:
            rows[topic].append(times | ROW_OF[connection.msgtype](message))
        except ValueError as exc:
            where = f"{path}: topic {topic}: message {len(rows[topic])}"
            problems.setdefault(topic, RecordingError(where, str(exc), "a value for each joint"))


def _digest(path: Path) -> str:
    """Returns the hash of a file; of a folder, that of its files' hashes, by name."""
    if path.is_dir():
        return hashlib.sha256("".join(map(_digest, sorted(path.iterdir()))).encode()).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
