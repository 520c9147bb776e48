"""JSON: a list of rows, alone or under a key of a document."""

from __future__ import annotations

import json

from gfm.recording.formats.columns import Columns


def read_json(content: bytes, key: str) -> Columns:
    """Returns the columns of the rows under `key`; the rest of the document is the header."""
    document = json.loads(content.decode())
    rows = document[key] if key else document
    if not rows:
        return Columns()
    names = list(rows[0])
    for number, row in enumerate(rows, start=1):
        if missing := [name for name in names if name not in row]:
            raise ValueError(f"row {number} lacks {', '.join(missing)}")
    header = {k: v for k, v in document.items() if k != key} if key else {}
    return Columns(cells={name: [row[name] for row in rows] for name in names}, header=header)
