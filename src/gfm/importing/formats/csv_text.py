"""CSV: the first line names the columns."""

from __future__ import annotations

import csv
import io

from gfm.importing.formats.columns import Columns


def read_csv(content: bytes, _rows: str) -> Columns:
    """Returns the columns of a CSV file; cells are texts."""
    rows = [row for row in csv.reader(io.StringIO(content.decode())) if row]
    if len(rows) < 2:
        return Columns()
    names = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            raise ValueError(f"row {number} has {len(row)} cells for {len(names)} columns")
    cells = zip(*rows[1:], strict=True)
    return Columns(cells={name: list(column) for name, column in zip(names, cells, strict=True)})
