"""Messages that are well formed and mean harm: the largest numbers, the longest texts."""

from __future__ import annotations

from typing import Any

import numpy as np

from gfm_wire import Message
from gfm_wire.kinds import (
    INT64_MAX,
    Array,
    Choice,
    Flag,
    Integer,
    ListOf,
    MapOf,
    Number,
    Optional,
    Text,
)
from gfm_wire.schema import Schema

SIZES = {"T": 10, "T+1": 11, "B": 8, "O": 2, "A": 1, "J": 1, "K": 3}


def worst(schema: Schema[Any]) -> Message:
    """Returns the message of a schema with extreme values in shapes that fit a point mass."""
    return schema.value_type(**{name: _worst(kind) for name, kind in schema.kinds.items()})


def _worst(kind: object) -> Any:
    if isinstance(kind, Schema):
        return worst(kind)
    if isinstance(kind, Array):
        letters = (kind.letters or "2 2").split()
        shape = [SIZES[size] if size in SIZES else int(size) for size in letters]
        largest = INT64_MAX if kind.dtype == "<i8" else np.finfo(kind.dtype).max
        return np.full(shape, largest, kind.dtype)
    if isinstance(kind, ListOf):
        return (_worst(kind.item),)
    if isinstance(kind, MapOf):
        return {"x" * 4096: _worst(kind.item)}
    if isinstance(kind, Optional):
        return _worst(kind.item)
    if isinstance(kind, Choice):
        return next(iter(kind.words))
    simple = {Flag: True, Integer: INT64_MAX, Number: 1e300, Text: "x" * 4096}
    return simple[type(kind)]
