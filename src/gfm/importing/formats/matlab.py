"""MATLAB's .mat: variables, and fields of structures as NAME.FIELD.

Up to version 7 it is a format of its own, which SciPy reads. From 7.3 on it is HDF5: arrays lie
transposed, a structure is a group, and what MATLAB itself refers to lies beside the variables.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfm.core.extras import needed
from gfm.importing.formats.columns import Columns, columns_of_arrays

_HDF5 = b"MATLAB 7.3 MAT-file"
#: Of an array without elements, of which HDF5 keeps the shape alone.
_EMPTY, _CLASS = "MATLAB_empty", "MATLAB_class"
#: Classes of arrays that are no numbers: text, and what refers to other arrays.
_CHARS, _REFERENCES = "char", ("cell", "function_handle")


def read_mat(content: bytes, _rows: str) -> Columns:
    """Returns the variables of a .mat file as columns."""
    read = _variables_of_hdf5 if content.startswith(_HDF5) else _variables
    return columns_of_arrays(dict(_flat(read(content))))


def _variables(content: bytes) -> dict[str, Any]:
    matlab = needed("scipy.io.matlab", "MATLAB files need", "formats")
    try:
        variables = needed("scipy.io", "MATLAB files need", "formats").loadmat(
            io.BytesIO(content), simplify_cells=True
        )
    except (matlab.MatReadError, OSError, EOFError) as exc:
        raise ValueError(str(exc)) from exc
    return {name: value for name, value in variables.items() if not name.startswith("__")}


def _variables_of_hdf5(content: bytes) -> dict[str, Any]:
    h5py = needed("h5py", "MATLAB files of version 7.3 need", "formats")
    try:
        with h5py.File(io.BytesIO(content)) as file:
            return dict(_members(file))
    except (OSError, RuntimeError) as exc:
        raise ValueError(str(exc)) from exc


def _members(group: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yields the variables of a file, or the fields of a structure: numbers, texts, structures."""
    for name, member in group.items():
        if name.startswith("#"):
            continue
        if isinstance(member, Mapping):
            yield name, dict(_members(member))
            continue
        kind = bytes(member.attrs.get(_CLASS, b"double")).decode()
        if kind in _REFERENCES or member.attrs.get(_EMPTY):
            continue
        value = member[()].T
        yield name, "".join(map(chr, value.ravel())) if kind == _CHARS else value


def _flat(variables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, NDArray[Any]]]:
    for name, value in variables.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", np.asarray(value)
