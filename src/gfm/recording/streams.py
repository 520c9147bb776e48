"""From the JointState messages of one topic to arrays, with every check that a topic allows.

Shape letters: T messages, J joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gfm.core import CommandKind, RecordingError
from gfm.core.checks import Array, Stamps

_SECOND_NS = 1_000_000_000
#: ROS 2 stamps are int32 seconds; where a file does not define them, the decoder takes them as
#: unsigned, so that negative ones show as this or more.
_LAST_STAMP_S = 2**31
_LONGEST_GAP_S = 10.0
_LONGEST_WAIT_S = 60.0


@dataclass(frozen=True, kw_only=True)
class JointStream:
    """One topic of joint states.

    Attributes:
        path: The file, for messages.
        topic: The topic.
        joint_names: As the first message orders them.
        stamp_ns: Strictly increasing, shape (T,).
        fields: The non-empty fields among position, velocity, effort, each of shape (T, J).
    """

    path: Path
    topic: str
    joint_names: tuple[str, ...]
    stamp_ns: Stamps
    fields: dict[str, Array]

    @property
    def stamps(self) -> tuple[str, Stamps]:
        """Where the stamps lie, for messages, and the stamps."""
        return f"{self.path}: topic {self.topic}: field header.stamp", self.stamp_ns

    def setpoint_kind(self) -> CommandKind:
        """Returns what the one non-empty field of a command topic says."""
        if len(self.fields) != 1:
            got = " and ".join(self.fields) or "no field"
            expected = "exactly one of position, velocity, effort (the kind of the command)"
            raise RecordingError(f"{self.path}: topic {self.topic}", f"{got} filled", expected)
        return CommandKind(next(iter(self.fields)))

    def ordered(self, field: str, joint_names: Sequence[str]) -> Array:
        """Returns one field with columns as in `joint_names`, 0 where a joint is not in it."""
        if field not in self.fields:
            got = f"has {', '.join(self.fields) or 'nothing'} filled"
            raise RecordingError(f"{self.path}: topic {self.topic}", got, f"field {field}")
        values = np.zeros((len(self.stamp_ns), len(joint_names)))
        for column, name in enumerate(joint_names):
            if name in self.joint_names:
                values[:, column] = self.fields[field][:, self.joint_names.index(name)]
        return values


def joint_stream(
    path: Path, topic: str, messages: Sequence[Any], *, wished: bool = False
) -> JointStream:
    """Returns the arrays of one topic.

    Args:
        path: The file, for messages.
        topic: The topic, for messages.
        messages: sensor_msgs/msg/JointState, at least one.
        wished: Whether that is what somebody asked for, not what happened: NaN and infinity are
            taken, and a field may be empty in some messages, where it is NaN.
    """
    where = f"{path}: topic {topic}"
    stamp_ns = stamps_of(where, messages)
    names = tuple(messages[0].name)
    if not names or len(set(names)) != len(names):
        problem = f"first message names joints {list(names)}"
        raise RecordingError(f"{where}: field name", problem, "each joint once, at least one")
    orders = _orders(where, names, messages)
    fields = {str(kind): _field(where, kind, messages, orders, gaps=wished) for kind in CommandKind}
    filled = {kind: values for kind, values in fields.items() if values is not None}
    if not wished:
        for kind, values in filled.items():
            _check_finite(where, kind, values, names)
    return JointStream(path=path, topic=topic, joint_names=names, stamp_ns=stamp_ns, fields=filled)


def stamps_of(where: str, messages: Sequence[Any]) -> Stamps:
    """Returns the header stamps in nanoseconds, checked: strictly increasing, no absurd ones."""
    stamps = [message.header.stamp for message in messages]
    seconds = np.array([stamp.sec for stamp in stamps], np.int64)
    nanoseconds = np.array([stamp.nanosec for stamp in stamps], np.int64)
    where = f"{where}: field header.stamp"
    absurd = (seconds < 0) | (seconds >= _LAST_STAMP_S) | (nanoseconds >= _SECOND_NS)
    if absurd.any():
        i = int(absurd.argmax())
        problem = f"message {i} has {stamps[i].sec} s {stamps[i].nanosec} ns"
        raise RecordingError(where, problem, "0 <= sec < 2^31, nanosec < 10^9")
    stamp_ns = seconds * _SECOND_NS + nanoseconds
    gap_s = np.diff(stamp_ns) * 1e-9
    if (gap_s <= 0.0).any():
        i = int((gap_s <= 0.0).argmax()) + 1
        problem = f"message {i} is stamped {abs(gap_s[i - 1]):.6f} s before the one before it"
        raise RecordingError(where, problem, "strictly increasing stamps")
    return stamp_ns


def check_one_clock(states: tuple[str, Stamps], commands: tuple[str, Stamps]) -> None:
    """Refuses gaps that no robot makes, and streams that cannot be stamped by one clock.

    Args:
        states: Where the measurements' stamps lie, for messages; the stamps.
        commands: The same of the commands.
    """
    (where, stamp_ns), (command_where, command_stamp_ns) = states, commands
    gap_s = np.diff(stamp_ns) * 1e-9
    if gap_s.max() > _LONGEST_GAP_S:
        i = int(gap_s.argmax()) + 1
        problem = f"message {i} comes {gap_s[i - 1]:.3f} s after the one before it"
        expected = f"gaps of at most {_LONGEST_GAP_S:.0f} s (are the stamps sec and nanosec?)"
        raise RecordingError(where, problem, expected)
    first_s, last_s = (stamp_ns[[0, -1]] - stamp_ns[0]) * 1e-9
    begin_s, end_s = (command_stamp_ns[[0, -1]] - stamp_ns[0]) * 1e-9
    if begin_s > last_s or end_s < first_s - _LONGEST_WAIT_S:
        problem = f"commands run from {begin_s:.3f} s to {end_s:.3f} s"
        expected = f"the clock of the measurements ({where}), which run from 0 s to {last_s:.3f} s"
        raise RecordingError(command_where, problem, expected)


def _orders(
    where: str, names: tuple[str, ...], messages: Sequence[Any]
) -> dict[tuple[str, ...], list[int]]:
    """Returns, for every order of names that occurs, the places of `names` in it."""
    orders: dict[tuple[str, ...], list[int]] = {}
    for i, message in enumerate(messages):
        order = tuple(message.name)
        if order in orders:
            continue
        if sorted(order) != sorted(names):
            problem = f"message {i} names {', '.join(order) or 'no joint'}"
            expected = f"the joints of the first message: {', '.join(names)}"
            raise RecordingError(f"{where}: field name", problem, expected)
        orders[order] = [order.index(name) for name in names]
    return orders


def _field(
    where: str,
    kind: CommandKind,
    messages: Sequence[Any],
    orders: dict[tuple[str, ...], list[int]],
    *,
    gaps: bool,
) -> Array | None:
    """Returns one field, shape (T, J), or None where every message leaves it empty.

    Where only some do, and gaps are allowed, it is NaN there.
    """
    size = len(messages[0].name)
    rows = [getattr(message, kind) for message in messages]
    wrong = [i for i, row in enumerate(rows) if len(row) not in (0, size)]
    empty = [i for i, row in enumerate(rows) if len(row) == 0]
    if wrong or (0 < len(empty) < len(rows) and not gaps):
        i = wrong[0] if wrong else empty[0]
        problem = f"message {i} has {len(rows[i])} values for {size} joints"
        expected = f"{size} values in every message, or none in any"
        raise RecordingError(f"{where}: field {kind}", problem, expected)
    if len(empty) == len(rows):
        return None
    values = np.array([list(row) or [np.nan] * size for row in rows], np.float64)
    if len(orders) == 1:
        return values
    columns = np.array([orders[tuple(message.name)] for message in messages])
    return np.asarray(np.take_along_axis(values, columns, axis=1))


def _check_finite(where: str, kind: str, values: Array, names: tuple[str, ...]) -> None:
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        i, joint = bad[0]
        problem = f"message {i}, joint {names[joint]} is {values[i, joint]}"
        raise RecordingError(f"{where}: field {kind}", problem, "finite numbers (or no field)")
