"""LeRobot datasets, v2 and v3, as tables: one for each episode.

A dataset is a folder: meta/info.json says which features there are and how their elements are
called; data/ has Parquet files, one for each episode (v2) or for several (v3). Columns are named
FEATURE.ELEMENT (observation.state.elbow_flex.pos), or FEATURE where there is one element.

Shape letters: T frames.
"""

from __future__ import annotations

import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gfm.core import RecordingError
from gfm.core.extras import needed
from gfm.importing.tables import Table

EPISODE, TIMESTAMP = "episode_index", "timestamp"
STATE, ACTION = "observation.state", "action"
_VERSIONS = ("v2", "v3")
_KEPT = ("robot_type", "fps", "codebase_version")


@dataclass(frozen=True, kw_only=True)
class Dataset:
    """What meta/info.json says.

    Attributes:
        path: The dataset's folder.
        elements: Names of the columns of every numeric feature.
        header: Robot, rate and version.
    """

    path: Path
    elements: Mapping[str, tuple[str, ...]]
    header: Mapping[str, Any]

    @property
    def files(self) -> list[Path]:
        """The files with the frames, in order."""
        return sorted((self.path / "data").rglob("*.parquet"))


def read_dataset(path: Path) -> Dataset:
    """Returns a dataset's description.

    Raises:
        RecordingError: no dataset, of another version, without states, actions or frames.
    """
    where = path / "meta" / "info.json"
    try:
        info = json.loads(where.read_text())
        version, features = str(info["codebase_version"]), info["features"]
        elements = {n: _elements(n, f) for n, f in features.items() if _is_numeric(f)}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as exc:
        expected = "a LeRobot dataset: a folder with meta/info.json and data/"
        raise RecordingError(str(where), f"cannot be read ({exc})", expected) from exc
    if not version.startswith(_VERSIONS):
        raise RecordingError(str(where), f"codebase_version is {version}", "v2.0, v2.1 or v3.0")
    for feature in (STATE, ACTION, TIMESTAMP, EPISODE):
        if feature not in elements:
            there = ", ".join(sorted(elements)) or "none"
            raise RecordingError(f"{where}: feature {feature}", "is missing", f"it among {there}")
    header = {name: info[name] for name in _KEPT if info.get(name) is not None}
    dataset = Dataset(path=path, elements=elements, header=header)
    if not dataset.files:
        raise RecordingError(str(path / "data"), "has no .parquet file", "the dataset's frames")
    return dataset


def episodes(path: Path) -> Iterator[tuple[str, Table]]:
    """Yields the name and the frames of every episode.

    Raises:
        RecordingError: as `read_dataset`, or a file with frames that is damaged.
        ConfigError: the package `pyarrow` is not installed.
    """
    dataset = read_dataset(path)
    for file in dataset.files:
        cells = _frames(dataset, file)
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        numbers = np.array(cells[EPISODE], np.int64)
        borders = [0, *(np.flatnonzero(np.diff(numbers)) + 1).tolist(), len(numbers)]
        for start, stop in itertools.pairwise(borders):
            part = {name: column[start:stop] for name, column in cells.items()}
            place = f"episode {numbers[start]}"
            yield (
                f"{path.resolve().name}_episode_{numbers[start]:03d}",
                Table(path=file, place=place, digest=digest, columns=part, header=dataset.header),
            )


def _is_numeric(feature: Mapping[str, Any]) -> bool:
    kind, shape = str(feature["dtype"]), feature["shape"]
    return kind.startswith(("float", "int")) and len(shape) == 1


def _elements(name: str, feature: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the columns of one feature; elements without names of their own are counted."""
    size, names = feature["shape"][0], feature.get("names")
    if isinstance(names, dict):  # {"motors": [...]}, or {"elbow": 0, ...}
        groups = names.values()
        nested = all(isinstance(group, list) for group in groups)
        names = [one for group in groups for one in group] if nested else list(names)
    if size == 1 and not (isinstance(names, list) and name in (STATE, ACTION)):
        return (name,)
    called = names if isinstance(names, list) and len(names) == size else range(size)
    return tuple(f"{name}.{one}" for one in called)


def _frames(dataset: Dataset, file: Path) -> dict[str, list[float]]:
    """Returns the columns of one file."""
    parquet = needed("pyarrow.parquet", "LeRobot datasets need", "formats")
    cells: dict[str, list[float]] = {}
    try:
        frames = parquet.read_table(file, columns=list(dataset.elements))
        for feature, columns in dataset.elements.items():
            values = np.array(frames[feature].to_pylist()).reshape(frames.num_rows, -1)
            named = zip(columns, values.T.tolist(), strict=True)
            cells |= dict(named)
    except (OSError, ValueError, KeyError, TypeError) as exc:
        expected = f"frames with {', '.join(dataset.elements)}, as meta/info.json says"
        problem = f"cannot be read ({str(exc).partition(chr(10))[0]})"
        raise RecordingError(str(file), problem, expected) from exc
    if frames.num_rows == 0:
        raise RecordingError(str(file), "has no rows", "frames")
    return cells
