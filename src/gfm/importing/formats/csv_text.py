"""CSV: the first line names the columns, and tells what separates them."""

from __future__ import annotations

import csv
import re

from gfm.importing.formats.columns import Columns

_SEPARATORS = ",;\t"
_NUMBER = re.compile(r"\s*[-+]?\.?\d")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")


def read_csv(content: bytes, _rows: str) -> Columns:
    """Returns the columns of a CSV file; cells are texts.

    Separators are commas, semicolons (numbers may then have a decimal comma), tabs, or, in a file
    with none of these in its first line, spaces. Lines before it that begin with # are remarks;
    where numbers follow at once, the last of them is the first line, as NumPy's savetxt has it.
    """
    lines = content.decode("utf-8-sig").splitlines(keepends=True)
    remark = ""
    while lines and lines[0].startswith("#"):
        remark = lines.pop(0)
    if remark and lines and _NUMBER.match(lines[0]):
        lines.insert(0, remark.lstrip("# "))
    separator = _separator(lines[0] if lines else "")
    reader = csv.reader(lines, delimiter=separator, skipinitialspace=separator == " ")
    rows = [row for row in reader if row]
    if len(rows) < 2:
        return Columns()
    names = [name.strip() for name in rows[0]]
    for number, row in enumerate(rows[1:], start=1):
        if len(row) != len(names):
            raise ValueError(f"row {number} has {len(row)} cells for {len(names)} columns")
    columns = [list(column) for column in zip(*rows[1:], strict=True)]
    if separator == ";":
        columns = [[_with_point(cell) for cell in column] for column in columns]
    return Columns(cells=dict(zip(names, columns, strict=True)))


def _separator(head: str) -> str:
    """Returns what the first line has most of."""
    most = max(_SEPARATORS, key=head.count)
    return most if most in head or " " not in head.strip() else " "


def _with_point(cell: str) -> str:
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell.strip()) else cell
