"""JSON: a list of rows, alone or under a key of a document."""

from __future__ import annotations

import json

from gfm.importing.formats.columns import Columns


def read_json(content: bytes, key: str) -> Columns:
    """Returns the columns of the rows under `key`; the rest of the document is the header.

    Without a key they are the document, or its only list of rows.
    """
    document = json.loads(content.decode())
    key = key or _only_list(document)
    rows = document[key] if key else document
    if not rows:
        return Columns()
    names = list(rows[0])
    for number, row in enumerate(rows, start=1):
        if missing := [name for name in names if name not in row]:
            raise ValueError(f"row {number} lacks {', '.join(missing)}")
    header = {k: v for k, v in document.items() if k != key} if key else {}
    return Columns(cells={name: [row[name] for row in rows] for name in names}, header=header)


def _only_list(document: object) -> str:
    if not isinstance(document, dict):
        return ""
    lists = [k for k, v in document.items() if isinstance(v, list) and v and isinstance(v[0], dict)]
    if len(lists) != 1:
        raise ValueError(f"rows under one of {', '.join(document)}? `rows` says which")
    return str(lists[0])
