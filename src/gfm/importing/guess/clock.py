"""Which column tells the time, and in which unit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gfm.core import RecordingError
from gfm.core.checks import Array
from gfm.importing.guess.lines import Line, column_text
from gfm.importing.guess.names import words
from gfm.importing.mapping import Column
from gfm.importing.ros_bag import LOG_TIME, STAMP
from gfm.importing.tables import Table

TIMES = frozenset(
    ("seconds", "secs", "stamp", "t", "time", "times", "timestamp", "timestamps", "ts")
)
_UNITS = {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0, "sec": 1.0}
#: Rows of a robot are so far apart, s.
_LEAST_S, _MOST_S = 2e-4, 0.2
#: Clocks that differ by more are not the same, ns.
_SAME_CLOCK_NS = 1_000_000_000


def time_line(table: Table) -> Line:
    """Returns the line `time` of a table.

    Raises:
        RecordingError: no column is named as a time and increases by a robot's period.
    """
    tried: dict[str, Array] = {}
    for name, cells in table.columns.items():
        said = set(words(name))
        if not said & TIMES or not cells or isinstance(cells[0], list):
            continue
        tried[name] = table.numbers(Column(column=name))
        steps = np.diff(tried[name])
        scale = _scale(said, steps)
        if scale is not None:
            period_ms = 1e3 * scale * float(np.median(steps))
            text = f"time = {column_text(name, None, scale)}"
            return Line(text=text, why=f"increases, by {period_ms:.4g} ms typically")
    raise _no_time(table, tried)


def _no_time(table: Table, tried: Mapping[str, Array]) -> RecordingError:
    """Returns what keeps the first column that is named as a time from being one."""
    for name, time in tried.items():
        where, back = f"{table.where}: column {name}", np.flatnonzero(np.diff(time) <= 0)
        if len(back):
            row = int(back[0]) + 1
            problem = f"row {row + 1} is {time[row]:.10g} after {time[row - 1]:.10g}"
            return RecordingError(where, problem, "times that increase in every row")
        step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        expected = f"{_LEAST_S:g} to {_MOST_S:g} s, in s, ms, us or ns (a mapping gives any scale)"
        return RecordingError(where, f"rows are {step:.3g} apart", expected)
    there = ", ".join(table.columns)
    expected = f"a column named as a time (time, t, stamp ...) that increases, among {there}"
    return RecordingError(table.where, "no column tells the time", expected)


def _scale(said: set[str], steps: Array) -> float | None:
    """Returns from a column's unit to s, by its name or by its steps."""
    if len(steps) == 0 or not (steps > 0).all():
        return None
    named = [scale for unit, scale in _UNITS.items() if unit in said]
    step = float(np.median(steps))
    tried = named or [1.0, 1e-3, 1e-6, 1e-9]
    return next((scale for scale in tried if _LEAST_S <= scale * step <= _MOST_S), None)


def bag_time_lines(states: Table, commands: Table) -> list[Line]:
    """Returns the lines `time`, and `command_time` where commands have another column.

    Stamps of headers count, where they were set and where both can be on one clock.
    """
    column = STAMP if _is_set(states) else LOG_TIME
    command_column = STAMP if _is_set(commands) else LOG_TIME
    why = {STAMP: "of the header", LOG_TIME: "when the recorder got it: no stamp in the header"}
    if column == STAMP and command_column == LOG_TIME and _another_clock(states):
        column = LOG_TIME
        why[LOG_TIME] = "when the recorder got it: headers run on another clock"
    lines = [Line(text=f"time = {column_text(column, None, 1e-9)}", why=why[column])]
    if command_column != column:
        text = f"command_time = {column_text(command_column, None, 1e-9)}"
        lines.append(Line(text=text, why=why[command_column]))
    return lines


def _is_set(table: Table) -> bool:
    return STAMP in table.columns and any(table.columns[STAMP])


def _another_clock(table: Table) -> bool:
    pairs = zip(table.columns[STAMP], table.columns[LOG_TIME], strict=True)
    apart_ns = sorted(abs(stamp - log) for stamp, log in pairs)
    return bool(apart_ns[len(apart_ns) // 2] > _SAME_CLOCK_NS)
