"""Tables as other tools write them, in any of `TABLE_FORMATS`; also gzipped."""

from __future__ import annotations

import gzip
import hashlib
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gfm.core import RecordingError
from gfm.core.checks import Array, Stamps
from gfm.importing.formats import TABLE_FORMATS
from gfm.importing.mapping import Column

#: Recordings are stamped with int32 seconds.
LAST_STAMP_S = 2**31


@dataclass(frozen=True, kw_only=True)
class Table:
    """One file.

    Attributes:
        path: The file.
        digest: SHA-256 of its bytes.
        columns: Cells by column.
        header: What the file says about itself beside the rows.
        place: Where in the file it lies, if that holds several.
    """

    path: Path
    digest: str
    columns: Mapping[str, list[Any]]
    header: Mapping[str, Any] = field(default_factory=dict)
    place: str = ""

    @property
    def where(self) -> str:
        """File and place, for messages."""
        return f"{self.path}: {self.place}" if self.place else str(self.path)

    @cached_property
    def _lists(self) -> dict[str, list[Any]]:
        return {}

    def texts(self, name: str) -> list[str]:
        """Returns the cells of one column in lower case; JSON's booleans are true and false."""
        return [str(cell).strip().lower() for cell in self._cells(name)]

    def numbers(self, column: Column) -> Array:
        """Returns one signal in its target unit, shape (rows,); refuses what is no number.

        Dates count in s.
        """
        cells = self._cells(column.column)
        if column.index is not None:
            cells = self._elements(column.column, column.index)
        try:
            values = np.array([float(cell) for cell in cells])
        except (TypeError, ValueError):
            values = np.array([_number_or_nan(cell) for cell in cells])
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            where = f"{self.where}: column {column.column}: row {bad[0] + 1}"
            raise RecordingError(where, f"is {cells[bad[0]]!r}", "a finite number")
        if column.wrap is not None:
            values = np.where(values >= column.wrap / 2, values - column.wrap, values)
        return np.asarray(column.scale * values + column.offset)

    def stamps_ns(self, column: Column) -> Stamps:
        """Returns times in nanoseconds, shape (rows,); whole numbers of whole ns stay exact."""
        time_s = self.numbers(column)
        if len(time_s) == 0:
            raise RecordingError(f"{self.where}: column {column.column}", "has no rows", "times")
        last_s = float(np.abs(time_s).max())
        if last_s >= LAST_STAMP_S:
            where = f"{self.where}: column {column.column}"
            expected = "less than 2^31 s (does time.scale turn it into seconds?)"
            raise RecordingError(where, f"reaches {last_s:.3g} s", expected)
        unit_ns, cells = column.scale * 1e9, self._cells(column.column)
        whole = round(unit_ns) >= 1 and np.isclose(unit_ns, round(unit_ns), rtol=1e-12)
        if whole and all(type(cell) is int for cell in cells):
            return np.array(cells, np.int64) * round(unit_ns) + round(column.offset * 1e9)
        return np.rint(time_s * 1e9).astype(np.int64)

    def _cells(self, name: str) -> list[Any]:
        if name not in self.columns:
            there = ", ".join(self.columns) or "none"
            problem, expected = "is missing", f"one of the columns in the file: {there}"
            raise RecordingError(f"{self.where}: column {name}", problem, expected)
        return self.columns[name]

    def _elements(self, name: str, index: int) -> list[Any]:
        """Returns one element of every cell of a column of bracketed lists."""
        if name not in self._lists:
            self._lists[name] = [_as_list(cell) for cell in self._cells(name)]
        lists = self._lists[name]
        short = [row for row, cell in enumerate(lists) if not 0 <= index < len(cell)]
        if short:
            where = f"{self.where}: column {name}: row {short[0] + 1}"
            problem = f"is {self._cells(name)[short[0]]!r}"
            raise RecordingError(where, problem, f"a list of at least {index + 1} numbers")
        return [cell[index] for cell in lists]


def read_table(path: Path, file_format: str, rows: str = "") -> Table:
    """Returns a file's columns.

    Args:
        path: The file; one that ends in .gz is decompressed.
        file_format: One of `TABLE_FORMATS`.
        rows: json: the key of the list of rows; empty where the file is that list, or has no other.

    Raises:
        RecordingError: no such file, or damaged, or of another format.
        ConfigError: the format needs a package that is not installed.
    """
    content = _content(path)
    try:
        columns = TABLE_FORMATS[file_format](content, rows)
    except (ValueError, TypeError, KeyError) as exc:
        raise RecordingError(str(path), f"cannot be read as {file_format} ({exc})", "rows") from exc
    if not any(columns.cells.values()):
        raise RecordingError(str(path), "has no rows", "a table")
    digest = hashlib.sha256(content).hexdigest()
    return Table(path=path, digest=digest, columns=columns.cells, header=columns.header)


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
        return gzip.decompress(content) if path.suffix == ".gz" else content
    except (gzip.BadGzipFile, EOFError, zlib.error) as exc:
        raise RecordingError(str(path), f"damaged gzip ({exc})", "a whole file") from exc
    except OSError as exc:
        raise RecordingError(str(path), exc.strerror or str(exc), "a readable file") from exc


def _as_list(cell: object) -> list[Any]:
    if isinstance(cell, list):
        return cell
    try:
        value = json.loads(str(cell))
    except ValueError:
        return []
    return value if isinstance(value, list) else []


def _number_or_nan(cell: object) -> float:
    try:
        return float(cell)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return _seconds_or_nan(cell)


def _seconds_or_nan(cell: object) -> float:
    """Returns the seconds since 1970 of a date and time in ISO 8601; UTC where it says no zone."""
    try:
        date = datetime.fromisoformat(str(cell).strip())
    except ValueError:
        return np.nan
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()
