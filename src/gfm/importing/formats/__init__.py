"""Formats of tables: one module each, one function from bytes to columns."""

from gfm.importing.formats.columns import Columns
from gfm.importing.formats.csv_text import read_csv
from gfm.importing.formats.json_rows import read_json
from gfm.importing.formats.matlab import read_mat
from gfm.importing.formats.numpy_npz import read_npz
from gfm.importing.formats.parquet import read_parquet

#: By the name that a mapping gives them. Each takes the file's bytes and the key of json's rows,
#: and raises ValueError, TypeError or KeyError where the bytes are no such table.
TABLE_FORMATS = {
    "csv": read_csv,
    "json": read_json,
    "mat": read_mat,
    "npz": read_npz,
    "parquet": read_parquet,
}

#: What else files of these formats are called.
ALSO_NAMED = {"jsonl": "json", "ndjson": "json", "tsv": "csv", "txt": "csv"}

__all__ = ["ALSO_NAMED", "TABLE_FORMATS", "Columns"]
