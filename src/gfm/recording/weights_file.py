"""One version of a policy in a file: arrays and JSON in an .npz, nothing that could run."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gfm.core import BadInputError, Weights

_FORMAT = "gfm.weights/1"
_META = "meta"


def earlier(path: Path) -> Path:
    """Returns where the generation before `path` is kept."""
    return path.with_name(f"{path.stem}.1{path.suffix}")


def write_arrays(
    path: Path,
    meta: Mapping[str, object],
    arrays: Mapping[str, NDArray[Any]],
    *,
    keep_earlier: bool = False,
) -> None:
    """Writes arrays with a JSON description to `path`, which is the old file or the new, whole.

    Args:
        path: Where to.
        meta: The description.
        arrays: By name.
        keep_earlier: Whether the file that is there becomes the `earlier` one.

    Raises:
        OSError: it could not be written; what was there is still there.
    """
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with partial.open("wb") as file:
            np.savez(file, allow_pickle=False, **{_META: np.array(json.dumps(meta)), **arrays})
            file.flush()
            os.fsync(file.fileno())
        if keep_earlier and path.exists():
            path.replace(earlier(path))
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def read_arrays(path: Path, expected: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Returns the description and the arrays of a file.

    Args:
        path: What `write_arrays` wrote.
        expected: The `format` that its description must name.

    Raises:
        BadInputError: it cannot be read, is damaged, or is something else.
    """
    try:
        with path.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        meta = json.loads(str(arrays.pop(_META)))
    except FileNotFoundError as exc:
        raise BadInputError(f"{path}: no such file, expected {expected}") from exc
    except ValueError as exc:  # NumPy's advice on what is no archive is to unpickle it: not here
        raise BadInputError(f"{path}: damaged or no {expected} file") from exc
    except (OSError, KeyError, EOFError, AttributeError, zipfile.BadZipFile) as exc:
        raise BadInputError(f"{path}: damaged or no {expected} file: {exc}") from exc
    found = meta.get("format") if isinstance(meta, dict) else None
    if found != expected:
        raise BadInputError(f"{path}: format is {found!r}, expected {expected!r}")
    return meta, arrays


def write_weights(path: Path, weights: Weights) -> None:
    """Writes one version of a policy."""
    meta = {
        "format": _FORMAT,
        "version": weights.version,
        "created_ns": weights.created_ns,
        "spec_digest": weights.spec_digest,
        "run": weights.run,
        "life": weights.life,
    }
    write_arrays(path, meta, weights.tensors)


def read_weights(path: Path) -> Weights:
    """Returns the policy in a file.

    Raises:
        BadInputError: it cannot be read, is damaged, or is something else.
    """
    meta, arrays = read_arrays(path, _FORMAT)
    return Weights(
        version=int(meta["version"]),
        created_ns=int(meta["created_ns"]),
        spec_digest=str(meta["spec_digest"]),
        tensors=arrays,
        run=str(meta.get("run", "")),  # absent in files of before there were lives
        life=int(meta.get("life", 0)),
    )
