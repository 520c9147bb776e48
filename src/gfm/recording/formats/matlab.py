"""MATLAB's .mat up to version 7: variables, and fields of structures as NAME.FIELD."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfm.recording.formats.columns import Columns, columns_of_arrays
from gfm.recording.formats.needed import needed


def read_mat(content: bytes, _rows: str) -> Columns:
    """Returns the variables of a .mat file as columns."""
    matlab = needed("scipy.io.matlab", "MATLAB files")
    try:
        variables = needed("scipy.io", "MATLAB files").loadmat(
            io.BytesIO(content), simplify_cells=True
        )
    except NotImplementedError as exc:
        raise ValueError("written as version 7.3: save it with '-v7'") from exc
    except (matlab.MatReadError, OSError, EOFError) as exc:
        raise ValueError(str(exc)) from exc
    named = {name: value for name, value in variables.items() if not name.startswith("__")}
    return columns_of_arrays(dict(_flat(named)))


def _flat(variables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in variables.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", np.asarray(value)
