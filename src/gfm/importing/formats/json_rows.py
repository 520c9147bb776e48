"""JSON: a list of rows, alone, under a key of a document, or a line each; or lists as columns."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from gfm.importing.formats.columns import Columns, columns_of_arrays


def read_json(content: bytes, key: str) -> Columns:
    """Returns the columns of the rows under `key`; the rest of the document is the header.

    Without a key they are the document, or its only list of rows; where it has no rows, its lists
    are columns.
    """
    document: Any = _document(content.decode())
    if isinstance(document, dict) and not key:
        key = _only_list(document)
        if not key:
            return _lists(document)
    rows = document[key] if key else document
    if not rows:
        return Columns()
    names = list(rows[0])
    for number, row in enumerate(rows, start=1):
        if missing := [name for name in names if name not in row]:
            raise ValueError(f"row {number} lacks {', '.join(missing)}")
    header = {k: v for k, v in document.items() if k != key} if key else {}
    return Columns(cells={name: [row[name] for row in rows] for name in names}, header=header)


def _document(text: str) -> object:
    """Returns what a text holds: one document, or a row in every line."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        lines = [line for line in text.splitlines() if line.strip()]
        if len(lines) < 2 or not lines[0].rstrip().endswith("}"):
            raise
        return [json.loads(line) for line in lines]


def _only_list(document: Mapping[str, Any]) -> str:
    """Returns the key of a document's rows; none where it has no list of them."""
    lists = [k for k, v in document.items() if isinstance(v, list) and v and isinstance(v[0], dict)]
    if len(lists) > 1:
        raise ValueError(f"rows under one of {', '.join(document)}? `rows` says which")
    return lists[0] if lists else ""


def _lists(document: Mapping[str, Any]) -> Columns:
    return columns_of_arrays({name: np.asarray(value) for name, value in document.items()})
