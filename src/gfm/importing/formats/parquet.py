"""Apache Parquet: columns of numbers, or of lists of numbers."""

from __future__ import annotations

import io

from gfm.core.extras import needed
from gfm.importing.formats.columns import Columns


def read_parquet(content: bytes, _rows: str) -> Columns:
    """Returns the columns of a Parquet file.

    Fields of a structure are named STRUCTURE.FIELD; time stamps are whole nanoseconds.
    """
    arrow = needed("pyarrow", "Parquet files need", "formats")
    parquet = needed("pyarrow.parquet", "Parquet files need", "formats")
    table = parquet.read_table(io.BytesIO(content))
    while any(arrow.types.is_struct(kind) for kind in table.schema.types):
        table = table.flatten()
    cells = {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        dated = arrow.types.is_timestamp(column.type)
        numbers = column.cast(arrow.timestamp("ns")).cast(arrow.int64()) if dated else column
        cells[name] = numbers.to_pylist()
    return Columns(cells=cells)
