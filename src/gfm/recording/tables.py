"""Tables as other tools write them: CSV, or JSON with a header and rows; also gzipped."""

from __future__ import annotations

import csv
import gzip
import hashlib
import io
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from gfm.core import RecordingError
from gfm.core.checks import Array
from gfm.recording.mapping import Column


@dataclass(frozen=True, kw_only=True)
class Table:
    """One file.

    Attributes:
        path: The file.
        digest: SHA-256 of its bytes.
        columns: Cells by column, all of the same length.
        header: What the file says about itself beside the rows.
    """

    path: Path
    digest: str
    columns: Mapping[str, list[Any]]
    header: Mapping[str, Any] = field(default_factory=dict)

    @cached_property
    def _lists(self) -> dict[str, list[Any]]:
        return {}

    def texts(self, name: str) -> list[str]:
        """Returns the cells of one column in lower case; JSON's booleans are true and false."""
        return [str(cell).strip().lower() for cell in self._cells(name)]

    def numbers(self, column: Column) -> Array:
        """Returns one signal in its target unit, shape (rows,); refuses what is no number."""
        cells = self._cells(column.column)
        if column.index is not None:
            cells = self._elements(column.column, column.index)
        try:
            values = np.array([float(cell) for cell in cells])
        except (TypeError, ValueError):
            values = np.array([_number_or_nan(cell) for cell in cells])
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad):
            where = f"{self.path}: column {column.column}: row {bad[0] + 1}"
            raise RecordingError(where, f"is {cells[bad[0]]!r}", "a finite number")
        if column.wrap is not None:
            values = np.where(values >= column.wrap / 2, values - column.wrap, values)
        return np.asarray(column.scale * values + column.offset)

    def _cells(self, name: str) -> list[Any]:
        if name not in self.columns:
            there = ", ".join(self.columns) or "none"
            problem, expected = "is missing", f"one of the columns in the file: {there}"
            raise RecordingError(f"{self.path}: column {name}", problem, expected)
        return self.columns[name]

    def _elements(self, name: str, index: int) -> list[Any]:
        """Returns one element of every cell of a column of bracketed lists."""
        if name not in self._lists:
            self._lists[name] = [_as_list(cell) for cell in self._cells(name)]
        lists = self._lists[name]
        short = [row for row, cell in enumerate(lists) if not 0 <= index < len(cell)]
        if short:
            where = f"{self.path}: column {name}: row {short[0] + 1}"
            problem = f"is {self._cells(name)[short[0]]!r}"
            raise RecordingError(where, problem, f"a list of at least {index + 1} numbers")
        return [cell[index] for cell in lists]


def read_table(path: Path, file_format: str, rows: str = "") -> Table:
    """Returns a file's columns.

    Args:
        path: The file; one that ends in .gz is decompressed.
        file_format: csv or json.
        rows: json: the key of the list of rows; empty where the file is that list.
    """
    content = _content(path)
    try:
        text = content.decode()
        columns, header = _from_csv(text) if file_format == "csv" else _from_json(text, rows)
    except (ValueError, TypeError, KeyError) as exc:
        raise RecordingError(str(path), f"cannot be read as {file_format} ({exc})", "rows") from exc
    if not columns:
        raise RecordingError(str(path), "has no rows", "a table")
    digest = hashlib.sha256(content).hexdigest()
    return Table(path=path, digest=digest, columns=columns, header=header)


def _content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
        return gzip.decompress(content) if path.suffix == ".gz" else content
    except (gzip.BadGzipFile, EOFError, zlib.error) as exc:
        raise RecordingError(str(path), f"damaged gzip ({exc})", "a whole file") from exc
    except OSError as exc:
        raise RecordingError(str(path), exc.strerror or str(exc), "a readable file") from exc


def _from_csv(text: str) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    rows = [row for row in csv.reader(io.StringIO(text)) if row]
    if len(rows) < 2:
        return {}, {}
    names = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            raise ValueError(f"row {number} has {len(row)} cells for {len(names)} columns")
    cells = zip(*rows[1:], strict=True)
    return {name: list(column) for name, column in zip(names, cells, strict=True)}, {}


def _from_json(text: str, key: str) -> tuple[dict[str, list[Any]], dict[str, Any]]:
    document = json.loads(text)
    rows = document[key] if key else document
    if not rows:
        return {}, {}
    names = list(rows[0])
    for number, row in enumerate(rows, start=1):
        if missing := [name for name in names if name not in row]:
            raise ValueError(f"row {number} lacks {', '.join(missing)}")
    header = {k: v for k, v in document.items() if k != key} if key else {}
    return {name: [row[name] for row in rows] for name in names}, header


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
        return np.nan
