"""What every format becomes: named columns of cells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, kw_only=True)
class Columns:
    """The content of one table.

    Attributes:
        cells: By column. A cell is a number, a text, or a list of numbers.
        header: What the file says about itself beside the rows.
    """

    cells: Mapping[str, list[Any]] = field(default_factory=dict)
    header: Mapping[str, Any] = field(default_factory=dict)


def columns_of_arrays(arrays: Mapping[str, NDArray[Any]]) -> Columns:
    """Returns arrays as columns; single values go to the header.

    Time runs along the longer side of an array (T, J) or (J, T): its rows become lists. What has
    more than two sides, or holds objects, is left out.
    """
    cells: dict[str, list[Any]] = {}
    header: dict[str, Any] = {}
    for name, whole in arrays.items():
        array = np.squeeze(whole)
        if array.ndim == 0:
            header[name] = array.item()
        elif array.ndim <= 2 and array.dtype != object:
            turned = array.T if array.shape[0] < array.shape[-1] else array
            cells[name] = turned.tolist()
    return Columns(cells=cells, header=header)
