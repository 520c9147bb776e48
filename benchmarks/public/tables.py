"""Tables with a head, as arrays."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from gfm.core.checks import Array


def columns(text: bytes) -> dict[str, Array]:
    """Returns the columns of a CSV file of numbers, each of shape (T,)."""
    head, _, rows = text.decode().partition("\n")
    numbers = np.loadtxt(io.StringIO(rows), delimiter=",", ndmin=2)
    return dict(zip(head.strip().split(","), numbers.T, strict=True))


def stamps(time_s: Array) -> NDArray[np.int64]:
    """Returns times as whole nanoseconds."""
    return np.round(1e9 * np.asarray(time_s, float)).astype(np.int64)
