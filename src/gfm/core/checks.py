"""Shape checks shared by the values of this package."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gfm.core.errors import ShapeError

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]
Stamps = NDArray[np.int64]


def check_shapes(
    arrays: Mapping[str, NDArray[np.generic] | None], shape: Mapping[str, tuple[int, ...]]
) -> None:
    """Raises ShapeError for the first array whose shape is not the promised one; None passes."""
    for name, expected in shape.items():
        array = arrays[name]
        if array is not None and array.shape != expected:
            raise ShapeError(name, array.shape, str(expected))
